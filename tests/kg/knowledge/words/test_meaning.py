from __future__ import annotations

from pathlib import Path

import pytest

from kg.knowledge.ontology.catalogue import Catalogue, name_key
from kg.knowledge.ontology.shipped import shipped_ontology
from kg.knowledge.words.meaning import Meaning, understand
from kg.knowledge.words.tables import DATA, NAMES_VARIABLE, all_rows, word_table
from kg.model.errors import OntologyError, UnknownCategoryError

CATALOGUE = shipped_ontology().catalogue


def labels(meaning: Meaning) -> list[str]:
    return [one.label for one in meaning.categories]


@pytest.mark.parametrize(
    ("text", "how", "relation", "categories"),
    [
        ("cup", "label", "same", ["cup"]),
        ("sofa", "label", "same", ["couch"]),
        ("knifes", "label", "same", ["knife"]),
        ("coffee mug", "word", "same", ["cup"]),
        ("Coffee-Mugs", "folded", "same", ["cup"]),
        ("the blue mug", "head", "narrower", ["cup"]),
        ("rocking chair", "word", "narrower", ["chair"]),
        ("cup of tea", "label", "same", ["cup"]),
        ("pair of scissors", "word", "same", ["scissors"]),
        ("desk", "word", "may", ["dining table"]),
        ("cutlery", "word", "broader", ["fork", "knife", "spoon"]),
        ("bannana", "spelling", "same", ["banana"]),
        ("tabel", "spelling", "same", ["dining table"]),
        ("microave oven", "spelling", "same", ["microwave"]),
        ("remotae control", "spelling", "same", ["remote"]),
        ("telivision", "spelling", "same", ["tv"]),
        ("food", "label", "same", ["food"]),
        ("Tasse", "word", "same", ["cup"]),
        ("die Tassen", "word", "same", ["cup"]),
        ("Teetasse", "head", "narrower", ["cup"]),
        ("Kühlschrank", "word", "same", ["refrigerator"]),
        ("Kuehlschrank", "word", "same", ["refrigerator"]),
        ("Kuhlschrank", "word", "same", ["refrigerator"]),
        ("Stuehle", "word", "same", ["chair"]),
        ("https://w3id.org/hereabouts#Cup", "label", "same", ["cup"]),
    ],
)
def test_a_name_leads_to_the_categories_that_include_such_things(
    text: str, how: str, relation: str, categories: list[str]
) -> None:
    meaning = understand(CATALOGUE, text)
    assert (meaning.how, meaning.relation, labels(meaning)) == (how, relation, categories)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("keys", "keys"),
        ("my keys", "keys"),
        ("bunch of keys", "keys"),
        ("wallet", "wallet"),
        ("kettel", "kettle"),
        ("glasses", "glasses"),  # to see, not to drink from
        ("gloves", "gloves"),  # not for baseball
        ("toy car", "toy car"),
        ("Schlüssel", "Schlüssel"),
    ],
)
def test_a_known_word_of_no_category_is_not_forced_into_one(text: str, word: str) -> None:
    meaning = understand(CATALOGUE, text)
    assert (labels(meaning), meaning.word, meaning.relation) == ([], word, "none")
    assert meaning.synset


def test_a_part_names_what_it_is_a_part_of() -> None:
    assert understand(CATALOGUE, "mattress").related == ("bed",)


@pytest.mark.parametrize(
    "text",
    [
        "cable tie",
        "baby monitor",
        "fake banana",
        "xyzzy",
        "Anna",
        "<b>cup</b>",
        "'; DROP",
        "sofx",
        "cup; keys",
    ],
)
def test_a_name_that_only_resembles_a_category_is_refused_in_one_line(text: str) -> None:
    with pytest.raises(UnknownCategoryError, match="no category") as refused:
        understand(CATALOGUE, text)
    assert str(refused.value).isprintable()


@pytest.mark.parametrize("text", ["", "   ", "\u202e", "\x00\x1b", "!?"])
def test_a_name_without_letters_is_refused(text: str) -> None:
    with pytest.raises(UnknownCategoryError, match="is no name of a thing"):
        understand(CATALOGUE, text)


def test_marks_that_do_not_print_do_not_change_a_name() -> None:
    assert labels(understand(CATALOGUE, "\u202ecup\u200f")) == ["cup"]
    with pytest.raises(UnknownCategoryError) as refused:
        understand(CATALOGUE, "\u202exyzzy\x1b[31m")
    assert str(refused.value).isprintable()


def test_a_long_name_is_refused_without_being_repeated() -> None:
    with pytest.raises(UnknownCategoryError, match="at most 100 characters, got 10,000") as refused:
        understand(CATALOGUE, "mug " * 2500)
    assert len(str(refused.value)) < 200


@pytest.mark.parametrize(
    ("text", "note"),
    [
        ("cup", ""),
        ("cups", ""),
        ("coffee mug", "'coffee mug' means cup"),
        ("rocking chair", "'rocking chair' is a kind of chair"),
        ("desk", "'desk' may be detected as dining table"),
        ("cutlery", "'cutlery' means fork, knife or spoon"),
        ("bannana", "'bannana' is read as banana"),
        ("telivision", "'telivision' is read as television, and television means tv"),
        ("kettel", "'kettel' is read as kettle"),
    ],
)
def test_a_meaning_says_how_the_name_was_understood(text: str, note: str) -> None:
    assert understand(CATALOGUE, text).note == note


def test_names_of_a_map_come_before_words() -> None:
    keys = next(c for c in CATALOGUE.categories if c.label == "cup")
    own = Catalogue((type(keys)("urn:x:Key", "keys", "object"), *CATALOGUE.categories))
    assert understand(own, "keys").iris == ["urn:x:Key"]


def test_every_german_name_is_known_and_every_object_has_one() -> None:
    table = word_table()
    names = all_rows(DATA / "names_de.csv")
    for row in names:
        means = name_key(row["means"])
        assert means in table.senses or CATALOGUE.get(row["means"]) is not None, row
    found = [labels(understand(CATALOGUE, row["name"])) for row in names]
    named = {label for each in found for label in each}
    assert named >= {c.label for c in CATALOGUE.categories if c.kind == "object"}


def test_every_category_of_a_word_is_in_the_ontology() -> None:
    for sense in word_table().senses.values():
        for label in sense.categories:
            assert CATALOGUE.get(label, "object") is not None, sense


def test_a_file_adds_names_in_other_languages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "fr.csv"
    path.write_text("name,means\nclés,keys\ntasse,mug\n", encoding="utf-8")
    monkeypatch.setenv(NAMES_VARIABLE, str(path))
    assert labels(understand(CATALOGUE, "tasse")) == ["cup"]
    assert understand(CATALOGUE, "clés").synset == "key.n.01"
    path = tmp_path / "wrong.csv"
    path.write_text("tasse;cup\n", encoding="utf-8")
    monkeypatch.setenv(NAMES_VARIABLE, str(path))
    with pytest.raises(OntologyError, match="needs a first line name,means"):
        understand(CATALOGUE, "tasse")
