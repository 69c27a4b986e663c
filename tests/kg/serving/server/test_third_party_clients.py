"""Clients that nobody here wrote, unmodified, against a running server."""

from __future__ import annotations

import json
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

import pytest
import rdflib
from memento_client import MementoClient
from rdflib.plugins.stores.sparqlstore import SPARQLStore, SPARQLUpdateStore
from SPARQLWrapper import CSV, GET, JSON, JSONLD, N3, POST, RDFXML, TSV, TURTLE, XML, SPARQLWrapper

from kg.model import vocabulary as v

if TYPE_CHECKING:
    from conftest import Served

BASE = "https://example.org/maps/flat/"
LABELS = "SELECT ?label WHERE { ?o a here:Cup ; rdfs:label ?label }"


@pytest.fixture
def wrapper(lasting: Served) -> SPARQLWrapper:
    wrapper = SPARQLWrapper(f"{lasting.url}sparql")
    wrapper.addCustomHttpHeader("Authorization", lasting.bearer()["Authorization"])
    return wrapper


@pytest.mark.parametrize("method", [GET, POST])
@pytest.mark.parametrize(
    ("form", "media_type"),
    [
        (JSON, "application/sparql-results+json"),
        (XML, "application/sparql-results+xml"),
        (CSV, "text/csv"),
        (TSV, "text/tab-separated-values"),
        (TURTLE, "text/turtle"),
        (N3, "text/n3"),
        (RDFXML, "application/rdf+xml"),
        (JSONLD, "application/ld+json"),
    ],
)
def test_sparqlwrapper_reads_each_of_its_formats(wrapper, form, media_type, method):
    is_table = form in (JSON, XML, CSV, TSV)
    wrapper.setQuery(
        LABELS if is_table else "CONSTRUCT WHERE { ?o a here:Cup ; rdfs:label ?label }"
    )
    wrapper.setReturnFormat(form)
    wrapper.setMethod(method)
    answer = wrapper.query()
    assert answer.response.headers["Content-Type"].partition(";")[0] == media_type
    assert "cup 1" in answer.response.read().decode()


def test_sparqlwrapper_constructs_and_updates(wrapper: SPARQLWrapper) -> None:
    thing = f"{BASE}thing/of-wrapper"
    wrapper.setMethod(POST)
    wrapper.setQuery(f'INSERT DATA {{ <{thing}> <urn:p> "one" }}')
    assert json.loads(wrapper.query().response.read())["added"] == 1
    wrapper.setQuery("CONSTRUCT { ?s <urn:q> ?o } WHERE { ?s <urn:p> ?o }")
    wrapper.setReturnFormat(TURTLE)
    graph = rdflib.Graph().parse(data=wrapper.query().convert(), format="turtle")
    assert (rdflib.URIRef(thing), rdflib.URIRef("urn:q"), rdflib.Literal("one")) in graph


@pytest.fixture
def store(lasting: Served) -> Iterator[SPARQLUpdateStore]:
    end = f"{lasting.url}sparql"
    yield SPARQLUpdateStore(end, end, headers=lasting.bearer(), context_aware=True)


def test_rdflib_reads_and_writes_a_graph(lasting: Served, store: SPARQLUpdateStore) -> None:
    graph = rdflib.Graph(store, identifier=rdflib.URIRef("urn:graph:of-rdflib"))
    fact = (rdflib.URIRef(f"{BASE}thing/1"), rdflib.RDFS.label, rdflib.Literal("mine", lang="en"))
    graph.add(fact)
    assert list(graph) == [fact]
    graph.remove(fact)
    assert len(graph) == 0


def test_rdflib_queries_and_looks_up(lasting: Served) -> None:
    graph = rdflib.Graph(SPARQLStore(f"{lasting.url}sparql"))
    assert [str(row.label) for row in graph.query(LABELS)] == ["cup 1"]
    cup = rdflib.URIRef(f"{BASE}object/1")
    kinds = set(graph.objects(cup, rdflib.RDF.type))
    assert {rdflib.URIRef(v.HERE + kind) for kind in ("Cup", "Object")} <= kinds


@pytest.mark.parametrize("start", ["object/1", "object/1?at=1"])
def test_the_memento_client_finds_versions(lasting: Served, start: str) -> None:
    with MementoClient(timegate_uri=f"{lasting.url}timegate/") as client:
        now = datetime.now(UTC).replace(tzinfo=None) + timedelta(days=1)
        found = client.get_memento_info(lasting.url + start, now)
    assert found["original_uri"] == f"{lasting.url}object/1"
    closest = found["mementos"]["closest"]
    assert closest["uri"] == [f"{lasting.url}object/1?at=1"]
    assert closest["http_status_code"] == 200
    assert closest["datetime"] is not None
