"""Labels in several languages: as many rows as before, in the language asked for."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from kg.maps.query.evaluation import Row
from kg.maps.query.label_languages import preferred_languages
from kg.maps.query.query_files import parse_query_file, shipped_queries
from kg.maps.stored_map import StoredMap
from kg.model.errors import QueryError, QueryParameterError
from kg.serving.opening import in_memory_map
from tests.planner.flat import fill

LANGUAGES = "VALUES ?tag { 'de' 'fr' 'en-GB' 'de-AT' }"
NAMED = "FILTER(LANG(?l) = '') BIND(STRLANG(CONCAT(STR(?l), ' ', ?tag), ?tag) AS ?n)"
VALUES = {
    "category": "cup", "place": 1, "x": 3, "y": 1, "xmin": 0, "xmax": 9, "ymin": 0, "ymax": 9,
}  # fmt: skip
THINGS = {"object": "object/2", "one": "object/1", "other": "object/3"}


@pytest.fixture(scope="module")
def flat() -> Iterator[StoredMap]:
    with in_memory_map(base="https://example.org/flat/") as made:
        fill(made)
        made.assertions.add(made.base + "object/1", "category", "apple", by="ann")
        yield made


def answers(flat: StoredMap, language: str = "") -> dict[str, tuple[Row, ...]]:
    values = VALUES | {name: flat.base + iri for name, iri in THINGS.items()}
    return {
        query.name: flat.query(
            query.name,
            language=language,
            **{one.name: values[one.name] for one in query.parameters if one.default is None},
        ).rows
        for query in shipped_queries()
        if query.name != "graph-sizes"
    }


@pytest.fixture(scope="module")
def both(flat: StoredMap) -> tuple[dict[str, tuple[Row, ...]], dict[str, tuple[Row, ...]]]:
    """The answers before and after everything got five labels."""
    before = answers(flat)
    for graph, of in (("ontology", "?s a owl:Class ."), ("map", "")):
        where = f"GRAPH graph:{graph} {{ {of} ?s rdfs:label ?l }} {LANGUAGES} {NAMED}"
        text = f"INSERT {{ GRAPH graph:{graph} {{ ?s rdfs:label ?n }} }} WHERE {{ {where} }}"
        assert flat.update(text, by="ann", confirmed=True, allow=("ontology",)) is not None
    return before, answers(flat)


@pytest.mark.parametrize("name", [q.name for q in shipped_queries() if q.name != "graph-sizes"])
def test_labels_in_further_languages_change_no_row(
    both: tuple[dict[str, tuple[Row, ...]], dict[str, tuple[Row, ...]]], name: str
) -> None:
    before, after = both
    assert after[name] == before[name]


@pytest.mark.usefixtures("both")
@pytest.mark.parametrize(
    ("language", "label"),
    [
        ("de", "cup de"),
        ("de-AT", "cup de-at"),
        ("de-CH", "cup de"),
        ("fr;q=0.4, de;q=0.5", "cup de"),
        ("it, fr", "cup fr"),
        ("en", "cup en-gb"),
        ("it", "cup"),
        ("*", "cup"),
        ("", "cup"),
    ],
)
def test_a_label_is_in_the_language_asked_for(flat: StoredMap, language: str, label: str) -> None:
    (row,) = flat.query("objects-by-category", category="cup", language=language).records()
    assert str(row["category"]).lower() == label


@pytest.mark.usefixtures("both")
def test_each_query_gives_one_label_in_another_language(flat: StoredMap) -> None:
    plain, german = answers(flat), answers(flat, "de")
    assert {name: len(rows) for name, rows in german.items()} == {
        name: len(rows) for name, rows in plain.items()
    }
    assert german["objects"] != plain["objects"]


def test_languages_are_ordered_by_preference() -> None:
    assert preferred_languages("fr;q=0.2, de-AT, en;q=0") == ("de-at", "de", "fr")
    with pytest.raises(QueryParameterError, match="a language is written"):
        preferred_languages('de" ) } #')


def test_a_header_of_another_form_is_refused() -> None:
    with pytest.raises(QueryError, match="'ontology LABEL of THING'"):
        parse_query_file("#+ labels: ?category of ?class\nSELECT * { ?s ?p ?o }", "mine")
