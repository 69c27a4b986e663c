"""Evaluation process: answers requests until stdin ends.

Before it reads a request, the kernel confines it (`kg.serving.workers.isolation`). Its parent may
kill it, and an alarm of the kernel ends it at its time limit even without a parent. Its address
space, files and processor time are limited.
"""

from __future__ import annotations

import contextlib
import gc
import json
import os
import signal
import sys
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import IO, Any, BinaryIO, Final, cast

from pyoxigraph import (
    Literal,
    NamedNode,
    QueryResultsFormat,
    QueryTriples,
    RdfFormat,
    Store,
)

from kg.history.point_in_time import PastStates
from kg.knowledge.ontology.declared_terms import absent_terms, known_terms
from kg.model.errors import (
    HereaboutsError,
    NotAcceptableError,
    QueryTooLargeError,
)
from kg.model.platforms import resource
from kg.rdf.literals import XmlPieces, is_xml
from kg.rdf.sparql import engine_gaps
from kg.rdf.sparql.engine_gaps import with_total_order
from kg.rdf.sparql.vetting import (
    check_network_words,
    explained,
    has_allowed_service,
    reads_chosen_graphs,
    vet,
)
from kg.serving.workers.evaluation import HEAD
from kg.serving.workers.evaluation.history_tasks import history_report, map_state, past_store
from kg.serving.workers.evaluation.ingestion import (
    SnapshotView,
    evaluate_update,
    parse_document,
)
from kg.serving.workers.isolation import confine
from kg.store.folder import is_disk_full

_LAST = (b".", b"E")  # messages that end an answer
GRACE = 0.5  # [s] after the time limit until the worker ends itself
CHUNK = 1 << 16

Request = dict[str, Any]


class Evaluator:
    """Evaluates requests on one snapshot at a time."""

    def __init__(self, settings: Request, out: BinaryIO, *, denied: bool) -> None:
        self._settings = settings
        self._denied = denied  # whether the kernel denies the network
        self._out = out
        self._folder = ""
        self._store = Store()
        self._sequence = 0
        self._past = PastStates()

    def open(self, folder: str) -> None:
        """Open another snapshot."""
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
            if "folder" in request:
                self.open(request["folder"])
            _TASKS[kind](self, request)
        except HereaboutsError as error:
            self._fail(type(error).__name__, str(error))
        except MemoryError:
            self._fail("QueryTooLargeError", "the query needs more memory than it may have")
        except SyntaxError as error:
            self._fail("QueryError", self._syntax_reason(request, error))
        except (ValueError, OSError, RuntimeError) as error:
            fault = "DiskFullError" if is_disk_full(error) else "QueryError"
            self._fail(fault, self._reason(request, error))

    def _syntax_reason(self, request: Request, error: SyntaxError) -> str:
        """Place and cause of a query's syntax error; the message of other documents' parsers."""
        if "sparql" not in request:
            return self._reason(request, error)
        cause = explained(request["sparql"], str(error), terms=partial(known_terms, self._store))
        return f"{request.get('name') or 'the query'}: {cause}"

    def _reason(self, request: Request, error: Exception) -> str:
        """Message of an error; it does not quote replies of SERVICE endpoints."""
        if has_allowed_service(request.get("sparql", ""), self._settings["services"]):
            return "the query cannot be answered: an endpoint of SERVICE gave no usable answer"
        return f"the query cannot be answered: {error}"

    def _query(self, request: Request) -> None:
        if not self._denied:
            check_network_words(request["sparql"], self._settings["services"])
        vet(request["sparql"], services=self._settings["services"])
        if "at" in request:
            past = past_store(self._past, self._store, request)
            self._write(request, past, int(request["at"]))
        else:
            self._write(request, self._store, self._sequence)

    def _parse(self, request: Request) -> None:
        self._send_all("application/n-quads", parse_document(request), request)

    def _prepare_past(self, request: Request) -> None:
        past_store(self._past, self._store, request)
        self._send_all("", b"", request)

    def _update(self, request: Request) -> None:
        if not self._denied:
            check_network_words(request["sparql"], ())
        _limit_files(resource.RLIM_INFINITY)  # a later operation sees a changed copy
        try:
            view = SnapshotView(self._store, self._folder, self._sequence, request)
            head, body = evaluate_update(view, request)
        finally:
            _limit_files(0)
        self._send_all("application/n-quads", body, request, **head)

    def _dump(self, request: Request) -> None:
        media_type = request["media_type"]
        head = {"media_type": media_type, "sequence": self._sequence}
        self.send(b"H", json.dumps(head).encode())
        sink = _Sink(self.send, request["max_bytes"], xml=is_xml(media_type))
        form = cast(RdfFormat, RdfFormat.from_media_type(media_type))
        self._store.dump(cast(IO[bytes], sink), form, prefixes=request["prefixes"])
        sink.end()
        self.send(b".", b"")

    def _report_history(self, request: Request) -> None:
        report = history_report(self._store, request)
        self._send_all(request["media_type"], report.encode(), request)

    def _draw(self, request: Request) -> None:
        body = map_state(self._store, self._sequence, request)
        self._send_all("application/json", body.encode(), request)

    def _plan_ontology(self, request: Request) -> None:
        from kg.serving.workers.evaluation.ingestion import plan_ontology  # takes a second

        head, body = plan_ontology(self._store, request)
        self._send_all("application/n-quads", body, request, **head)

    def _send_all(self, media_type: str, body: bytes, request: Request, **more: object) -> None:
        sink = _Sink(self.send, request["max_bytes"])
        head = {"media_type": media_type, "sequence": self._sequence, **more}
        self.send(b"H", json.dumps(head).encode())
        sink.write(body)
        sink.end()
        self.send(b".", b"")

    def _write(self, request: Request, state: Store, sequence: int) -> None:
        sparql = request["sparql"]
        results = state.query(
            with_total_order(sparql) if request.get("total_order") else sparql,
            base_iri=request["base_iri"],
            prefixes=self._settings["prefixes"],
            custom_functions=engine_gaps.FUNCTIONS,
            **_dataset(request),
        )
        media_type = request["graph_type" if isinstance(results, QueryTriples) else "result_type"]
        if media_type is None:
            what = "triples" if isinstance(results, QueryTriples) else "a table or truth value"
            raise NotAcceptableError(f"the answer is {what}: no format accepted can carry it")
        notes = absent_terms(sparql, state)
        head = {"media_type": media_type, "sequence": sequence, "notes": notes}
        self.send(b"H", json.dumps(head).encode())
        sink = _Sink(self.send, request["max_bytes"], xml=is_xml(media_type))
        if isinstance(results, QueryTriples):
            results.serialize(cast(IO[bytes], sink), RdfFormat.from_media_type(media_type))
        else:
            results.serialize(cast(IO[bytes], sink), QueryResultsFormat.from_media_type(media_type))
        sink.end()
        self.send(b".", b"")

    def _fail(self, name: str, message: str) -> None:
        line = " ".join(message.split())[:2000]
        self.send(b"E", json.dumps({"error": name, "message": line}).encode())

    def send(self, kind: bytes, payload: bytes) -> None:
        """Send a message to the parent; the last of an answer ends the limit of its time."""
        if kind in _LAST:  # not after it: a worker that is held up then would be ended for nothing
            _limit_time(0, 0)
        self._out.write(HEAD.pack(kind, len(payload)) + payload)
        self._out.flush()


