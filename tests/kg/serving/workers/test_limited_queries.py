"""Queries of strangers on maps in memory and on servers, within limits."""

import pytest

from kg.model.errors import QueryError, QueryRefusedError, QueryTimeoutError, QueryTooLargeError
from kg.serving.opening import in_memory_map, open_map
from kg.serving.workers.local_evaluation import LimitedQueries
from tests.conftest import publish

COUNT = "SELECT (COUNT(*) AS ?n) { GRAPH graph:dataset { ?map a here:SemanticMap } }"
PRODUCT = "SELECT (COUNT(*) AS ?n) { ?a ?b ?c . ?d ?e ?f . ?g ?h ?i }"
REFUSED = (
    "INSERT DATA { <a> <b> <c> }",
    "DELETE WHERE { ?s ?p ?o }",
    "SELECT * { SERVICE <http://127.0.0.1:9/> { ?s ?p ?o } }",
)


def test_a_map_in_memory_is_asked_by_workers_with_limits() -> None:
    with in_memory_map() as semantic_map:
        with LimitedQueries(semantic_map, seconds=0.5, result=1000) as queries:
            assert queries.ask(COUNT).rows == ((1,),)
            assert len(queries.ask("CONSTRUCT { <a> <b> 1 } {}").rows) == 1
            with pytest.raises(QueryTimeoutError):
                queries.ask(PRODUCT)
            with pytest.raises(QueryTooLargeError):
                queries.ask("SELECT * { ?s ?p ?o }")
            for text in REFUSED:
                with pytest.raises(QueryRefusedError):
                    queries.ask(text)
            with pytest.raises(QueryError):
                queries.ask("SELECT * {")
        queries.close()  # once more


def test_a_map_on_a_server_is_asked_there(sparql_server: str) -> None:
    with in_memory_map() as local:
        publish(local, sparql_server)
    with (
        open_map(sparql_server, read_only=True) as semantic_map,
        LimitedQueries(semantic_map, result=1000) as queries,
    ):
        assert queries.ask(COUNT).rows == ((1,),)
        assert len(queries.ask("CONSTRUCT { <a> <b> 1 } {}").rows) == 1
        with pytest.raises(QueryTooLargeError):
            queries.ask("SELECT * { ?s ?p ?o }")
        for text in REFUSED:
            with pytest.raises(QueryRefusedError):
                queries.ask(text)
        with pytest.raises(QueryError):
            queries.ask("SELECT * {")
