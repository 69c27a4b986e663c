"""docs/reference/vocabulary.md is what the shipped ontologies say."""

from __future__ import annotations

from pathlib import Path

from kg.knowledge.ontology.loading import load_ontologies
from kg.knowledge.ontology.vocabulary_page import vocabulary_page

PAGE = Path(__file__).resolve().parents[4] / "docs" / "reference" / "vocabulary.md"


def test_the_page_is_up_to_date() -> None:
    text = vocabulary_page(load_ontologies().quads)
    assert PAGE.read_text() == text, "make it anew: hereabouts ontology vocabulary -o " + str(PAGE)


def test_the_page_has_every_category_and_term() -> None:
    text = PAGE.read_text()
    for row in (
        "| mouse | `here:Mouse` | computer mouse, mice | electronics |",
        "; `here:Kitchen` (Kueche, Küche); ",
        "| `here:inPlace` | in place | `here:Object`; `here:UnnamedThing` | `here:Place` |",
    ):
        assert row in text
