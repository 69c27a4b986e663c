"""Loading of ontologies, and what follows from them."""

import csv
import json
import shutil
from collections import Counter, defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pyoxigraph
import pytest
import rdflib
from pyoxigraph import NamedNode, Quad

from kg.knowledge.ontology.loading import compile_commonsense, load_ontologies, superclasses
from kg.knowledge.ontology.reasoning import inconsistent_classes, load_world
from kg.knowledge.ontology.relations import relations
from kg.model import vocabulary as v
from kg.model.errors import OntologyError
from kg.model.resources import ONTOLOGIES
from tests.shipped_ontology import CATALOGUE, QUADS

Shared = Callable[[str], Path]
EDGES = relations(QUADS)


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def iri(name: str) -> str:
    return CATALOGUE.find(name).iri


def test_every_coco_category_is_an_object_under_its_own_label(shared: Shared) -> None:
    for row in rows(shared("reference/coco80.csv")):
        category = CATALOGUE.find(row["coco_name"], "object")
        assert category.label == row["coco_name"]
        assert CATALOGUE.find(row["thesis_name"], "object") == category


def test_every_places205_category_is_a_place_and_keeps_its_raw_name(shared: Shared) -> None:
    for row in rows(shared("reference/places205.csv")):
        category = CATALOGUE.find(row["name"], "place")
        assert row["name"] in (category.label, *category.synonyms)
        assert category.label == row["name"].replace("_", " ")


def test_there_are_80_objects_205_places_and_4_supercategories() -> None:
    kinds = Counter(category.kind for category in CATALOGUE.categories)
    assert kinds == {"object": 80, "place": 205, "supercategory": 4}


def test_objects_and_places_hold_the_324_is_a_edges_of_the_reference(shared: Shared) -> None:
    edges = {
        (q.subject.value, q.object.value)
        for name in ("objects.ttl", "places.ttl")
        for q in pyoxigraph.parse(path=str(ONTOLOGIES / name))
        if q.predicate.value == v.RDFS_SUB_CLASS_OF
    }
    expected = {(iri(r["coco_name"]), v.OBJECT) for r in rows(shared("reference/coco80.csv"))}
    expected |= {(iri(r["name"]), v.PLACE) for r in rows(shared("reference/places205.csv"))}
    for row in rows(shared("reference/is_a.csv")):
        expected.add((iri(row["object"]), iri(row["supercategory"])))
    above = {up for _, up in expected}
    assert {(iri, up) for iri, up in edges if up in above} == expected
    assert len(expected) == 324
    wider = {up for _, up in edges} - above  # wider kinds of places, and what those are below
    assert {iri for iri, up in edges if up in wider and iri not in wider} == {
        iri for iri, up in expected if up == v.PLACE
    }


@pytest.mark.parametrize(
    ("table", "kind", "target", "count"),
    [("located_at.csv", v.LOCATED_AT, "place", 204), ("near_by.csv", v.NEAR_BY, "near", 7)],
)
def test_relations_are_those_of_the_reference(shared, table, kind, target, count):
    found = {(r.subject, r.target) for r in relations(QUADS) if r.kind == kind}
    expected = rows(shared(f"reference/{table}"))
    assert found == {(iri(row["object"]), iri(row[target])) for row in expected}
    assert len(found) == len(expected) == count


def test_probabilities_are_the_shares_measured_in_real_homes(shared: Shared) -> None:
    names = {"office": "home office"}  # as in docs/explanation/ontology.md; toilets are no category
    located, near = [], []
    for room in real_rooms(shared):
        place = CATALOGUE.get(names.get(room["label"], room["label"]), "place")
        held = {label for label, count in room["coco"].items() if count > 0}
        for edge in EDGES:
            there = CATALOGUE.label(edge.subject) in held
            if edge.kind == v.LOCATED_AT and place is not None and edge.target == place.iri:
                located.append((there, edge.probability))
            elif edge.kind == v.NEAR_BY and CATALOGUE.label(edge.target) in held:
                near.append((there, edge.probability))
    for cases, hits, count in ((located, 199, 944), (near, 42, 70)):
        assert (sum(there for there, _ in cases), len(cases)) == (hits, count)
        assert {p for _, p in cases} == {round(hits / count, 1)}


def real_rooms(shared: Shared) -> list[dict[str, Any]]:
    homes = sorted(shared("data/homes").glob("*.json"))
    return [room for home in homes for room in json.loads(home.read_text())["rooms"]]


def test_every_relation_says_where_its_number_comes_from() -> None:
    for relation in relations(QUADS):
        (source,) = relation.sources
        assert "rooms" in str(source), relation


def test_the_vocabulary_module_and_the_core_ontology_name_the_same_terms() -> None:
    in_code = {
        value
        for value in vars(v).values()
        if isinstance(value, str) and value.startswith(v.HERE) and value != v.HERE
    }
    core = list(pyoxigraph.parse(path=str(ONTOLOGIES / "hereabouts.ttl")))
    declared = {
        q.subject.value
        for q in core
        if q.predicate == v.RDF_TYPE and str(q.subject).startswith(f"<{v.HERE}")
    }
    assert in_code == declared


def test_a_relation_compiles_to_one_node_with_all_it_says() -> None:
    node = v.RELATION + "locatedAt/Banana/Kitchen"
    said = {
        q.predicate.value: q.object for q in compile_commonsense(QUADS) if q.subject.value == node
    }
    assert said[v.RDF_TYPE.value].value == v.LOCATED_AT_RELATION
    assert said[v.RELATION_SUBJECT].value == iri("banana")
    assert said[v.RELATION_TARGET].value == iri("kitchen")
    assert said[v.RELATION_PROBABILITY] == pyoxigraph.Literal(0.2)
    assert "HM3D" in said[v.DCT_SOURCE].value


