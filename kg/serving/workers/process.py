"""Worker processes: start, request and answer, cause of the end; and the set that a pool has."""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from kg.model import errors, platforms
from kg.model import vocabulary as v
from kg.model.errors import (
    EngineFailureError,
    GraphError,
    HereaboutsError,
    QueryError,
    QueryTimeoutError,
    QueryTooLargeError,
    WorkerDiedError,
)
from kg.serving.workers.admission import closed
from kg.serving.workers.evaluation import HEAD
from kg.serving.workers.isolation import Confinement

_START = """import sys; sys.path[:0] = sys.argv[2:]
from kg.serving.workers.evaluation.evaluator import main; main()"""
_PATHS = list(
    dict.fromkeys(
        str(Path(str(found.origin)).resolve().parent.parent)
        for found in map(find_spec, ("kg", "pyoxigraph", "numpy", "shapely"))
        if found is not None
    )
)
_READ = 1 << 20
_NICE = 5  # so that the writer has priority on a busy machine
START_WITHIN = 60.0  # [s]
REPORTS = b"TV"  # kinds of requests whose work follows from the map alone
REPORT_PATIENCE = 6  # times their processor time that they may take on a busy machine


@dataclass(frozen=True, slots=True)
class Answer:
    """The serialised result of a query."""

    media_type: str
    body: bytes
    sequence: int  # the last transaction of the map that the answer saw
    details: Mapping[str, Any] = field(default_factory=dict)  # further results, by kind of request


