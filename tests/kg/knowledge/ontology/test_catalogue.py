"""Categories of a map, also provisional ones."""

import threading
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pyoxigraph
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyoxigraph import NamedNode, Quad, RdfFormat, parse

from kg.export.serialization import export_text
from kg.knowledge.ontology.catalogue import Catalogue, Category, name_key
from kg.knowledge.ontology.lint import check_map, check_quads
from kg.knowledge.ontology.provisional_classes import clean, provisional_iri
from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.errors import UnknownCategoryError
from kg.model.records import MapUpdate, ObjectRecord
from kg.serving.opening import in_memory_map
from tests.shipped_ontology import CATALOGUE, QUADS

Shared = Callable[[str], Path]


@pytest.mark.parametrize(
    ("said", "label"),
    [
        ("banana", "banana"),
        ("Bananas", "banana"),
        ("knives", "knife"),
        ("wine glasses", "wine glass"),
        ("TVs", "tv"),
        ("sofa", "couch"),
        ("people", "person"),
        ("ski", "skis"),
        ("bus", "bus"),
        ("food", "food"),
        ("vehicles", "vehicle"),
        ("museum/indoor", "museum indoor"),
        ("bathroom", "shower"),
        ("butcher's shop", "butchers shop"),
        ("libraries of bananas", None),
    ],
)
def test_what_is_said_finds_what_is_meant(said: str, label: str | None) -> None:
    category = CATALOGUE.get(said)
    assert (category and category.label) == label


@given(st.sampled_from(CATALOGUE.categories), st.sampled_from([" ", "_", "-", ""]), st.booleans())
def test_case_and_separators_never_matter(category: Category, mark: str, upper: bool) -> None:
    for name in (category.label, *category.synonyms):
        written = name.replace(" ", mark).replace("_", mark)
        written = written.upper() if upper else written
        assert CATALOGUE.find(written, category.kind) == category


def test_no_two_shipped_categories_share_a_name() -> None:
    owners: dict[str, set[str]] = defaultdict(set)
    for category in CATALOGUE.categories:
        for name in (category.label, *category.synonyms):
            owners["".join(filter(str.isalnum, name.casefold()))].add(category.iri)
    assert {name: of for name, of in owners.items() if len(of) > 1} == {}


def test_every_room_the_scene_networks_of_homes_name_is_a_place(shared: Shared) -> None:
    for line in shared("models/labels_rooms6.txt").read_text().split():
        assert CATALOGUE.find(line).kind == "place"


def test_an_iri_finds_its_category_and_its_label() -> None:
    iri = v.HERE + "CellPhone"
    assert CATALOGUE.find(iri).label == CATALOGUE.label(iri) == "cell phone"
    assert CATALOGUE.by_iri(iri) == CATALOGUE.find("here:CellPhone")
    assert CATALOGUE.by_iri(v.OBJECT) is None
    with pytest.raises(UnknownCategoryError, match="no category has the IRI urn:x"):
        CATALOGUE.label("urn:x")


@pytest.mark.parametrize(
    ("said", "kind", "message"),
    [
        ("bananna", None, "no category 'bananna'; did you mean banana?"),
        ("kitchn", "place", "no place category 'kitchn'; did you mean kitchen?"),
        ("kitchen", "object", "no object category 'kitchen': that is a place"),
        ("qwzx", None, "no category 'qwzx' among the 289 of this map"),
        ("", None, "no category '' among the 289 of this map"),
    ],
)
def test_an_unknown_name_is_refused_with_what_would_work(said, kind, message):
    with pytest.raises(UnknownCategoryError) as error:
        CATALOGUE.find(said, kind)
    assert str(error.value) == message


