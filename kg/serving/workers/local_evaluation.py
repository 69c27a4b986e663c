"""Queries and updates of the command line, evaluated in an isolated worker.

The text may come from an untrusted source. So, as on a server, a separate process without network
evaluates it; a failure of the engine ends that process only. The limits prevent a mistake from
using all resources of the machine.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final

from pyoxigraph import QueryResultsFormat, RdfFormat, parse, parse_query_results

from kg.history.timestamps import Instant, sequence_of
from kg.maps.query.evaluation import Table, answer_of
from kg.maps.query.query_files import ParameterizedQuery
from kg.maps.semantic_map import SemanticMap
from kg.maps.stored_map import StoredMap
from kg.model.errors import QueryError
from kg.model.transactions import ChangeSet
from kg.serving.workers.pool import QueryPool
from kg.serving.workers.process import Answer
from kg.serving.workers.request import request_of
from kg.serving.workers.updates import UpdateRequest, update_map
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
) -> Table:
    """The answer to a query on a map in a folder, at present or at a past instant.

    Raises as `SemanticMap.query`, and QueryTimeoutError, QueryTooLargeError or EngineFailureError
    where the worker ends.
    """
    sequence = None if at is None else sequence_of(semantic_map.history.log, at)
    then = semantic_map if at is None else semantic_map.at(at)
    sparql = question.bind(parameters, then.resolve)
    request = request_of(sparql, {"accept": ACCEPTED, "base": semantic_map.base})
    with _pool(semantic_map) as pool:
        answer = pool.request(b"Q", request | {"name": question.name}, at=sequence)
    return question.check(table_of_answer(answer))


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
