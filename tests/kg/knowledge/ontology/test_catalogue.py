"""People's and networks' words find the category they mean."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

import pyoxigraph
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kg.knowledge.ontology.catalogue import Catalogue, Category
from kg.knowledge.ontology.loading import load_ontologies
from kg.model import vocabulary as v
from kg.model.errors import UnknownCategoryError

QUADS = load_ontologies().quads
CATALOGUE = Catalogue.from_quads(QUADS)
Shared = Callable[[str], Path]


@pytest.mark.parametrize(
    ("said", "label"),
    [
        ("banana", "banana"),
        ("Bananas", "banana"),
        ("knives", "knife"),
        ("wine-glass", "wine glass"),
        ("wine glasses", "wine glass"),
        ("WineGlass", "wine glass"),
        ("tv/monitor", "tv"),
        ("TVs", "tv"),
        ("sofa", "couch"),
        ("couches", "couch"),
        ("mobile phone", "cell phone"),
        ("fridge", "refrigerator"),
        ("mice", "mouse"),
        ("people", "person"),
        ("ski", "skis"),
        ("bus", "bus"),
        ("buses", "bus"),
        ("food", "food"),
        ("vehicles", "vehicle"),
        ("vehicle", "vehicle"),
        ("animals", "animal"),
        ("dinette_home", "dinette home"),
        ("museum/indoor", "museum indoor"),
        ("bathroom", "shower"),
        ("entrance_hall", "lobby"),
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
def test_an_unknown_name_is_refused_with_what_would_work(
    said: str, kind: str | None, message: str
) -> None:
    with pytest.raises(UnknownCategoryError) as error:
        CATALOGUE.find(said, kind)
    assert str(error.value) == message


def test_the_catalogue_of_a_store_is_that_of_its_ontology_graph() -> None:
    store = pyoxigraph.Store()
    store.extend(QUADS)
    assert Catalogue.from_store(store) == CATALOGUE


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
