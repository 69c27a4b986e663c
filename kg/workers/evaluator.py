"""The process that evaluates: reads requests from stdin, answers on stdout, until stdin ends.

It is meant to be killed, and to kill itself: an alarm of the kernel ends it at its time limit even
where its parent is gone, and its address space, files and processor time are limited. Messages both
ways are a type byte, a length (4 bytes, little endian) and that many bytes:

    >  S  the settings (JSON), first       <  R  done with S or O
    >  O  a snapshot to open (JSON)        <  H  {"media_type", "sequence"}
    >  Q  a query (JSON), perhaps of then  <  D  a part of the answer
    >  T  what to tell of the past         <  .  the end of the answer
    >  P  a past state to make             <  E  {"error": name of the exception, "message"}
"""

from __future__ import annotations

import contextlib
import gc
import json
import os
import resource
import signal
import struct
import sys
from collections.abc import Callable
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, BinaryIO, cast

from pyoxigraph import Literal, NamedNode, QueryResultsFormat, QueryTriples, RdfFormat, Store

from kg.characters import XmlPieces, is_xml
from kg.errors import HistoryError, NotAcceptableError, QueryError, QueryTooLargeError
from kg.functions import FUNCTIONS
from kg.workers.vetting import reads_chosen_graphs, refuse_other_graph, vet

if TYPE_CHECKING:
    from kg.history.moment import Moment
    from kg.workers.past import LastMoment

HEAD = struct.Struct("<cI")
GRACE = 0.5  # [s] after the time limit until the worker ends itself
CHUNK = 1 << 16

Request = dict[str, Any]


class Evaluator:
    """One snapshot, and the queries asked of it."""

    def __init__(self, settings: Request, out: BinaryIO) -> None:
        self._settings = settings
        self._out = out
        self._folder = ""
        self._store = Store()
        self._sequence = 0
        self._last: LastMoment | None = None  # once it was asked of the past

    def open(self, folder: str) -> None:
        """Read from that snapshot from now on."""
        if folder == self._folder:
            return
        store = Store.read_only(folder)
        gc.collect()
        graph, predicate = (NamedNode(self._settings[key]) for key in ("dataset", "sequence"))
        quads = store.quads_for_pattern(graph, predicate, None, graph)
        numbers = [int(q.object.value) for q in quads if isinstance(q.object, Literal)]
        self._store, self._folder, self._sequence = store, folder, max(numbers, default=0)

    def answer(self, kind: bytes, request: Request) -> None:
        """Write the whole answer to a request, or one error."""
        try:
            if kind == b"P":
                self._make_past(request)
                return
            self.open(request["folder"])
            if kind == b"T":
                self._tell(request)
            elif "at" in request:
                self._write_past(request)
            else:
                self._vet(request, self.is_graph)
                self._write(request, self._store, self._sequence)
        except (QueryError, HistoryError) as error:
            self._fail(type(error).__name__, str(error))
        except MemoryError:
            self._fail("QueryTooLargeError", "the query needs more memory than it may have")
        except (SyntaxError, ValueError, OSError, RuntimeError) as error:
            self._fail("QueryError", f"the query cannot be answered: {error}")

    def is_graph(self, iri: str) -> bool:
        """Whether the map has, or may come to have, a graph of that name."""
        if iri in self._settings["graphs"]:
            return True
        with contextlib.suppress(ValueError):
            return self._store.contains_named_graph(NamedNode(iri))
        return False

    def _vet(self, request: Request, is_graph: Callable[[str], bool]) -> None:
        vet(
            request["sparql"],
            is_graph=is_graph,
            prefixes=self._settings["prefixes"],
            services=self._settings["services"],
        )
        for iri in (*request["default_graphs"], *request["named_graphs"]):
            refuse_other_graph(iri, is_graph)

    def _write_past(self, request: Request) -> None:
        from kg.workers.past import LastMoment  # few workers are ever asked of the past

        self._last = self._last or LastMoment()
        with self._last.asked(self._store, request) as moment:

            def is_graph(iri: str) -> bool:
                with contextlib.suppress(ValueError):
                    return self.is_graph(iri) or moment.knows_graph(NamedNode(iri))
                return False

            self._vet(request, is_graph)
            self._write(request, moment, moment.sequence)

    def _make_past(self, request: Request) -> None:
        from kg.workers.past import make_past  # as above

        _limit_files(resource.RLIM_INFINITY)
        try:
            make_past(Store(request["folder"]), request)
        finally:
            gc.collect()
            _limit_files(0)
        self._send_all("", b"", request)

    def _tell(self, request: Request) -> None:
        from kg.workers.past import tell_of_past  # as above

        told = tell_of_past(self._store, request)
        self._send_all(request["media_type"], told.encode(), request)

    def _send_all(self, media_type: str, body: bytes, request: Request) -> None:
        sink = _Sink(self._send, request["max_bytes"])
        head = {"media_type": media_type, "sequence": self._sequence}
        self._send(b"H", json.dumps(head).encode())
        sink.write(body)
        sink.end()
        self._send(b".", b"")

    def _write(self, request: Request, state: Store | Moment, sequence: int) -> None:
        results = state.query(
            request["sparql"],
            base_iri=request["base_iri"],
            prefixes=self._settings["prefixes"],
            custom_functions=FUNCTIONS,
            **_dataset(request),
        )
        media_type = request["graph_type" if isinstance(results, QueryTriples) else "result_type"]
        if media_type is None:
            what = "triples" if isinstance(results, QueryTriples) else "a table or truth value"
            raise NotAcceptableError(f"the answer is {what}: no format accepted can carry it")
        head = {"media_type": media_type, "sequence": sequence}
        self._send(b"H", json.dumps(head).encode())
        sink = _Sink(self._send, request["max_bytes"], xml=is_xml(media_type))
        if isinstance(results, QueryTriples):
            results.serialize(cast(IO[bytes], sink), RdfFormat.from_media_type(media_type))
        else:
            results.serialize(cast(IO[bytes], sink), QueryResultsFormat.from_media_type(media_type))
        sink.end()
        self._send(b".", b"")

    def _fail(self, name: str, message: str) -> None:
        line = " ".join(message.split())[:2000]
        self._send(b"E", json.dumps({"error": name, "message": line}).encode())

    def ready(self) -> None:
        """Say that the last message without an answer was taken in."""
        self._send(b"R", b"")

    def _send(self, kind: bytes, payload: bytes | bytearray) -> None:
        self._out.write(HEAD.pack(kind, len(payload)) + payload)
        self._out.flush()


