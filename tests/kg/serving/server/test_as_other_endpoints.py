"""What users of other SPARQL endpoints expect: `format=`, FROM of any IRI, blank nodes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
import rdflib
from pyoxigraph import RdfFormat, parse

from kg.model import vocabulary as v

if TYPE_CHECKING:
    from conftest import Served

BASE = "https://example.org/maps/flat/"
TABLE = "SELECT ?label { ?o a here:Cup ; rdfs:label ?label }"
GRAPH = "CONSTRUCT { ?o rdfs:label ?label } { ?o a here:Cup ; rdfs:label ?label }"


@pytest.mark.parametrize(
    ("query", "name", "media_type"),
    [
        (TABLE, "csv", "text/csv"),
        (TABLE, "TSV", "text/tab-separated-values"),
        (TABLE, "json", "application/sparql-results+json"),
        (TABLE, "xml", "application/sparql-results+xml"),
        (TABLE, "application/sparql-results+xml", "application/sparql-results+xml"),
        (TABLE, "text/csv", "text/csv"),
        ("ASK {}", "json", "application/sparql-results+json"),
        (GRAPH, "ttl", "text/turtle"),
        (GRAPH, "turtle", "text/turtle"),
        (GRAPH, "n-triples", "application/n-triples"),
        (GRAPH, "json", "application/ld+json"),
        (GRAPH, "xml", "application/rdf+xml"),
        (GRAPH, "rdf/xml", "application/rdf+xml"),
    ],
)
@pytest.mark.parametrize("how", ["format", "output"])
def test_a_format_is_named_by_a_parameter(lasting, query, name, media_type, how):
    asked = {"query": query, how: name}
    for answer in (
        lasting.get("sparql", params=asked, headers={"Accept": "text/html"}),
        lasting.post("sparql", data=asked),
    ):
        assert answer.status_code == 200, answer.text
        assert answer.headers["Content-Type"].partition(";")[0] == media_type


def test_an_unknown_format_is_refused_with_those_there_are(lasting: Served) -> None:
    answer = lasting.get("sparql", params={"query": TABLE, "format": "ods"})
    assert (answer.status_code, "csv" in answer.text) == (400, True)
    many = {"query": TABLE, "format": ["csv"] * 9}
    assert lasting.get("sparql", params=many).status_code == 400


@pytest.mark.parametrize(
    ("names", "media_type"),
    [
        (["ods", "csv"], "text/csv"),
        (["csv", "json"], "text/csv"),
        (["turtle", "tsv"], "text/tab-separated-values"),
        (["text/html,text/csv"], "text/csv"),
    ],
)
def test_of_several_formats_the_first_that_can_be_written_counts(lasting, names, media_type):
    answer = lasting.get("sparql", params={"query": TABLE, "format": names})
    assert answer.headers["Content-Type"].partition(";")[0] == media_type


@pytest.mark.parametrize("path", ["object/1", "", "sparql", ".well-known/void"])
def test_documents_have_the_parameter_too(lasting: Served, path: str) -> None:
    answer = lasting.get(path, params={"format": "nt"}, headers={"Accept": "text/html"})
    assert answer.headers["Content-Type"].startswith("application/n-triples")


@pytest.mark.parametrize(
    "path",
    [
        *("object/1", "", "sparql", ".well-known/void", "graphs/map", "graphs?default"),
        *("object/1?at=1", "resource?iri=https://w3id.org/hereabouts%23Cup"),
    ],
)
def test_documents_of_triples_are_json(lasting: Served, path: str) -> None:
    answer = lasting.get(path, headers={"Accept": "application/json"})
    assert (answer.status_code, answer.headers["Content-Type"]) == (200, "application/json")
    turtle = lasting.get(path, headers={"Accept": "text/turtle"})
    read, same = (
        [*parse(text, format=form, base_iri=lasting.url)]
        for text, form in ((answer.text, RdfFormat.JSON_LD), (turtle.text, RdfFormat.TURTLE))
    )
    assert len(read) == len(same) > 0


def test_each_distribution_has_its_address_and_its_media_type(lasting: Served) -> None:
    dcat = rdflib.Namespace("http://www.w3.org/ns/dcat#")
    graph = rdflib.Graph().parse(f"{lasting.url}.well-known/void", format="turtle")
    types = dict(graph.subject_objects(dcat.mediaType))
    addresses = dict(graph.subject_objects(dcat.downloadURL))
    assert len(set(addresses.values())) == len(addresses) == 4
    for distribution, address in addresses.items():
        path = str(address).removeprefix(lasting.url)
        answer = lasting.get(path, headers={"Accept": "*/*"})
        kind = answer.headers["Content-Type"].partition(";")[0]
        assert str(types[distribution]).endswith(f"/{kind}")


def holds(served: Served, query: str, **more: object) -> bool:
    answer = served.get("sparql", params={"query": query, **more})
    assert answer.status_code == 200, answer.text
    return bool(answer.json()["boolean"])


def test_a_graph_that_there_is_not_is_empty(lasting: Served) -> None:
    for clause in ("FROM <urn:unknown>", "FROM NAMED <urn:unknown>", "FROM <file:///etc/passwd>"):
        assert not holds(lasting, f"ASK {clause} {{ ?s ?p ?o }}")
    assert not holds(lasting, "ASK { ?s ?p ?o }", **{"default-graph-uri": "urn:unknown"})
    query = f"ASK FROM <urn:unknown> FROM {v.MAP_GRAPH} {{ ?s a here:Cup }}"
    assert holds(lasting, query)


def test_relative_graphs_are_resolved(lasting: Served) -> None:
    query = f"BASE <{v.GRAPH}x/> ASK FROM <../map> {{ ?s a here:Cup }}"
    assert holds(lasting, query)
    own = f"INSERT DATA {{ GRAPH <{BASE}mine> {{ <urn:a> <urn:b> <urn:c> }} }}"
    assert lasting.write(own).status_code == 200
    assert holds(lasting, "ASK FROM <mine> { <urn:a> ?p ?o }")
    assert not holds(lasting, "ASK FROM <mine> { ?s a here:Cup }")


NOTE = "SELECT ?text ?a ?b { GRAPH <urn:notes> { ?thing <urn:note> ?a . ?a <urn:text> ?text } }"


def test_blank_nodes_are_taken_in_under_names_that_dereference(lasting: Served) -> None:
    update = (
        "INSERT DATA { GRAPH <urn:notes> { <urn:1> <urn:note> _:n . _:n <urn:text> 'one' ;"
        " <urn:list> (1 2) } }"
    )
    assert lasting.write(update).status_code == 200
    (row,) = lasting.rows(NOTE)
    assert row["a"].startswith(v.GENID)
    path = row["a"].partition("w3id.org/")[2]
    page = lasting.get(path, headers={"Accept": "text/turtle"})
    assert (page.status_code, '"one"' in page.text) == (200, True)
    # each use of an update makes new ones
    assert lasting.write(update).json()["added"] > 0
    assert len({row["a"] for row in lasting.rows(NOTE)}) == 2
    assert lasting.write(f"DELETE WHERE {{ GRAPH <urn:notes> {{ <{row['a']}> ?p ?o }} }}").ok


def test_blank_nodes_of_an_upload_and_of_a_where_clause(lasting: Served) -> None:
    headers = {"Content-Type": "text/turtle", **lasting.bearer()}
    body = "[] <urn:p> [ <urn:q> 1 ] ."
    answer = lasting.request("PUT", "graphs?graph=urn:up", data=body, headers=headers)
    assert answer.status_code == 201, answer.text
    assert len(lasting.rows("SELECT * { GRAPH <urn:up> { ?s <urn:p> ?b . ?b <urn:q> 1 } }")) == 1
    back = lasting.get("graphs?graph=urn:up", headers={"Accept": "application/n-triples"})
    assert sorted(line[:2] for line in back.text.splitlines()) == ["_:", "_:"]
    update = (
        "INSERT { GRAPH <urn:up2> { ?s <urn:p> _:x . ?made <urn:q> 2 } }"
        " WHERE { GRAPH <urn:up> { ?s <urn:p> ?o } BIND(BNODE() AS ?made) }"
    )
    assert lasting.write(update).json()["added"] == 2
