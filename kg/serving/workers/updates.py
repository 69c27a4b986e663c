"""Updates and documents of clients: evaluated in a worker, applied by the writer.

The worker evaluates an update on a snapshot. A result that depends on the state of the map is
applied only if the map has not changed since; otherwise it is evaluated again (optimistic
concurrency control). The last attempt makes other writers wait for a limited time.
"""

from __future__ import annotations

import base64
import re
from collections.abc import Callable, Iterable, Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, Self

from pyoxigraph import Quad, RdfFormat, parse

from kg.maps.stored_map import StoredMap
from kg.maps.update.change_draft import GroundUpdate, why_unchanged
from kg.model.errors import ConflictError, OntologyError, QueryError, ShapeError
from kg.model.transactions import ChangeSet
from kg.serving.workers.pool import QueryPool
from kg.serving.workers.process import WorkerProcess, settings_of
from kg.serving.workers.request import WorkerCall

ATTEMPTS: Final = 3  # evaluations without a lock
HELD: Final = 1.0  # [s] of an evaluation with the lock of the writer; validation needs some, too


@dataclass(frozen=True, slots=True)
class UpdateRequest:
    """A SPARQL Update of a client; the graphs are parameters of the protocol."""

    sparql: str
    using: Sequence[str] = ()  # using-graph-uri
    using_named: Sequence[str] = ()  # using-named-graph-uri


def update_map(
    pool: QueryPool,
    semantic_map: StoredMap,
    request: UpdateRequest,
    *,
    by: str | None,
    confirmed: bool = False,
    explain: Callable[[str], object] | None = None,
) -> ChangeSet | None:
    """Evaluate an update in a worker and apply it as one transaction; None without changes.

    `explain` is called with the reason why an update deleted nothing, if it changed nothing.
    Raises as `SemanticMap.update`, and QueryTimeoutError or QueryTooLargeError at the limits of the
    pool.
    """
    semantic_map.store.check_writable()
    for attempt in range(ATTEMPTS + 1):
        last = attempt == ATTEMPTS
        with semantic_map.hold() if last else nullcontext():
            update, sequence = _evaluated(pool, semantic_map, request, HELD if last else None)
            check = partial(_check_unchanged, semantic_map, sequence) if update.reads else None
            with suppress(StaleError):
                change = semantic_map.apply_ground(
                    update, request.sparql, by=by, confirmed=confirmed, check=check
                )
                if change is None and explain is not None:
                    explain(why_unchanged(update, semantic_map.engine))
                return change
    raise ConflictError("others write faster than this update is evaluated; try again later")


class StaleError(ConflictError):
    """Others wrote since an update was evaluated: it is evaluated again."""


def _check_unchanged(semantic_map: StoredMap, sequence: int) -> None:
    if sequence != semantic_map.sequence:
        raise StaleError(f"the map is at #{semantic_map.sequence}, not at #{sequence}")


def _evaluated(
    pool: QueryPool, semantic_map: StoredMap, request: UpdateRequest, timeout: float | None
) -> tuple[GroundUpdate, int]:
    """The evaluated update, and the number of the transaction of its snapshot."""
    least = semantic_map.sequence
    body: dict[str, Any] = {
        "name": "update",
        "sparql": request.sparql,
        "base_iri": semantic_map.base,
        "default_graphs": list(request.using),
        "named_graphs": list(request.using_named),
        "least": least,
    }
    try:
        # an update of data alone needs no new snapshot
        answer = pool.answer(WorkerCall(b"U", body, timeout=timeout))
    except ConflictError:
        answer = pool.answer(WorkerCall(b"U", body, timeout=timeout, at_least=least))
    return GroundUpdate.decode(dict(answer.details), answer.body), answer.sequence


def parsed_document(pool: QueryPool, body: bytes, form: RdfFormat, base: str) -> list[Quad]:
    """The quads of an RDF document, parsed in a worker.

    Raises QueryError for a document that does not parse, ShapeError for triple terms.
    """
    request = {
        "name": "the body",
        "form": form.media_type,
        "base_iri": base,
        "body": base64.b64encode(body).decode("ascii"),
    }
    return list(parse(pool.answer(WorkerCall(b"L", request)).body, format=RdfFormat.N_QUADS))


SECONDS: Final = 60.0  # for one document
MEMORY: Final = 1024  # [MB]
RESULT: Final = 1 << 30  # [bytes] of N-Quads
_LINE: Final = re.compile(r"at line (\d+)")


class IsolatedParser:
    """Parses one document at a time; a `kg.rdf.parsing.Parse` and a context manager."""

    def __init__(self) -> None:
        self._worker: WorkerProcess | None = None

    def __call__(self, data: bytes, form: RdfFormat) -> Iterable[Quad]:
        """The quads; raises SyntaxError with the line, OntologyError if the worker ends."""
        if self._worker is None or not self._worker.alive:
            self.close()
            self._worker = WorkerProcess(settings_of(MEMORY))
        request = {
            "form": form.media_type,
            "base_iri": None,
            "body": base64.b64encode(data).decode("ascii"),
            "max_bytes": RESULT,
        }
        try:
            answer = self._worker.ask(request, SECONDS, b"L")
        except (QueryError, ShapeError) as error:
            raise _as_syntax_error(error) from error
        return parse(answer.body, format=RdfFormat.N_QUADS)

    def close(self) -> None:
        """End the worker."""
        if self._worker is not None:
            self._worker.close()
            self._worker = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def _as_syntax_error(error: QueryError | ShapeError) -> Exception:
    message = str(error).removeprefix("the query cannot be answered: ")
    if type(error) is not QueryError:
        return OntologyError(message)
    # as the parser raises it in its own process
    found, line = SyntaxError(re.sub(r" \(line \d+\)$", "", message)), _LINE.search(message)
    found.lineno = int(line[1]) if line else None
    return found