class _Sink:
    """What the engine writes an answer into: sent on in chunks, refused beyond the limit."""

    def __init__(
        self, send: Callable[[bytes, bytes], None], limit: int, *, xml: bool = False
    ) -> None:
        self._send = send
        self._pieces = XmlPieces() if xml else None
        self._limit = limit
        self._left = limit
        self._chunk = bytearray()

    def write(self, data: bytes) -> int:
        self._left -= len(data)
        if self._left < 0:
            raise QueryTooLargeError(
                f"the answer has more than {self._limit:,} bytes; ask for less, or with LIMIT"
            )
        self._chunk += data if self._pieces is None else self._pieces.take(bytes(data))
        if len(self._chunk) >= CHUNK:
            self.flush()
        return len(data)

    def end(self) -> None:
        """Send on what is left."""
        if self._pieces is not None:
            self._chunk += self._pieces.rest()
        self.flush()

    def flush(self) -> None:
        if self._chunk:
            self._send(b"D", bytes(self._chunk))
            self._chunk.clear()


def _dataset(request: Request) -> dict[str, Any]:
    """Which graphs to ask: those of the request, else those of FROM, else the union of all."""
    default, named = request["default_graphs"], request["named_graphs"]
    if default or named:
        return {
            "default_graph": [NamedNode(iri) for iri in default],
            "named_graphs": [NamedNode(iri) for iri in named],
        }
    return {"use_default_graph_as_union": not reads_chosen_graphs(request["sparql"])}


def _limit_process(memory: int) -> None:
    """No core dump, no growing file, and `memory` bytes more of addresses than now."""
    with contextlib.suppress(FileNotFoundError):  # only Linux says, and only Linux obeys
        now = int(Path("/proc/self/statm").read_text("ascii").split()[0])
        most = now * os.sysconf("SC_PAGE_SIZE") + memory
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    _limit_files(0)


def _limit_files(size: int) -> None:
    """How long a file may become that this process writes."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))


def _limit_time(seconds: float) -> None:
    """Have the kernel end this process after so many seconds; 0 lifts the limit."""
    signal.setitimer(signal.ITIMER_REAL, seconds + GRACE if seconds else 0)
    used = resource.getrusage(resource.RUSAGE_SELF)
    most = int(used.ru_utime + used.ru_stime + 2 * seconds + 2) if seconds else -1
    resource.setrlimit(resource.RLIMIT_CPU, (most, resource.RLIM_INFINITY))


def _read(stream: BinaryIO) -> tuple[bytes, Request] | None:
    head = stream.read(HEAD.size)
    if len(head) < HEAD.size:
        return None
    kind, length = HEAD.unpack(head)
    return kind, json.loads(stream.read(length))


def main() -> None:
    """Serve requests until stdin ends."""
    requests, answers = sys.stdin.buffer, sys.stdout.buffer
    first = _read(requests)
    if first is None:
        return
    os.nice(first[1]["nice"])
    _limit_process(first[1]["memory"])
    evaluator = Evaluator(first[1], answers)
    evaluator.ready()
    while (message := _read(requests)) is not None:
        kind, request = message
        _limit_time(request["timeout"])
        if kind == b"O":
            with contextlib.suppress(OSError):  # the next request names it again, and reports it
                evaluator.open(request["folder"])
            evaluator.ready()
        else:
            evaluator.answer(kind, request)
        _limit_time(0)
