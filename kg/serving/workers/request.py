"""Requests to the query pool: the asker, and the call from its thread to a worker."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, TypedDict

from kg.model.errors import NotAcceptableError, QueryError
from kg.rdf.sparql.vetting import check_unicode
from kg.serving.workers.admission import Lane
from kg.serving.workers.content_negotiation import Form, choose_format
from kg.serving.workers.process import WorkerProcess


@dataclass(frozen=True, slots=True)
class Asker:
    """The author of a query; all queries of one `client` share its part of the pool.

    A `standing` query (of a subscription) has lower priority than others.
    """

    client: str = ""
    standing: bool = False


ANYONE: Final = Asker()


class QueryCall:
    """A request in the pool, which another thread may cancel."""

    def __init__(
        self,
        request: dict[str, Any],
        timeout: float,
        at_least: int,
        at: int | None = None,
        kind: bytes = b"Q",
        asker: Asker = ANYONE,
    ) -> None:
        self.request, self.timeout, self.at_least = request, timeout, at_least
        self.at, self.kind, self.asker = at, kind, asker
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
        if self.asker.standing:
            return "standing"
        return "past" if self.is_of_past else "present"

    def begin(self, worker: WorkerProcess) -> None:
        """Assign it to `worker`; raises QueryError if it was cancelled before."""
        with self._guard:
            if self.cancelled:
                raise QueryError("the query was cancelled")
            self._worker = worker

    def end(self) -> None:
        """Take it from its worker."""
        with self._guard:
            self._worker = None

    def cancel(self) -> None:
        """Cancel it, and kill its worker."""
        with self._guard:
            self.cancelled = True
            if self._worker is not None:
                self._worker.kill()


class QueryOptions(TypedDict, total=False):
    """Options of a query, none of them required."""

    accept: str | None  # Accept header: formats that the client takes
    default_graphs: Sequence[str]  # IRIs in place of FROM; by default the union of all graphs
    named_graphs: Sequence[str]  # IRIs in place of FROM NAMED (SPARQL 1.1 Protocol, section 2.1.4)
    base: str | None  # relative IRIs are resolved against it
    timeout: float | None  # [s] from a ready worker on; cannot exceed the pool's
    at_least: int  # the state of the answer includes this transaction
    at: int | None  # the state right after this transaction; its replay may take another `timeout`
    asker: Asker


def request_of(sparql: str, options: QueryOptions) -> dict[str, Any]:
    """A query as a request to a worker.

    Raises QueryRefusedError for text that is not Unicode, NotAcceptableError if the client accepts
    no format of any kind of answer.
    """
    default, named = options.get("default_graphs", ()), options.get("named_graphs", ())
    for text in (sparql, *default, *named):
        check_unicode(text)
    accept = options.get("accept")
    result_type, graph_type = _acceptable(accept, "select"), _acceptable(accept, "construct")
    if result_type is None and graph_type is None:
        choose_format(accept, "select")
    return {
        "sparql": sparql,
        "base_iri": options.get("base"),
        "default_graphs": list(default),
        "named_graphs": list(named),
        "result_type": result_type,
        "graph_type": graph_type,
    }


def _acceptable(accept: str | None, form: Form) -> str | None:
    try:
        return choose_format(accept, form)
    except NotAcceptableError:
        return None
