from __future__ import annotations

from pathlib import Path

import pytest

from kg.knowledge.ontology.catalogue import Catalogue
from kg.knowledge.ontology.diagnostics import inspect
from kg.knowledge.ontology.import_closure import load_with_imports
from kg.knowledge.ontology.shipped import shipped_ontology
from kg.knowledge.words.classes import class_iri, sense_of_label, vocabulary_turtle
from kg.knowledge.words.meaning import understand
from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.errors import UnknownCategoryError

CATALOGUE = shipped_ontology().catalogue
WORDS = ["keys", "kettle", "rocking chair", "coffee mug", "desk"]


@pytest.fixture
def with_words(tmp_path: Path) -> Catalogue:
    path = tmp_path / "words.ttl"
    path.write_text(vocabulary_turtle(CATALOGUE, WORDS), encoding="utf-8")
    ontology = load_with_imports(path)
    assert [one for one in inspect(ontology) if one.severity == "violation"] == []
    return Catalogue.from_quads(ontology.quads)


def test_words_are_an_ontology_of_classes_with_labels_and_links(with_words: Catalogue) -> None:
    key = with_words.find("keys", "object")
    assert (key.iri, key.label, key.undetected) == (v.WORD + "key.n.01", "key", True)
    assert "Schl\u00fcssel" in key.synonyms
    assert with_words.find("coffee mug").label == "cup"
    text = vocabulary_turtle(CATALOGUE, ["rocking chair"])
    assert "rdfs:subClassOf here:Object , here:Chair" in text
    assert "wn30/synset-rocking_chair-noun-1" in text


def test_a_class_of_a_word_leads_to_the_category_that_detectors_see(with_words: Catalogue) -> None:
    meaning = understand(with_words, "rocking chair")
    assert [one.label for one in meaning.categories] == ["rocking chair", "chair"]
    assert meaning.note == "'rocking chair' is a kind of chair"
    assert [one.label for one in understand(with_words, "keys").categories] == ["key"]


def test_all_words_are_one_ontology(tmp_path: Path) -> None:
    path = tmp_path / "words.ttl"
    path.write_text(vocabulary_turtle(CATALOGUE), encoding="utf-8")
    catalogue = Catalogue.from_quads(load_with_imports(path).quads)
    assert sum(one.undetected for one in catalogue.categories) > 2500
    assert catalogue.find("cup").undetected is False


def test_an_unknown_word_is_no_class() -> None:
    with pytest.raises(UnknownCategoryError, match="no category 'qwzx'"):
        vocabulary_turtle(CATALOGUE, ["qwzx"])
    with pytest.raises(UnknownCategoryError, match="no word 'red mug' is known"):
        vocabulary_turtle(CATALOGUE, ["red mug"])


@pytest.mark.parametrize(
    ("label", "synset"),
    [
        ("Espresso machine", "espresso_maker.n.01"),
        ("sofa, couch, lounge", "sofa.n.01"),
        ("kettles", "kettle.n.01"),
        ("coffee_mug", "coffee_mug.n.01"),
        ("bat (animal)", None),  # not the one for baseball
        ("Windsor seat", None),
    ],
)
def test_labels_of_networks_have_senses(label: str, synset: str | None) -> None:
    sense = sense_of_label(label)
    assert (sense and sense.synset) == synset


def test_labels_of_a_network_become_words_of_the_map(semantic_map: SemanticMap) -> None:
    labels = ["Coffee mug", "Armchair", "Kettle", "Windsor seat"]
    found = semantic_map.ontology.learn(labels, "object", model="own")
    catalogue = semantic_map.catalogue
    assert found["Coffee mug"] == catalogue.find("cup").iri
    kettle = sense_of_label("kettle")
    assert kettle is not None and found["Kettle"] == class_iri(kettle)
    assert catalogue.find("kettle").undetected is False
    assert catalogue.find("Windsor seat").provisional is True
    chairs = semantic_map.query("goals-kinds", category=catalogue.find("chair").iri).records()
    assert found["Armchair"] in {row["kind"] for row in chairs}
    again = semantic_map.ontology.learn(labels, "object", model="own")
    assert again == found
    semantic_map.ontology.replace(semantic_map.ontology.quads())
    assert semantic_map.ontology.learn(labels, "object", model="own") == found
