"""What Virtuoso says, as its answers were recorded, and what it is told."""

from __future__ import annotations

import json

import pytest
from pyoxigraph import BlankNode, Literal, NamedNode, Quad, QueryResultsFormat, parse_query_results

from kg.model import vocabulary as v
from kg.store.virtuoso import (
    complaint,
    gives_triples,
    is_virtuoso,
    plain,
    readable,
)

RDFS_LABEL = NamedNode(v.RDFS_LABEL)


def cell(value: str, kind: str) -> dict[str, str]:
    return {"type": "typed-literal", "datatype": v.XSD + kind, "value": value}


def test_results_are_read_as_they_were_written() -> None:
    row = {
        "d": cell("1000000000", "double"),
        "small": cell("1e-07", "double"),
        "b": cell("1", "boolean"),
        "n": {"type": "bnode", "value": "nodeID://b10001"},
        "i": cell("3", "integer"),
        "l": {"type": "literal", "xml:lang": "en", "value": "nodeID://b10001"},
    }
    told = {"head": {"link": [], "vars": [*row]}, "results": {"bindings": [row]}}
    body = readable(json.dumps(told).encode())
    (found,) = parse_query_results(body, format=QueryResultsFormat.JSON)
    assert [found[name] for name in row] == [
        *(Literal(1e9), Literal(1e-7), Literal(True), BlankNode("b10001")),
        *(Literal(3), Literal("nodeID://b10001", language="en")),
    ]


def test_a_yes_stays_a_yes() -> None:
    assert json.loads(readable(b'{"head": {"link": []}, "boolean": true}'))["boolean"] is True


@pytest.mark.parametrize("value", [Literal(0.25), Literal("a"), Literal("a", language="en")])
def test_triples_keep_their_terms(value: Literal) -> None:
    triple = Quad(RDFS_LABEL, RDFS_LABEL, value).triple
    assert plain(triple) == triple


def test_only_construct_and_describe_give_triples() -> None:
    assert gives_triples('PREFIX x: <http://select/> # ask\nCONSTRUCT { ?s ?p "select" } WHERE {}')
    assert gives_triples("DESCRIBE <urn:select>")
    assert not gives_triples("BASE <urn:construct> SELECT ?describe {}")
    assert not gives_triples("ASK { ?s ?p 'describe' }")


def test_a_complaint_names_the_line_and_not_the_query() -> None:
    said = (
        "Virtuoso 37000 Error SP030: SPARQL compiler, line 2: syntax error\n\nSPARQL query:\nASK {"
    )
    assert complaint(said) == "error at 2:1: syntax error"
    assert complaint("Virtuoso 42000 Error SR186:  no permission") == (
        "Virtuoso 42000 Error SR186: no permission"
    )


def test_it_is_known_by_its_name() -> None:
    assert is_virtuoso("Virtuoso/07.20.3229 (Linux) x86_64-pc-linux-gnu  ")
    assert not is_virtuoso("Oxigraph/0.5.0")
    assert not is_virtuoso(None)
