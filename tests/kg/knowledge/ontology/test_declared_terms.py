"""A misspelt term of a query is named, with what it may be."""

from __future__ import annotations

import pytest

from hereabouts.cli import main
from kg.knowledge.ontology.declared_terms import absent_terms
from kg.serving.opening import in_memory_map


@pytest.mark.parametrize(
    ("query", "lines"),
    [
        ("SELECT ?x { ?x a here:Cup ; rdfs:label ?e }", ()),
        (
            "SELECT ?x { ?x a here:Cup ; here:existence ?e }",
            ("no statement of the map has the property here:existence",),
        ),
        ("SELECT ?x { ?x geo:hasGeometry ?g }", ("has geo:hasGeometry, though exports may",)),
        ("ASK { GRAPH graph:mpa { ?x a here:Cup } }", ("no graph graph:mpa; it has graph:",)),
        ("ASK { GRAPH graph:ontology { ?x a owl:Class } }", ()),
        ("PREFIX h: <https://w3id.org/hereabouts#> ASK { ?x a h:Cpu }", ("mean here:Cup",)),
        ("ASK { ?x a <http://w3id.org/hereabouts#Cup> }", ("mean here:Cup",)),
        ("ASK { ?x rdfs:lable ?y }", ("mean rdfs:label",)),
        ("ASK { ?x rdfs:label ?y FILTER(geof:sfWithin(?y, '1'^^xsd:decimal)) }", ()),
        ("PREFIX e: <urn:e:> ASK { ?x e:foo 1 }", ("no statement of the map has <urn:e:foo>",)),
        (
            "SELECT ?x { ?x a here:Cupp }",
            ("no ontology declares here:Cupp; did you mean here:Cup",),
        ),
        ("ASK { ?x <https://w3id.org/hereabouts#existance> 1 }", ("here:existance; did you mean",)),
        ("ASK { ?x here:qqqq here:qqqq }", ("no ontology declares here:qqqq",)),
        ("ASK { ?x rdfs:label 'here:Cupp' # here:Cupp\n }", ()),
    ],
)
def test_what_no_ontology_declares_is_named(query: str, lines: tuple[str, ...]) -> None:
    with in_memory_map() as semantic_map:
        found = absent_terms(query, semantic_map.engine)
    assert len(found) == len(lines)
    for line, start in zip(found, lines, strict=True):
        assert start in line


def test_ask_warns_and_takes_variables_as_parameters(
    tmp_path, capsys: pytest.CaptureFixture[str]
) -> None:
    from kg.serving.opening import create_map
    from tests.planner.flat import fill

    with create_map(tmp_path / "flat.map") as semantic_map:
        fill(semantic_map)
    path = str(tmp_path / "flat.map")
    assert main(["ask", path, "-e", "SELECT ?x { ?x a here:Cupp }"]) == 0
    assert "did you mean here:Cup" in capsys.readouterr().err
    query = "SELECT ?x ?c { ?x a ?c ; here:existence ?e }"
    assert main(["ask", path, "-e", query, "-p", "c=here:Cup"]) == 0
    out, err = capsys.readouterr()
    assert "1 row" in err
    assert "here:Cup" in out
    assert main(["ask", path, "-e", query, "-p", "kind=here:Cup"]) == 1
    assert "neither $kind nor ?kind is used" in capsys.readouterr().err
    assert main(["find", "banana", path]) == 1
    assert f"the map comes first: hereabouts find {path}" in capsys.readouterr().err
