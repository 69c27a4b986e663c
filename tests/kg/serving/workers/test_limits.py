"""Requests that would kill or freeze a server: refused or ended, while everybody else is served."""

import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from pyoxigraph import RdfFormat

from benchmarks.attack.exhaustion import document_bombs, runaway
from benchmarks.attack.target import Target
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import HereaboutsError, QueryError, QueryRefusedError, QueryTimeoutError
from kg.serving.opening import in_memory_map
from kg.serving.workers.pool import QueryPool
from kg.serving.workers.updates import UpdateRequest, parsed_document, update_map

NEST = 20_000


@pytest.fixture(scope="module")
def home() -> Iterator[SemanticMap]:
    with in_memory_map() as made:
        yield made


@pytest.fixture(scope="module")
def pool(home: SemanticMap) -> Iterator[QueryPool]:
    with QueryPool(home, workers=3, timeout=3, memory_mb=300) as made:
        yield made


@pytest.mark.parametrize("number", range(len(document_bombs())))
def test_a_document_that_would_take_all_memory_or_stack_is_refused(pool, number):
    kind, body = document_bombs()[number]
    form = RdfFormat.from_media_type(kind)
    assert form is not None
    with pytest.raises(HereaboutsError) as caught:
        found = parsed_document(pool, body, form, "urn:graph")
        # what parses is ground, and no longer than the document
        assert len(found) <= 2 * NEST + 1
        raise QueryError("parsed")
    assert str(caught.value)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "utf-16-be"])
def test_a_document_type_is_refused_in_any_encoding(pool: QueryPool, encoding: str) -> None:
    text = "<?xml version='1.0'?><!DOCTYPE r [<!ENTITY a 'b'>]><r/>"
    with pytest.raises(QueryRefusedError, match="DOCTYPE"):
        parsed_document(pool, text.encode(encoding), RdfFormat.RDF_XML, "urn:graph")


@pytest.mark.parametrize(
    "sparql",
    [
        "INSERT {} WHERE " + "{" * NEST + "}" * NEST,
        "INSERT DATA { <urn:a> <urn:b> "
        + "<<( <urn:a> <urn:b> " * NEST
        + "1 "
        + ")>> " * NEST
        + "}",
        "INSERT { ?a ?b ?c } WHERE { ?a ?b ?c FILTER(" + "(" * NEST + "1",
    ],
)
def test_a_deeply_nested_update_is_refused(home: SemanticMap, pool: QueryPool, sparql: str) -> None:
    with pytest.raises(QueryRefusedError, match="nest"):
        update_map(pool, home, UpdateRequest(sparql), by=None)


def test_a_runaway_update_is_ended_and_others_write_meanwhile(home, pool):
    errors: list[Exception] = []

    def run() -> None:
        try:
            update_map(pool, home, UpdateRequest(runaway()), by=None)
        except QueryTimeoutError as error:
            errors.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    written = []
    while thread.is_alive() and len(written) < 20:
        insert = f"INSERT DATA {{ GRAPH <urn:n> {{ <urn:n> <urn:is> {len(written)} }} }}"
        written.append(update_map(pool, home, UpdateRequest(insert), by=None))
        assert b"true" in pool.run("ASK {}").body
        time.sleep(0.05)
    thread.join()
    assert len(errors) == 1
    assert len(written) >= 5
    assert None not in written


def test_updates_that_read_what_others_write_meanwhile_lose_nothing(home, pool):
    home.update("INSERT DATA { GRAPH <urn:count> { <urn:counter> <urn:is> 0 } }")
    increment = (
        "WITH <urn:count> DELETE { <urn:counter> <urn:is> ?n } "
        "INSERT { <urn:counter> <urn:is> ?m } "
        "WHERE { <urn:counter> <urn:is> ?n BIND(?n + 1 AS ?m) }"
    )

    def count() -> None:
        for _ in range(5):
            update_map(pool, home, UpdateRequest(increment), by=None)

    threads = [threading.Thread(target=count) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert home.query("SELECT ?n { <urn:counter> <urn:is> ?n }").rows == ((15,),)


def test_an_update_of_several_operations_sees_its_own_changes(home, pool):
    sparql = (
        "INSERT DATA { GRAPH <urn:one> { <urn:a> <urn:b> 1 } } ; "
        "INSERT { GRAPH <urn:two> { ?s ?p ?o } } WHERE { GRAPH <urn:one> { ?s ?p ?o } } ; "
        "MOVE <urn:two> TO <urn:three>"
    )
    update_map(pool, home, UpdateRequest(sparql), by=None)
    found = home.query("SELECT ?g { GRAPH ?g { <urn:a> <urn:b> 1 } } ORDER BY ?g").rows
    assert found == (("urn:one",), ("urn:three",))


def test_sigterm_ends_a_server_in_the_middle_of_a_runaway_update(tmp_path: Path) -> None:
    with Target(tmp_path) as target:
        thread = threading.Thread(target=target.update, args=(runaway(),))
        thread.start()
        thread.join(0.5)
        assert target.ends_when_told(60)
        thread.join()
        assert target.lost() == 0