def test_a_category_people_add_is_found_in_any_of_its_languages() -> None:
    text = f"""
        @prefix : <urn:mine:> . @prefix here: <{v.HERE}> .
        @prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
        :Mug rdfs:subClassOf here:Cup ; rdfs:label "Becher"@de , "mug with a handle"@en .
        :Thing7 rdfs:subClassOf here:Object .
    """
    added = pyoxigraph.parse(text, format=pyoxigraph.RdfFormat.TURTLE)
    catalogue = Catalogue.from_quads([*QUADS, *added])
    mug = catalogue.find("becher")
    assert (mug.iri, mug.label, mug.kind) == ("urn:mine:Mug", "mug with a handle", "object")
    assert catalogue.find("cup").kind == "object"
    assert catalogue.find("thing 7").iri == "urn:mine:Thing7"


MODEL = "openimages_600"


@pytest.fixture
def home() -> Iterator[SemanticMap]:
    with in_memory_map(base="https://example.org/home/") as semantic_map:
        yield semantic_map


def stand(semantic_map: SemanticMap, category: str) -> str:
    """Have an object of a category stand in the map; its IRI."""
    iri = semantic_map.new_object_iri()
    at = np.array([1.0, 2.0, 0.5])
    record = ObjectRecord(iri, category, at, 2.0, 0.6, 3, first_seen=5.0, last_seen=9.0)
    semantic_map.apply(MapUpdate(objects=(record,)))
    return iri


def test_a_new_label_is_a_category_that_questions_know(home: SemanticMap) -> None:
    made = home.ontology.learn(["espresso gizmo"], "object", model=MODEL)
    stand(home, made["espresso gizmo"])
    (found,) = home.objects("Espresso_Gizmos")
    assert found.category == made["espresso gizmo"]
    rows = home.query("objects-by-category", category="espresso gizmo").records()
    assert [row["category"] for row in rows] == ["espresso gizmo"]
    assert check_map(home.store.engine.quads_for_pattern(None, None, None, None)) == []
    assert check_quads(home.ontology.quads()) == []


def test_labels_that_are_known_or_alike_make_nothing(home: SemanticMap) -> None:
    made = home.ontology.learn(["espresso gizmo", "Espresso-Gizmo"], "object", model=MODEL)
    before = home.sequence
    known = ["Coffee cup", "Television", "Houseplant"]
    found = home.ontology.learn(["ESPRESSO_GIZMO", *known], "object", model=MODEL)
    assert [home.catalogue.label(found[name]) for name in known] == ["cup", "tv", "potted plant"]
    assert len({*made.values(), found["ESPRESSO_GIZMO"]}) == 1
    assert home.sequence == before


def test_what_a_label_means_does_not_depend_on_the_order_of_meeting(home: SemanticMap) -> None:
    glass = home.ontology.learn(["Glass"], "object", model=MODEL)["Glass"]
    assert home.ontology.learn(["Glasses"], "object", model=MODEL)["Glasses"] != glass


def test_an_object_and_a_place_may_be_called_the_same(home: SemanticMap) -> None:
    one = home.ontology.learn(["aviary"], "object", model=MODEL)["aviary"]
    other = home.ontology.learn(["aviary"], "place", model=MODEL)["aviary"]
    assert one != other
    kinds = {home.catalogue.by_iri(iri).kind for iri in (one, other)}  # type: ignore[union-attr]
    assert kinds == {"object", "place"}


def test_a_label_that_is_a_supercategory_stands_below_it(home: SemanticMap) -> None:
    stand(home, home.ontology.learn(["Food"], "object", model=MODEL)["Food"])
    assert len(home.objects("food")) == 1
    assert home.catalogue.find("food").kind == "supercategory"


def test_the_history_says_which_network_it_was(home: SemanticMap) -> None:
    iri = home.ontology.learn(["espresso gizmo"], "object", model=MODEL)["espresso gizmo"]
    told = home.history.explain(f"<{iri}> a")
    texts = [step.text for reason in told for _, step in reason.walk()]
    assert any(MODEL in text for text in texts)
    with home.at(home.sequence - 1) as then:
        assert then.catalogue.by_iri(iri) is None