class WorkerProcess:
    """A process that answers one request at a time; `alive` is false after its end.

    Not safe for use by several threads at once, except `kill`. Unless `network` is true, the kernel
    denies it the network; `confinement` tells the mechanisms once the process is ready.
    """

    def __init__(self, settings: dict[str, Any], *, network: bool = False) -> None:
        if platforms.resource is None:
            raise GraphError(
                "queries of clients are evaluated in processes that the system limits, as Linux "
                "and macOS can; here ask the folder of the map"
            )
        self._settings = settings
        self._killed = False
        self.confinement = Confinement()
        self.past: int | None = None  # transaction of the last replayed past state
        # without site packages and environment: it starts fast and holds no secrets
        option = ["--network" if network else "--no-network"]
        environment = {k: v for k, v in os.environ.items() if k == "LD_LIBRARY_PATH"}
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-S", "-c", _START, *option, *_PATHS],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                bufsize=0,
                cwd="/",
                # threads of linear algebra libraries would use its memory
                env=environment | {"MALLOC_ARENA_MAX": "2", "OPENBLAS_NUM_THREADS": "1"},
                start_new_session=True,
            )
        except OSError as error:
            raise GraphError(f"cannot start a query worker: {error.strerror}") from error
        assert self._process.stdin is not None and self._process.stdout is not None
        self._in, self._out = self._process.stdin.fileno(), self._process.stdout.fileno()
        os.set_blocking(self._in, False)
        os.set_blocking(self._out, False)
        assert self._process.stderr is not None
        self._complaints = self._process.stderr.fileno()
        os.set_blocking(self._complaints, False)
        self._received = bytearray()
        self._head: dict[str, Any] = {}  # of the last answer
        self._ready = False
        with contextlib.suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, self.pid, _NICE)
        self._send(b"S", settings, time.monotonic() + START_WITHIN)

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether it accepts requests."""
        return not self._killed and self._process.poll() is None

    def ask(self, request: dict[str, Any], timeout: float, kind: bytes = b"Q") -> Answer:
        """The answer to a request (kinds: see `kg.serving.workers.evaluation`).

        `timeout` [s] begins when the process is ready. Reports, whose work follows from the map
        alone, may wait `REPORT_PATIENCE` times as long for a busy processor.

        Raises QueryTimeoutError, QueryTooLargeError, QueryError or HistoryError; the process is
        dead after a timeout or a crash, and accepts requests again after any other error.
        """
        body = bytearray()
        for part in self.stream(request, timeout, kind):
            body += part
        head = self._head
        return Answer(head["media_type"], bytes(body), head["sequence"], head)

    def stream(self, request: dict[str, Any], timeout: float, kind: bytes) -> Iterator[bytes]:
        """The parts of an answer as they arrive; raises as `ask`, also between parts."""
        self.wait_ready()
        within = timeout * (REPORT_PATIENCE if kind in REPORTS else 1)
        deadline = time.monotonic() + within
        self._send(kind, request | {"timeout": timeout, "within": within}, deadline)
        while True:
            kind, payload = self._message(deadline)
            if kind == b"D":
                yield payload
            elif kind == b"H":
                self._head = json.loads(payload)
            elif kind == b"E":
                raise _as_error(json.loads(payload))
            else:
                return

    def kill(self) -> None:
        """Kill the process; safe from any thread."""
        self._killed = True
        self._process.kill()

    def close(self) -> None:
        """End the process, and wait for its exit."""
        self.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout, self._process.stderr):
            if pipe is not None:
                pipe.close()

    def wait_ready(self) -> None:
        """Wait until the process has started, which takes nothing off the time of a request."""
        if not self._ready:
            started = json.loads(self._message(time.monotonic() + START_WITHIN)[1])
            self.confinement, self._ready = Confinement(**started), True

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
            return self._cause_of_abort()
        if code == -signal.SIGSEGV:
            return QueryTooLargeError("the request nests too deeply for the engine's parser")
        return WorkerDiedError(f"the query's worker was ended from outside ({code}); retry")

    def _cause_of_abort(self) -> QueryError:
        """The error of an aborted process; stderr tells lack of memory from an engine failure."""
        complaint = b""
        with contextlib.suppress(BlockingIOError):
            complaint = os.read(self._complaints, _READ)
        # "memory allocation of N bytes failed" may be followed by a panic
        if b"panicked at" in complaint and b"memory allocation of" not in complaint:
            return EngineFailureError(
                "the query engine failed on this request: a defect of the engine, not of the map; "
                "write it another way"
            )
        megabytes = self._settings["memory"] >> 20
        return QueryTooLargeError(f"the request needs more than {megabytes} MB of memory")


class WorkerSet:
    """Processes that evaluate one request at a time; safe to use from several threads.

    One runs in advance, and another is started where all are lent; up to `size` are kept. The queue
    of the pool lends no more at once, except while one that was killed ends.
    """

    def __init__(self, settings: dict[str, Any], size: int) -> None:
        self.size = size
        self._settings = settings
        self._changed = threading.Condition()
        self._idle = [WorkerProcess(settings)]
        self._lent: set[WorkerProcess] = set()
        self._killed = False

    @property
    def pids(self) -> tuple[int, ...]:
        """Process ids of the workers."""
        with self._changed:
            return tuple(sorted(worker.pid for worker in (*self._idle, *self._lent)))

    @property
    def busy(self) -> int:
        """Number of workers that are lent."""
        with self._changed:
            return len(self._lent)

    @contextlib.contextmanager
    def lent(self, at: int | None = None) -> Iterator[WorkerProcess]:
        """Lend a worker for a block, if possible one with the past state `at` in memory.

        Raises GraphError after `kill`, or if no process can be started.
        """
        worker = self._take(at)
        try:
            yield worker
        finally:
            self._give_back(worker)

    def kill(self) -> None:
        """Kill the processes, and start no more."""
        with self._changed:
            self._killed = True
            for worker in (*self._idle, *self._lent):
                worker.kill()

    def close(self) -> None:
        """Wait, after `kill`, until no worker is lent any more, and close them."""
        with self._changed:
            self._changed.wait_for(lambda: not self._lent)
            for worker in self._idle:
                worker.close()
            self._idle.clear()

    def _take(self, at: int | None) -> WorkerProcess:
        with self._changed:
            if self._killed:
                raise closed()
            self._close_dead()
            # of equals the one that was used last, which has probably opened the newest snapshot
            found = max(reversed(self._idle), key=lambda idle: idle.past == at, default=None)
            if found is not None:
                self._idle.remove(found)
            worker = found or WorkerProcess(self._settings)
            self._lent.add(worker)
            return worker

    def _give_back(self, worker: WorkerProcess) -> None:
        with self._changed:
            self._lent.remove(worker)
            self._idle.append(worker)
            self._close_dead()
            if len(self._idle) + len(self._lent) > self.size:
                self._idle.pop().close()
            if not self._killed and not self._idle and not self._lent:
                with contextlib.suppress(GraphError):  # the next query tries again and reports it
                    self._idle.append(WorkerProcess(self._settings))
            self._changed.notify_all()

    def _close_dead(self) -> None:
        for worker in [worker for worker in self._idle if not worker.alive]:
            self._idle.remove(worker)
            worker.close()


def _too_slow() -> QueryTimeoutError:
    return QueryTimeoutError("the query reached its time limit; request less, or narrow the query")


def _as_error(reported: dict[str, str]) -> HereaboutsError:
    kind = getattr(errors, reported["error"], QueryError)
    known = issubclass(kind, HereaboutsError)
    return kind(reported["message"]) if known else QueryError(reported["message"])


def settings_of(
    memory_mb: int,
    services: Collection[str] = (),
    readable: Collection[Path] = (),
    writable: Collection[Path] = (),
) -> dict[str, Any]:
    """The settings of a worker at its start.

    `services` are the endpoints SERVICE may name, `readable` and `writable` the folders that it may
    open.
    """
    return {
        "readable": list(map(str, readable)),
        "writable": list(map(str, writable)),
        "memory": memory_mb << 20,
        "services": sorted(services),
        "prefixes": v.PREFIXES,
        "dataset": v.DATASET_GRAPH.value,
        "sequence": v.SEQUENCE,
    }
