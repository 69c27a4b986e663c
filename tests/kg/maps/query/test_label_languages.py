"""Rows of results, and languages of labels."""

from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyoxigraph import Literal, NamedNode, QuerySolutions, Store

from kg.maps.query.evaluation import PIECE, Row, rows_of, value_of
from kg.maps.query.parameter_resolution import preferred_languages
from kg.maps.query.query_files import parse_query_file, shipped_queries
from kg.maps.stored_map import StoredMap
from kg.model import vocabulary as v
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


def test_labels_in_further_languages_change_no_row(both):
    before, after = both
    assert {name for name, rows in after.items() if rows != before[name]} == set()


@pytest.mark.usefixtures("both")
def test_a_label_is_in_the_language_asked_for(flat: StoredMap) -> None:
    expected = {"de": "cup de", "de-AT": "cup de-at", "de-CH": "cup de", "en": "cup en-gb"}
    expected |= {"fr;q=0.4, de;q=0.5": "cup de", "it, fr": "cup fr"}
    expected |= dict.fromkeys(("it", "*", ""), "cup")
    for language, label in expected.items():
        (row,) = flat.query("objects-by-category", category="cup", language=language).records()
        assert str(row["category"]).lower() == label, language


@pytest.mark.usefixtures("both")
def test_each_query_gives_one_label_in_another_language(flat: StoredMap) -> None:
    plain, german = answers(flat), answers(flat, "de")
    assert {name: len(rows) for name, rows in german.items()} == {
        name: len(rows) for name, rows in plain.items()
    }
    assert german["objects"] != plain["objects"]


def test_an_object_outside_of_places_or_without_a_label_has_one_row() -> None:
    with in_memory_map(base="https://example.org/flat/") as made:
        fill(made)
        placed = made.query("objects", least=0).rows
        for number, predicate in ((0, v.IN_PLACE), (1, v.RDFS_LABEL)):
            thing = NamedNode(str(placed[number][0]))
            (fact,) = made.engine.quads_for_pattern(thing, NamedNode(predicate), None, v.MAP_GRAPH)
            made.store.native.remove(fact)
        bare = [list(row) for row in placed]
        bare[0][-1] = bare[1][1] = None
        assert [list(row) for row in made.query("objects", least=0).rows] == bare


def test_languages_are_ordered_by_preference() -> None:
    assert preferred_languages("fr;q=0.2, de-AT, en;q=0") == ("de-at", "de", "fr")
    with pytest.raises(QueryParameterError, match="a language is written"):
        preferred_languages('de" ) } #')


def test_a_header_of_another_form_is_refused() -> None:
    with pytest.raises(QueryError, match="'ontology LABEL of THING'"):
        parse_query_file("#+ labels: ?category of ?class\nSELECT * { ?s ?p ?o }", "mine")


NUMERIC = ("integer", "int", "decimal", "double", "float", "boolean", "dateTime", "date", "long")
TEXT = st.text(st.characters(exclude_categories=("Cs",), exclude_characters="\0"), max_size=12)
LEXICAL = st.one_of(
    TEXT,
    st.sampled_from(["", "1", "-07", "+5", "1.", ".5", "1e3", "INF", "-INF", "NaN", "true", "0"]),
    st.datetimes().map(lambda moment: moment.isoformat() + "Z"),
    st.floats().map(str),
    st.integers().map(str),
)
TERMS = st.one_of(
    st.none(),
    st.sampled_from([NamedNode("https://example.org/a"), NamedNode("urn:x:<<é".replace("<", "("))]),
    TEXT.map(Literal),
    TEXT.map(lambda text: Literal(text, language="en")),
    st.builds(
        lambda text, name: Literal(text, datatype=NamedNode(v.XSD + name)),
        LEXICAL,
        st.sampled_from(NUMERIC),
    ),
    TEXT.map(lambda text: Literal(text, datatype=NamedNode("urn:type"))),
)


def solutions(where: str) -> QuerySolutions:
    answer = Store().query(f"SELECT * WHERE {{ {where} }}")
    assert isinstance(answer, QuerySolutions)
    return answer


def both_rows(where: str) -> tuple[str, str]:
    """The rows as read here, and term by term; as text, so that a NaN equals itself."""
    by_terms = tuple(tuple(value_of(term) for term in row) for row in solutions(where))
    return repr(rows_of(solutions(where))), repr(by_terms)


@given(st.lists(st.tuples(TERMS, TERMS), max_size=5))
def test_rows_are_what_the_terms_stand_for(rows: list[tuple[object, ...]]) -> None:
    given_rows = " ".join(
        "(" + " ".join("UNDEF" if term is None else str(term) for term in row) + ")" for row in rows
    )
    read, expected = both_rows(f"VALUES (?a ?b) {{ {given_rows} }}")
    assert read == expected


def test_triples_and_rows_without_columns() -> None:
    for where in (
        'BIND(<<( <urn:a> <urn:b> "x\\ty\\n\\"z\\\\" )>> AS ?t)',
        "BIND(<<( <urn:a> <urn:b> <<( <urn:c> <urn:d> 5 )>> )>> AS ?t)",
        "",
        "FILTER(false)",
    ):
        read, expected = both_rows(where)
        assert read == expected


def test_long_answers_are_read_to_their_end() -> None:
    ((value,),) = rows_of(solutions("BIND(BNODE() AS ?n)"))
    assert str(value).startswith("_:")
    numbers = range(2 * PIECE + 1)
    rows = rows_of(solutions("VALUES ?n { " + " ".join(map(str, numbers)) + " }"))
    assert rows == tuple((number,) for number in numbers)
