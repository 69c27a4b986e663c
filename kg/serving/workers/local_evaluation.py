"""Queries and updates of the command line, evaluated in an isolated worker.

The text may come from an untrusted source. So, as on a server, a separate process without network
evaluates it; a failure of the engine ends that process only. The limits prevent a mistake from
using all resources of the machine.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final, Self

from pyoxigraph import QueryResultsFormat, RdfFormat, parse, parse_query_results

from kg.history.timestamps import Instant, sequence_of
from kg.maps.query.evaluation import Table, answer_of
from kg.maps.query.query_files import ParameterizedQuery
from kg.maps.semantic_map import SemanticMap
from kg.maps.stored_map import StoredMap
from kg.model.errors import QueryError
from kg.model.transactions import ChangeSet
from kg.rdf.sparql.vetting import check_length, check_unicode, vet
from kg.serving.workers.pool import QueryPool
from kg.serving.workers.process import Answer
from kg.serving.workers.request import query_call
from kg.serving.workers.updates import UpdateRequest, update_map
from kg.store.sparql_backend import SparqlBackend
from kg.store.sparql_client import Triples

SECONDS: Final = 3600.0
MEMORY: Final = 4096  # [MB]
RESULT: Final = 1 << 30  # [bytes]
_TRIPLES: Final = "application/n-triples"
#: the formats that `table_of` reads, as an Accept header
ACCEPTED: Final = f"application/sparql-results+json, {_TRIPLES}"


def query_isolated(
    semantic_map: SemanticMap,
    question: ParameterizedQuery,
    parameters: Mapping[str, object],
    *,
    at: Instant | None = None,
    language: str = "",
) -> Table:
    """The answer to a query on a map in a folder, at present or at a past instant.

    Raises as `SemanticMap.query`, and QueryTimeoutError, QueryTooLargeError or EngineFailureError
    where the worker ends.
    """
    sequence = None if at is None else sequence_of(semantic_map.history.log, at)
    then = semantic_map if at is None else semantic_map.at(at)
    sparql = question.bind(parameters, then.resolve, language)
    call = query_call(sparql, accept=ACCEPTED, base=semantic_map.base, at=sequence)
    call.body["name"] = question.name
    with _pool(semantic_map) as pool:
        return question.check(table_of_answer(pool.answer(call)))


def update_isolated(
    semantic_map: StoredMap,
    sparql: str,
    *,
    by: str | None,
    confirmed: bool = False,
    explain: Callable[[str], object] | None = None,
) -> ChangeSet | None:
    """Apply an update to a map in a folder; raises as `kg.serving.workers.updates.update_map`."""
    semantic_map.store.check_writable()
    with _pool(semantic_map) as pool:
        request = UpdateRequest(sparql)
        return update_map(pool, semantic_map, request, by=by, confirmed=confirmed, explain=explain)


def _pool(semantic_map: SemanticMap) -> QueryPool:
    return QueryPool(
        semantic_map, workers=1, timeout=SECONDS, memory_mb=MEMORY, max_result_bytes=RESULT
    )


def table_of_answer(answer: Answer) -> Table:
    """The answer of a worker as a table with its notes; raises as `table_of`."""
    table = table_of(answer.media_type, answer.body)
    return replace(table, notes=tuple(answer.details["notes"]))


def table_of(media_type: str, body: bytes) -> Table:
    """A serialised answer, JSON results or N-Triples, as a table.

    Raises QueryError for another or an incomplete answer.
    """
    try:
        if media_type == _TRIPLES:
            triples = parse(body, format=RdfFormat.N_TRIPLES)
            return answer_of(Triples(tuple(quad.triple for quad in triples)))
        return answer_of(parse_query_results(body, format=QueryResultsFormat.JSON))
    except (SyntaxError, ValueError) as error:
        raise QueryError(f"the answer is no {ACCEPTED}: {' '.join(str(error).split())}") from error


_WAITING: Final = 8  # queries that wait for the worker


class LimitedQueries:
    """Evaluates untrusted SPARQL on one map; a context manager, safe from several threads.

    `seconds` and `result` [bytes] limit each answer, `memory_mb` a worker. For a map in a folder or
    in memory the first query starts a `QueryPool`; a server uses its own.
    """

    def __init__(
        self,
        semantic_map: SemanticMap,
        *,
        seconds: float = 10.0,
        memory_mb: int = 512,
        result: int = 4 << 20,
    ) -> None:
        self._map, self._seconds = semantic_map, seconds
        self._memory, self._result = memory_mb, result
        self._pool: QueryPool | None = None
        self._guard = threading.Lock()

    def ask(self, sparql: str) -> Table:
        """The answer to a query.

        Raises QueryError for a query that does not parse, QueryRefusedError for a query that writes
        or reads other sources, QueryTimeoutError, QueryTooLargeError, PoolBusyError,
        and RemoteError of a server.
        """
        check_length(sparql)
        check_unicode(sparql)
        engine, base = self._map.engine, self._map.base
        if not isinstance(engine, SparqlBackend):
            return table_of_answer(self._workers().run(sparql, accept=ACCEPTED, base=base))
        vet(sparql)
        return table_of(
            *engine.fetch(sparql, (), (), base=base, seconds=self._seconds, max_bytes=self._result)
        )

    def _workers(self) -> QueryPool:
        with self._guard:
            if self._pool is None:
                self._pool = QueryPool(
                    self._map,
                    workers=1,
                    timeout=self._seconds,
                    memory_mb=self._memory,
                    max_result_bytes=self._result,
                    queue=_WAITING,
                )
            return self._pool

    def close(self) -> None:
        """End the workers; a second call does nothing."""
        with self._guard:
            if self._pool is not None:
                self._pool.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
