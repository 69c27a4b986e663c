"""Requests to the query pool: queries, and the call of a request from its thread to a worker."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypedDict, Unpack

from kg.model.errors import NotAcceptableError, QueryError
from kg.rdf.sparql.vetting import check_length, check_unicode
from kg.serving.workers.admission import Lane
from kg.serving.workers.content_negotiation import GRAPH_TYPES, RESULT_TYPES, negotiate
from kg.serving.workers.process import WorkerProcess


class WorkerCall:
    """A request to a worker of a pool, which another thread may cancel.

    - `kind` and `body` are those of `kg.serving.workers.evaluation`
    - `timeout` [s] counts from a ready worker on, and cannot exceed the pool's
    - `at_least`: the state of the answer includes this transaction
    - `at`: the state right after this transaction; its replay may take another `timeout`
    - `client`: all calls of one client share its part of the pool
    - `standing`: a query of a subscription, which has lower priority than others
    """

    def __init__(
        self,
        kind: bytes,
        body: dict[str, Any],
        *,
        timeout: float | None = None,
        at_least: int = 0,
        at: int | None = None,
        client: str = "",
        standing: bool = False,
    ) -> None:
        self.kind, self.body, self.timeout = kind, body, timeout
        self.at_least, self.at = max(at_least, at or 0), at
        self.client, self.standing = client, standing
        self.cancelled = False
        self._worker: WorkerProcess | None = None
        self._guard = threading.Lock()

    @property
    def is_of_past(self) -> bool:
        """Whether it is about a past state or the history."""
        return self.at is not None or self.kind == b"T"

    @property
    def lane(self) -> Lane:
        """Its lane of the queue; requests about the past may take seconds."""
        if self.standing:
            return "standing"
        return "past" if self.is_of_past else "present"

    @contextmanager
    def on(self, worker: WorkerProcess) -> Iterator[None]:
        """Let `cancel` kill `worker` during a block; QueryError if it was cancelled before."""
        with self._guard:
            if self.cancelled:
                raise QueryError("the query was cancelled")
            before, self._worker = self._worker, worker
        try:
            yield
        finally:
            with self._guard:
                self._worker = before

    def cancel(self) -> None:
        """Cancel it, and kill its worker."""
        with self._guard:
            self.cancelled = True
            if self._worker is not None:
                self._worker.kill()


class QueryOptions(TypedDict, total=False):
    """Options of a query, none of them required; the others are as of `WorkerCall`."""

    accept: str | None  # Accept header: formats that the client takes
    default_graphs: Sequence[str]  # IRIs in place of FROM; by default the union of all graphs
    named_graphs: Sequence[str]  # IRIs in place of FROM NAMED (SPARQL 1.1 Protocol, section 2.1.4)
    base: str | None  # relative IRIs are resolved against it
    timeout: float | None
    at_least: int
    at: int | None
    client: str
    standing: bool


def query_call(sparql: str, **options: Unpack[QueryOptions]) -> WorkerCall:
    """A query as a call.

    Raises QueryRefusedError for text that is too long or not Unicode, NotAcceptableError if the
    client accepts no format of any kind of answer.
    """
    default, named = options.get("default_graphs", ()), options.get("named_graphs", ())
    check_length(sparql)
    for text in (sparql, *default, *named):
        check_unicode(text)
    accept = options.get("accept")
    result_type, graph_type = _acceptable(accept, RESULT_TYPES), _acceptable(accept, GRAPH_TYPES)
    if result_type is None and graph_type is None:
        negotiate(accept, RESULT_TYPES)
    body = {
        "sparql": sparql,
        "base_iri": options.get("base"),
        "default_graphs": list(default),
        "named_graphs": list(named),
        "result_type": result_type,
        "graph_type": graph_type,
    }
    return WorkerCall(
        b"Q",
        body,
        timeout=options.get("timeout"),
        at_least=options.get("at_least", 0),
        at=options.get("at"),
        client=options.get("client", ""),
        standing=options.get("standing", False),
    )


def _acceptable(accept: str | None, offered: tuple[str, ...]) -> str | None:
    try:
        return negotiate(accept, offered)
    except NotAcceptableError:
        return None
