"""Untrusted queries on any open map, within limits: in isolated workers or on its server."""

from __future__ import annotations

import threading
from typing import Final, Self

from kg.maps.query.evaluation import Table
from kg.maps.semantic_map import SemanticMap
from kg.rdf.sparql.subclass_inference import superclasses_of, with_subclasses
from kg.rdf.sparql.vetting import check_length, check_unicode, vet
from kg.serving.workers.local_evaluation import ACCEPTED, table_of, table_of_answer
from kg.serving.workers.pool import QueryPool
from kg.store.sparql_backend import SparqlBackend

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
        sparql = with_subclasses(sparql, superclasses_of(engine))
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