_TASKS: Final[dict[bytes, Callable[[Evaluator, Request], None]]] = {
    b"Q": Evaluator._query,
    b"U": Evaluator._update,
    b"L": Evaluator._parse,
    b"T": Evaluator._report_history,
    b"G": Evaluator._dump,
    b"P": Evaluator._prepare_past,
    b"V": Evaluator._draw,
    b"N": Evaluator._plan_ontology,
}


class _Sink:
    """Output of the engine: sent in chunks; raises QueryTooLargeError beyond the limit."""

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
                f"the answer has more than {self._limit:,} bytes; select less, or use LIMIT"
            )
        self._chunk += data if self._pieces is None else self._pieces.take(bytes(data))
        if len(self._chunk) >= CHUNK:
            self.flush()
        return len(data)

    def end(self) -> None:
        """Send the rest."""
        if self._pieces is not None:
            self._chunk += self._pieces.rest()
        self.flush()

    def flush(self) -> None:
        if self._chunk:
            self._send(b"D", bytes(self._chunk))
            self._chunk.clear()


def _dataset(request: Request) -> dict[str, Any]:
    """Dataset of a query: graphs of the request, else of FROM, else the union of all."""
    default, named = request["default_graphs"], request["named_graphs"]
    if default or named:
        return {
            "default_graph": [NamedNode(iri) for iri in default],
            "named_graphs": [NamedNode(iri) for iri in named],
        }
    return {"use_default_graph_as_union": not reads_chosen_graphs(request["sparql"])}


def _limit_process(memory: int) -> None:
    """Limit this process to `memory` more bytes of address space; no core dump, no files."""
    with contextlib.suppress(FileNotFoundError):  # only Linux has it and enforces it
        now = int(Path("/proc/self/statm").read_text("ascii").split()[0])
        limit = now * os.sysconf("SC_PAGE_SIZE") + memory
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    _limit_files(0)


def _limit_files(size: int) -> None:
    """Limit the size of the files that this process writes."""
    _limit(resource.RLIMIT_FSIZE, size)


def _limit_time(seconds: float, within: float) -> None:
    """Limit the work to `seconds` of processor time, `within` so many of the clock; 0: no limit.

    The kernel ends the process: at an alarm, or after twice the processor time.
    """
    signal.setitimer(signal.ITIMER_REAL, within + GRACE if within else 0)
    used = resource.getrusage(resource.RUSAGE_SELF)
    limit = int(used.ru_utime + used.ru_stime + 2 * seconds + 2) if seconds else -1
    _limit(resource.RLIMIT_CPU, limit)


def _limit(kind: int, value: int) -> None:
    """Set the soft limit; the hard one may be that of a service manager, which stays."""
    most = resource.getrlimit(kind)[1]
    within = most if value == resource.RLIM_INFINITY or 0 <= most < value else value
    resource.setrlimit(kind, (within, most))


def _read(stream: BinaryIO) -> tuple[bytes, Request] | None:
    head = stream.read(HEAD.size)
    if len(head) < HEAD.size:
        return None
    kind, length = HEAD.unpack(head)
    return kind, json.loads(stream.read(length))


def main() -> None:
    """Serve requests until stdin ends; ``--network`` allows the network."""
    requests, answers = sys.stdin.buffer, sys.stdout.buffer
    first = _read(requests)
    if first is None:
        return
    settings = first[1]
    # a confined process loads no machine code
    engine_gaps.load_libraries()
    if settings.get("ontologies"):
        from kg.serving.workers.evaluation.ingestion import load_libraries  # takes a second

        load_libraries()
    _limit_process(settings["memory"])
    readable, writable = (map(Path, settings[key]) for key in ("readable", "writable"))
    found = confine(readable, writable, network="--network" in sys.argv)
    evaluator = Evaluator(settings, answers, denied=found.denies_network)
    evaluator.send(b"R", json.dumps(asdict(found)).encode())
    while (message := _read(requests)) is not None:
        kind, request = message
        _limit_time(request["timeout"], request["within"])
        evaluator.answer(kind, request)
