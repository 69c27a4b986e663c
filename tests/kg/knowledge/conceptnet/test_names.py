"""Terms of ConceptNet find our categories, lemmatised or not, and no others."""

from __future__ import annotations

import unicodedata

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kg.knowledge.conceptnet.names import TermMatcher, reduced
from kg.knowledge.ontology.catalogue import Catalogue
from kg.knowledge.ontology.loading import load_ontologies

CATALOGUE = Catalogue.from_quads(load_ontologies().quads)
NAMES = TermMatcher(CATALOGUE)


@pytest.mark.parametrize(
    ("term", "kind", "label"),
    [
        ("live room", "place", "living room"),
        ("living_room", "place", "living room"),
        ("livingroom", "place", "living room"),
        ("living-room", "place", "living room"),
        ("dine room", "place", "dining room"),
        ("wait room", "place", "waiting room"),
        ("office build", "place", "office building"),
        ("office building", "place", "office building"),
        ("your office", "place", "office"),
        ("bathroom", "place", "shower"),
        ("foyer", "place", "lobby"),
        ("butcher shop", "place", "butchers shop"),
        ("dine table", "object", "dining table"),
        ("a cell phone", "object", "cell phone"),
        ("cellphone", "object", "cell phone"),
        ("scissor", "object", "scissors"),
        ("wine glasses", "object", "wine glass"),
        ("knives", "object", "knife"),
        ("pot plant", "object", "potted plant"),
        ("television", "object", "tv"),
        ("notebook computer", "object", "laptop"),
        ("fridges", "object", "refrigerator"),
        ("foods", "supercategory", "food"),
    ],
)
def test_a_term_finds_its_category(term: str, kind: str, label: str) -> None:
    assert NAMES.get(term, kind) == CATALOGUE.find(label, kind).iri


@pytest.mark.parametrize(
    "term", ["bedding", "skiing", "bowling", "booking", "boating", "plan", "notebook", "", "the"]
)
def test_a_term_that_only_looks_alike_finds_none(term: str) -> None:
    assert NAMES.get(term, "object") is None


def test_notebook_is_a_doubtful_name_of_the_laptop() -> None:
    laptop = CATALOGUE.find("laptop")
    assert NAMES.doubtful("notebooks") == laptop.iri
    assert "notebook" in NAMES.terms(laptop)


def test_every_category_is_found_by_each_of_its_names_or_shares_it() -> None:
    for kind, group in NAMES.groups.items():
        for category in group:
            assert NAMES.get(category.label, kind) == category.iri
            for name in category.synonyms:
                assert NAMES.get(name, kind) is not None, name


@settings(deadline=None)
@given(st.text())
def test_reducing_what_is_reduced_again_needs_no_more_words(text: str) -> None:
    # one character may stand for several words: a fraction for its two numbers
    assert len(reduced(text).split()) <= len(unicodedata.normalize("NFKC", text))
    NAMES.get(text, "object")
