"""Shapes: what is found does not depend on how property shapes are handed to the validator."""

from pathlib import Path

from pyoxigraph import NamedNode, Quad

from kg.rdf.shacl import Shapes

NAME = "https://example.org/"
SHAPES = """
@prefix sh: <http://www.w3.org/ns/shacl#> .
@prefix ex: <https://example.org/> .
ex:House a sh:NodeShape ; sh:targetClass ex:House ; sh:property ex:owned .
ex:Boat a sh:NodeShape ; sh:targetClass ex:Boat ; sh:property ex:owned ;
    sh:property [ sh:path ex:anchor ; sh:minCount 1 ;
        sh:severity sh:Warning ; sh:message "anchor" ] .
ex:HouseBoat a sh:NodeShape ; sh:targetClass ex:HouseBoat ; sh:node ex:Boat ; sh:message "boat" .
ex:owned a sh:PropertyShape ; sh:path ex:owner ; sh:minCount 1 ; sh:message "owner" .
"""


def found(folder: Path, *triples: str) -> set[tuple[str, str, str]]:
    file = folder / "shapes.ttl"
    file.write_text(SHAPES, "utf-8")
    words = (triple.replace(" a ", " type ").split() for triple in triples)
    kind = NamedNode("http://www.w3.org/1999/02/22-rdf-syntax-ns#type")
    quads = [
        Quad(NamedNode(NAME + s), kind if p == "type" else NamedNode(NAME + p), NamedNode(NAME + o))
        for s, p, o in words
    ]
    findings = Shapes(file).validate(quads, [f"{NAME}{s}" for s in ("one", "two")])
    return {(f.focus.removeprefix(NAME), f.message, f.severity) for f in findings}


def test_a_property_shape_of_two_node_shapes_is_checked_for_both(tmp_path: Path) -> None:
    both = found(tmp_path, "one a House", "two a Boat", "two anchor iron", "three a House")
    assert both == {("one", "owner", "violation"), ("two", "owner", "violation")}
    assert found(tmp_path, "one a House", "one owner me") == set()


def test_a_shape_that_another_refers_to_keeps_its_properties(tmp_path: Path) -> None:
    assert found(tmp_path, "one a HouseBoat", "one owner me") == {("one", "boat", "violation")}
    assert found(tmp_path, "one a Boat", "one owner me") == {("one", "anchor", "warning")}
