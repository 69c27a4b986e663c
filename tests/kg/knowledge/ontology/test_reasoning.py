"""OWL tools see the same ontology: owlready2, HermiT, and the rules of OWL 2 DL."""

from __future__ import annotations

import shutil
from collections import defaultdict

import pytest
from pyoxigraph import NamedNode, Quad

from kg.knowledge.ontology.loading import load_ontologies
from kg.knowledge.ontology.reasoning import inconsistent_classes, load_world
from kg.model import vocabulary as v

QUADS = load_ontologies().quads
OWL = v.PREFIXES["owl"]
DATATYPES = {
    v.XSD + name
    for name in (*("string", "boolean", "double", "integer", "dateTime", "base64Binary"),)
}


def test_owlready2_sees_every_category() -> None:
    world = load_world(QUADS)
    assert len(world[v.OBJECT].descendants(include_self=False)) == 80
    assert len(world[v.PLACE].descendants(include_self=False)) == 205
    above = {c for o in world[v.OBJECT].descendants(include_self=False) for c in o.ancestors()}
    above -= {c for c in above if world[v.OBJECT] in c.ancestors()}
    assert {c.name for c in above} - {"Thing"} == {"Animal", "Electronics", "Food", "Vehicle"}


def test_owlready2_reads_a_relation_with_its_probability_and_source() -> None:
    world = load_world(QUADS)
    cup, kitchen = world[v.HERE + "Cup"], world[v.HERE + "Kitchen"]
    located_at, probability = world[v.LOCATED_AT], world[v.PROBABILITY]
    assert kitchen in located_at[cup]
    assert probability[cup, located_at, kitchen] == [0.2]
    (source,) = world[v.DCT_SOURCE][cup, located_at, kitchen]
    assert "HM3D" in source


@pytest.mark.skipif(shutil.which("java") is None, reason="HermiT runs on Java, and there is none")
def test_hermit_finds_no_contradiction_but_would_find_one() -> None:
    assert inconsistent_classes(load_world(QUADS)) == ()
    both = NamedNode(v.HERE + "RoomThatIsAThing")
    contradiction = [
        Quad(both, v.RDF_TYPE, NamedNode(v.OWL_CLASS)),
        Quad(both, NamedNode(v.RDFS_SUB_CLASS_OF), NamedNode(v.OBJECT)),
        Quad(both, NamedNode(v.RDFS_SUB_CLASS_OF), NamedNode(v.PLACE)),
    ]
    assert inconsistent_classes(load_world([*QUADS, *contradiction])) == (both.value,)


def types() -> dict[str, set[str]]:
    """IRI of every declared term to the names of its OWL types."""
    found: dict[str, set[str]] = defaultdict(set)
    for q in QUADS:
        if q.predicate == v.RDF_TYPE and isinstance(q.subject, NamedNode):
            found[q.subject.value].add(q.object.value.removeprefix(OWL))
    return found


def test_every_term_has_one_kind() -> None:
    kinds = {"Class", "ObjectProperty", "DatatypeProperty", "AnnotationProperty", "Ontology"}
    for iri, declared in types().items():
        assert len(declared & kinds) == 1, iri
        assert declared <= kinds | {"FunctionalProperty", "SymmetricProperty"}, iri


def test_every_property_used_is_declared_or_part_of_owl() -> None:
    built_in = tuple(v.PREFIXES[name] for name in ("rdf", "rdfs", "owl"))
    declared = types()
    for q in QUADS:
        if not q.predicate.value.startswith(built_in):
            assert "AnnotationProperty" in declared[q.predicate.value], q


def test_annotation_properties_have_no_place_in_logic() -> None:
    annotations = {iri for iri, of in types().items() if "AnnotationProperty" in of}
    for q in QUADS:
        if q.subject.value in annotations:
            assert q.predicate.value.rpartition("#")[2] not in {"domain", "range"}, q


def test_ranges_and_literals_use_datatypes_owl_2_knows() -> None:
    data = {iri for iri, of in types().items() if "DatatypeProperty" in of}
    for q in QUADS:
        if q.predicate.value.endswith("#range") and q.subject.value in data:
            assert q.object.value in DATATYPES, q
        if hasattr(q.object, "datatype"):
            assert q.object.datatype.value in DATATYPES, q


def test_every_annotated_statement_is_also_made() -> None:
    stated = {(q.subject, q.predicate, q.object) for q in QUADS}
    axioms: dict[object, dict[str, object]] = defaultdict(dict)
    for q in QUADS:
        if q.predicate.value.startswith(OWL + "annotated"):
            axioms[q.subject][q.predicate.value] = q.object
    assert len(axioms) == 211
    for parts in axioms.values():
        source, prop = parts[v.OWL_ANNOTATED_SOURCE], parts[v.OWL_ANNOTATED_PROPERTY]
        assert (source, prop, parts[v.OWL_ANNOTATED_TARGET]) in stated