def test_a_reloaded_ontology_keeps_what_the_map_speaks_of_and_no_more(home: SemanticMap) -> None:
    made = home.ontology.learn(["teawhisk", "samovar"], "object", model=MODEL)
    stand(home, made["teawhisk"])
    home.ontology.replace(QUADS)
    assert home.catalogue.by_iri(made["teawhisk"]) is not None
    assert home.catalogue.by_iri(made["samovar"]) is None
    assert len(home.objects("teawhisk")) == 1
    assert check_map(home.store.engine.quads_for_pattern(None, None, None, None)) == []


def test_a_person_puts_one_below_a_real_category(home: SemanticMap) -> None:
    made = home.ontology.learn(["teawhisk"], "object", model=MODEL)["teawhisk"]
    thing = stand(home, made)
    vase = home.catalogue.find("vase").iri
    graph = v.ONTOLOGY_GRAPH
    below = Quad(NamedNode(made), NamedNode(v.RDFS_SUB_CLASS_OF), NamedNode(vase), graph)
    home.ontology.replace([*home.ontology.quads(), below])
    assert [record.iri for record in home.objects("vase")] == [thing]
    assert home.catalogue.get("teawhisk") is not None


def test_a_synonym_written_by_a_person_beats_a_provisional_category(home: SemanticMap) -> None:
    home.ontology.learn(["teawhisk"], "object", model=MODEL)
    vase = home.catalogue.find("vase").iri
    home.update(
        f'INSERT DATA {{ GRAPH graph:ontology {{ <{vase}> skos:altLabel "teawhisk" }} }}',
        allow=("ontology",),
    )
    assert home.catalogue.find("teawhisk").iri == vase
    assert home.catalogue.for_label("teawhisk", "object").iri == vase  # type: ignore[union-attr]


@settings(max_examples=30, deadline=None)
@given(st.lists(st.text(), min_size=1, max_size=4), st.sampled_from(("object", "place")))
def test_any_text_makes_safe_names_and_well_made_ontologies(labels: list[str], kind: str) -> None:
    for label in map(clean, labels):
        if label:
            iri = provisional_iri(label, kind)
            assert NamedNode(iri).value == iri
            assert iri.isascii()
    keys = {name_key(label) for label in map(clean, labels) if label}
    assert len({provisional_iri(clean(x), kind) for x in labels if clean(x)}) == len(keys)


@settings(max_examples=5, deadline=None)
@given(st.lists(st.text(min_size=1), min_size=1, max_size=3))
def test_any_text_survives_a_map_and_its_export(labels: list[str]) -> None:
    with in_memory_map(base="https://example.org/home/") as home:
        assert home.ontology.learn(["", " \t", "\x00\x07"], "object", model=MODEL) == {}
        made = home.ontology.learn(labels, "object", model="\x00net\n")
        for iri in set(made.values()):
            stand(home, iri)
            label = home.catalogue.label(iri)
            assert home.query("objects-by-category", category=iri).records()[0]["category"] == label
        read = list(parse(export_text(home, "ttl").encode(), format=RdfFormat.TURTLE))
        kinds = {q.object.value for q in read if q.predicate == v.RDF_TYPE}
        assert set(made.values()) <= kinds
        assert Catalogue.from_quads(home.ontology.quads()) == home.catalogue


def test_two_threads_that_learn_the_same_make_one(home: SemanticMap) -> None:
    threads = [
        threading.Thread(
            target=home.ontology.learn, args=(["teawhisk"], "object"), kwargs={"model": str(n)}
        )
        for n in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    iri = home.catalogue.find("teawhisk").iri
    assert len([*home.engine.quads_for_pattern(NamedNode(iri), None, None, None)]) > 0
    sources = home.engine.quads_for_pattern(NamedNode(iri), NamedNode(v.DCT_SOURCE), None, None)
    assert len([*sources]) == 1
