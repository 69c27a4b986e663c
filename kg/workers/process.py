"""One worker process, seen from the pool: started, asked, and killed at its limit."""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy
import pyoxigraph

import kg
from kg import errors
from kg import vocabulary as v
from kg.errors import GraphError, HistoryError, QueryError, QueryTimeoutError, QueryTooLargeError
from kg.workers.evaluator import HEAD
from kg.workers.snapshots import Snapshot

_START = "import sys; sys.path[:0] = sys.argv[1:]; from kg.workers.evaluator import main; main()"
_PATHS = list(
    dict.fromkeys(
        str(Path(str(m.__file__)).resolve().parent.parent) for m in (kg, pyoxigraph, numpy)
    )
)
_READ = 1 << 20
_NICE = 5  # so that the writer goes first where processors are short
_GRAPHS = (
    v.ONTOLOGY_GRAPH,
    v.COMMONSENSE_GRAPH,
    v.MAP_GRAPH,
    v.HISTORY_GRAPH,
    v.ASSERTIONS_GRAPH,
    v.DATASET_GRAPH,
)
START_WITHIN = 60.0  # [s] that a worker has to start, or to open a snapshot


@dataclass(frozen=True, slots=True)
class Answer:
    """The serialised result of a query."""

    media_type: str
    body: bytes
    sequence: int  # the last transaction of the map that the answer saw


class WorkerDiedError(QueryError):
    """A worker was ended by something else than its own limits."""


class WorkerProcess:
    """A process that answers one query at a time; `alive` is false once it was killed or died.

    Not safe for use by several threads at once, except `kill`.
    """

    def __init__(self, settings: dict[str, Any]) -> None:
        self._settings = settings
        self._killed = False
        self.snapshot: Snapshot | None = None  # what it reads, or was told to read
        # isolated, without site and without this process's environment: quick, and no secrets
        environment = {k: v for k, v in os.environ.items() if k == "LD_LIBRARY_PATH"}
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-S", "-c", _START, *_PATHS],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                bufsize=0,
                cwd="/",
                # threads for linear algebra that nobody asks for would take of its memory
                env=environment | {"MALLOC_ARENA_MAX": "2", "OPENBLAS_NUM_THREADS": "1"},
                start_new_session=True,
            )
        except OSError as error:
            raise GraphError(f"cannot start a query worker: {error.strerror}") from error
        assert self._process.stdin is not None and self._process.stdout is not None
        self._in, self._out = self._process.stdin.fileno(), self._process.stdout.fileno()
        os.set_blocking(self._in, False)
        os.set_blocking(self._out, False)
        self._received = bytearray()
        self._unready = 0  # messages it has not yet said it is done with
        self._tell(b"S", settings)

    @property
    def pid(self) -> int:
        """Of the process."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether it can be asked."""
        return not self._killed and self._process.poll() is None

    def prepare(self, snapshot: Snapshot, timeout: float) -> None:
        """Have it open a snapshot while nobody waits; a failure shows at the next question."""
        request = {"folder": str(snapshot.folder), "timeout": timeout}
        with contextlib.suppress(QueryError):
            self._tell(b"O", request)

    def ask(self, request: dict[str, Any], timeout: float, kind: bytes = b"Q") -> Answer:
        """The answer to one request (`kg.workers.evaluator` has the kinds).

        `timeout` counts from when the process is ready for it.

        Raises QueryTimeoutError, QueryTooLargeError, QueryError or HistoryError; the process is
        dead after a timeout or a crash, and can be asked again after any other error.
        """
        self._be_ready()
        deadline = time.monotonic() + timeout
        self._send(kind, request | {"timeout": timeout}, deadline)
        head, body = {}, bytearray()
        while True:
            kind, payload = self._message(deadline)
            if kind == b"D":
                body += payload
            elif kind == b"H":
                head = json.loads(payload)
            elif kind == b"E":
                raise _as_error(json.loads(payload))
            else:
                return Answer(head["media_type"], bytes(body), head["sequence"])

    def kill(self) -> None:
        """End the process at once, whatever it does; safe from any thread."""
        self._killed = True
        self._process.kill()

    def close(self) -> None:
        """End the process, and wait until it is gone."""
        self.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()

    def _tell(self, kind: bytes, message: dict[str, Any]) -> None:
        self._send(kind, message, time.monotonic() + START_WITHIN)
        self._unready += 1

    def _be_ready(self) -> None:
        # or a slow start of the process would be taken off the time of the first query
        deadline = time.monotonic() + START_WITHIN
        while self._unready:
            self._message(deadline)
            self._unready -= 1

    def _send(self, kind: bytes, message: dict[str, Any], deadline: float) -> None:
        payload = json.dumps(message).encode()
        data = memoryview(HEAD.pack(kind, len(payload)) + payload)
        while data:
            self._wait(self._in, select.POLLOUT, deadline)
            try:
                data = data[os.write(self._in, data) :]
            except BlockingIOError:
                continue
            except BrokenPipeError:
                raise self._cause_of_death() from None

    def _message(self, deadline: float) -> tuple[bytes, bytes]:
        kind, length = HEAD.unpack(self._exactly(HEAD.size, deadline))
        return kind, self._exactly(length, deadline)

    def _exactly(self, count: int, deadline: float) -> bytes:
        while len(self._received) < count:
            self._wait(self._out, select.POLLIN, deadline)
            try:
                data = os.read(self._out, _READ)
            except BlockingIOError:
                continue
            if not data:
                raise self._cause_of_death()
            self._received += data
        taken = bytes(self._received[:count])
        del self._received[:count]
        return taken

    def _wait(self, pipe: int, event: int, deadline: float) -> None:
        poll = select.poll()
        poll.register(pipe, event)
        if not poll.poll(max(0.0, deadline - time.monotonic()) * 1000):
            self.kill()
            raise _too_slow()

    def _cause_of_death(self) -> QueryError:
        code = self._process.wait()
        if code in (-signal.SIGALRM, -signal.SIGXCPU):
            return _too_slow()
        if code == -signal.SIGABRT:
            megabytes = self._settings["memory"] >> 20
            return QueryTooLargeError(f"the query needs more than {megabytes} MB of memory")
        if code == -signal.SIGSEGV:
            return QueryTooLargeError("the query nests too deeply for the engine's parser")
        return WorkerDiedError(f"the query's worker was ended from outside ({code}); ask again")


def _too_slow() -> QueryTimeoutError:
    return QueryTimeoutError("the query ran into its time limit; ask for less, or more narrowly")


def _as_error(told: dict[str, str]) -> QueryError | HistoryError:
    kind = getattr(errors, told["error"], QueryError)
    known = issubclass(kind, QueryError | HistoryError)
    return kind(told["message"]) if known else QueryError(told["message"])


def settings_of(memory_mb: int, services: Collection[str]) -> dict[str, Any]:
    """What a worker is told at its start; `services` are the endpoints SERVICE may name."""
    return {
        "memory": memory_mb << 20,
        "nice": _NICE,
        "services": sorted(services),
        "prefixes": v.PREFIXES,
        "graphs": _GRAPHS,
        "dataset": v.DATASET_GRAPH,
        "sequence": v.SEQUENCE,
    }