def test_compiling_is_the_same_each_time_and_goes_into_one_graph() -> None:
    assert load_ontologies().quads == QUADS  # blank nodes included
    again = compile_commonsense(QUADS)
    assert again == compile_commonsense(reversed(QUADS))
    assert {q.graph_name.value for q in again} == {v.COMMONSENSE_GRAPH.value}
    assert len(set(again)) == len(again)


def test_the_compiled_graph_survives_rdf_xml_through_rdflib(tmp_path: Path) -> None:
    for path in load_ontologies().files:
        xml = rdflib.Graph().parse(path).serialize(format="xml")
        (tmp_path / path.with_suffix(".owl").name).write_text(xml)
    assert compile_commonsense(load_ontologies(tmp_path).quads) == compile_commonsense(QUADS)


def test_the_catalog_leads_every_import_to_a_file_with_that_iri() -> None:
    catalog = ElementTree.parse(ONTOLOGIES / "catalog-v001.xml").getroot()
    local = {entry.attrib["name"]: ONTOLOGIES / entry.attrib["uri"] for entry in catalog}
    headers = {
        name: [q.subject.value for q in pyoxigraph.parse(path=str(path)) if is_header(q)]
        for name, path in local.items()
    }
    assert headers == {name: [name] for name in local}
    assert set(local.values()) == set(ONTOLOGIES.glob("*.ttl"))
    imports = {q.object.value for q in QUADS if q.predicate.value == v.OWL_IMPORTS}
    assert imports
    assert imports <= local.keys()


def is_header(q: pyoxigraph.Quad) -> bool:
    return q.predicate == v.RDF_TYPE and q.object == pyoxigraph.NamedNode(v.OWL_ONTOLOGY)


def test_cycles_and_restrictions_do_not_disturb_the_closure() -> None:
    text = """
        @prefix : <urn:t:> . @prefix owl: <http://www.w3.org/2002/07/owl#> .
        @prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
        :A rdfs:subClassOf :B . :B rdfs:subClassOf :A , :C , [ a owl:Restriction ] , owl:Thing .
    """
    quads = pyoxigraph.parse(text, format=pyoxigraph.RdfFormat.TURTLE)
    everything = ("urn:t:A", "urn:t:B", "urn:t:C")
    closed = superclasses(quads)
    assert closed == {"urn:t:A": everything, "urn:t:B": everything, "urn:t:C": ("urn:t:C",)}


HEADER = f"""
    @prefix here: <{v.HERE}> . @prefix owl: <http://www.w3.org/2002/07/owl#> .
    here:Cup here:locatedAt here:Kitchen .
"""
AXIOM = """[] a owl:Axiom ; owl:annotatedSource here:Cup ;
    owl:annotatedProperty here:locatedAt ; owl:annotatedTarget here:Kitchen ;
    here:probability """


def test_a_relation_without_a_probability_takes_that_of_its_property() -> None:
    text = HEADER + "here:locatedAt here:probability 0.35 ."
    (relation,) = relations(pyoxigraph.parse(text, format=pyoxigraph.RdfFormat.TURTLE))
    assert relation.probability == 0.35
    own = text + AXIOM + "0.7 ."
    (relation,) = relations(pyoxigraph.parse(own, format=pyoxigraph.RdfFormat.TURTLE))
    assert relation.probability == 0.7
    twice = own + AXIOM + "0.70e0 ."
    (relation,) = relations(pyoxigraph.parse(twice, format=pyoxigraph.RdfFormat.TURTLE))
    assert relation.probability == 0.7


@pytest.mark.parametrize(
    ("said", "complaint"),
    [
        ("", "has none"),
        (AXIOM + "0.2 , 0.5 .", "has 0.2 and 0.5"),
        (AXIOM + "1.2 .", "has 1.2"),
        (AXIOM + '"often" .', "has often"),
    ],
)
def test_a_relation_without_one_usable_probability_is_refused(said: str, complaint: str) -> None:
    quads = pyoxigraph.parse(HEADER + said, format=pyoxigraph.RdfFormat.TURTLE)
    with pytest.raises(OntologyError, match="here:Cup here:locatedAt here:Kitchen needs") as error:
        relations(quads)
    assert str(error.value).endswith(complaint)


def test_a_file_that_does_not_parse_is_named_with_its_line(tmp_path: Path) -> None:
    (tmp_path / "mine.ttl").write_text("@prefix a: <urn:a:> .\na:b a:c a:d .\nx:y a:c a:d .\n")
    with pytest.raises(OntologyError) as error:
        load_ontologies(tmp_path)
    message = f"{tmp_path / 'mine.ttl'}, line 3: The prefix x: has not been declared"
    assert str(error.value) == message


def test_a_folder_without_ontologies_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OntologyError, match=r"expected files \.ttl"):
        load_ontologies(tmp_path)
    with pytest.raises(OntologyError, match="it is not a folder"):
        load_ontologies(tmp_path / "absent")


OWL = v.PREFIXES["owl"]


def test_owlready2_reads_a_relation_with_its_probability_and_source() -> None:
    world = load_world(QUADS)
    for root, count in ((v.OBJECT, 80), (v.PLACE, 205)):
        assert len(world[root].descendants(include_self=False)) == count
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
