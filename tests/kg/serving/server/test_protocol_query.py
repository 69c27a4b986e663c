"""The SPARQL 1.1 Protocol's query operation, case by case as its specification has them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
import rdflib
from pyoxigraph import Literal, NamedNode, RdfFormat, Triple, parse

if TYPE_CHECKING:
    from collections.abc import Callable

    from conftest import Served

ASK = "ASK {}"
CUPS = "SELECT ?cup WHERE { GRAPH graph:map { ?cup a here:Cup } }"
CUP = "https://example.org/maps/flat/object/1"
QUERY = "application/sparql-query"
FORM = "application/x-www-form-urlencoded"
MAP = "https://w3id.org/hereabouts/graph/map"
ONTOLOGY = "https://w3id.org/hereabouts/graph/ontology"
DATASET = "https://w3id.org/hereabouts/graph/dataset"


def truth(answer: object) -> bool:
    assert answer.status_code == 200, answer.text  # type: ignore[attr-defined]
    return bool(answer.json()["boolean"])  # type: ignore[attr-defined]


def test_query_posted_directly_with_a_charset(lasting: Served) -> None:
    kind = f"{QUERY}; charset=UTF-8"
    query = 'ASK { FILTER(STRLEN("tür") = 3) }'.encode()
    assert truth(lasting.post("sparql", data=query, headers={"Content-Type": kind}))


def test_graphs_of_the_request_outrank_those_of_the_query(lasting: Served) -> None:
    query = f"ASK FROM <{ONTOLOGY}> {{ ?s a here:Cup }}"
    assert truth(lasting.get("sparql", params={"query": query, "default-graph-uri": MAP}))
    assert not truth(lasting.get("sparql", params={"query": query}))


def test_without_graphs_the_default_graph_is_the_union(lasting: Served) -> None:
    query = "ASK { ?cup a here:Cup . here:Cup rdfs:label ?label . ?map a here:SemanticMap }"
    assert truth(lasting.get("sparql", params={"query": query}))


@pytest.mark.parametrize(
    ("kind", "form"),
    [
        ("text/turtle", "turtle"),
        ("application/n-triples", "nt"),
        ("application/rdf+xml", "xml"),
        ("application/ld+json", "json-ld"),
        ("application/trig", "trig"),
        ("application/n-quads", "nquads"),
    ],
)
@pytest.mark.parametrize(
    "query", [f"DESCRIBE <{CUP}>", "CONSTRUCT { ?s ?p ?o } WHERE { ?s a here:Cup ; ?p ?o }"]
)
def test_triples_in_every_format(lasting: Served, query: str, kind: str, form: str) -> None:
    answer = lasting.get("sparql", params={"query": query}, headers={"Accept": kind})
    assert answer.headers["Content-Type"].partition(";")[0] == kind
    if form in ("trig", "nquads", "json-ld"):
        told = {
            quad.triple for quad in parse(answer.content, format=RdfFormat.from_media_type(kind))
        }
        assert Triple(NamedNode(CUP), NamedNode(str(rdflib.RDFS.label)), Literal("cup 1")) in told
        return
    labels = list(
        rdflib.Graph()
        .parse(data=answer.text, format=form)
        .objects(rdflib.URIRef(CUP), rdflib.RDFS.label)
    )
    assert labels == [rdflib.Literal("cup 1")]


def test_format_that_does_not_exist_is_not_acceptable(lasting: Served) -> None:
    answer = lasting.get("sparql", params={"query": CUPS}, headers={"Accept": "image/png"})
    assert answer.status_code == 406
    assert "sparql-results+json" in answer.text


@pytest.mark.parametrize("method", ["PUT", "DELETE", "PATCH"])
def test_query_by_another_method_is_not_allowed(lasting: Served, method: str) -> None:
    answer = lasting.request(method, "sparql", params={"query": ASK})
    assert answer.status_code == 405
    assert "POST" in answer.headers["Allow"]


def test_two_queries_are_refused(lasting: Served) -> None:
    assert lasting.get("sparql", params={"query": [ASK, "SELECT * {}"]}).status_code == 400
    assert lasting.post("sparql", data={"query": [ASK, ASK]}).status_code == 400
    headers = {"Content-Type": QUERY}
    both = lasting.post("sparql", params={"query": ASK}, data=ASK, headers=headers)
    assert both.status_code == 400


@pytest.mark.parametrize("kind", [QUERY, FORM])
def test_query_that_is_not_utf_8_is_refused(lasting: Served, kind: str) -> None:
    body = 'ASK { ?s ?p "tür" }'.encode("latin-1")
    if kind == FORM:
        body = b"query=ASK%20%7B%20%3Fs%20%3Fp%20%22t%FCr%22%20%7D"
    answer = lasting.post("sparql", data=body, headers={"Content-Type": kind})
    assert answer.status_code == 400
    assert "UTF-8" in answer.text


@pytest.mark.parametrize(
    "query", ["SELECT nothing", "", "ASK { ?s ?p", "\x00", "ASK { ?s a nix:x }"]
)
def test_query_that_does_not_parse_is_refused_in_one_line(lasting: Served, query: str) -> None:
    answer = lasting.get("sparql", params={"query": query})
    assert answer.status_code == 400
    assert answer.headers["Content-Type"].startswith("text/plain")
    assert answer.text.count("\n") == 1


def test_refusal_is_a_json_problem_for_who_takes_json(lasting: Served) -> None:
    answer = lasting.get(
        "sparql", params={"query": "nothing"}, headers={"Accept": "application/json"}
    )
    assert answer.status_code == 400
    assert answer.headers["Content-Type"] == "application/problem+json"
    assert answer.json()["status"] == 400
    assert answer.json()["detail"]


def test_update_as_a_query_is_refused_and_changes_nothing(lasting: Served) -> None:
    before = lasting.map.sequence
    for update in ("CLEAR ALL", "DELETE WHERE { ?s ?p ?o }", "# SELECT\nDROP ALL"):
        answer = lasting.post("sparql", data={"query": update})
        assert answer.status_code == 400, update
    assert lasting.map.sequence == before
    assert lasting.rows(CUPS)


def test_a_service_that_is_allowed_is_asked_and_no_other(serve: Callable[..., Served]) -> None:
    far = serve()
    near = serve(services=(far.url + "sparql",))
    query = "SELECT ?cup {{ SERVICE <{}> {{ GRAPH graph:map {{ ?cup a here:Cup }} }} }}"
    assert near.rows(query.format(far.url + "sparql")) == far.rows(CUPS) != []
    refused = near.get("sparql", params={"query": query.format(far.url + "health")})
    assert refused.status_code == 400 and f"allowed are: {far.url}sparql" in refused.text
    assert "BasicFederatedQuery" in near.get("sparql").text
    assert "BasicFederatedQuery" not in far.get("sparql").text
