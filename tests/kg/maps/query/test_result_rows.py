"""Rows read from the engine's text are the rows its own terms stand for."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st
from pyoxigraph import Literal, NamedNode, QuerySolutions, Store

from kg.maps.query.evaluation import PIECE, rows_of, value_of
from kg.model import vocabulary as v

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


def both(where: str) -> tuple[str, str]:
    """The rows as read here, and term by term; as text, so that a NaN equals itself."""
    by_terms = tuple(tuple(value_of(term) for term in row) for row in solutions(where))
    return repr(rows_of(solutions(where))), repr(by_terms)


@given(st.lists(st.tuples(TERMS, TERMS), max_size=5))
def test_rows_are_what_the_terms_stand_for(rows: list[tuple[object, ...]]) -> None:
    given_rows = " ".join(
        "(" + " ".join("UNDEF" if term is None else str(term) for term in row) + ")" for row in rows
    )
    read, expected = both(f"VALUES (?a ?b) {{ {given_rows} }}")
    assert read == expected


def test_triples_and_rows_without_columns() -> None:
    for where in (
        'BIND(<<( <urn:a> <urn:b> "x\\ty\\n\\"z\\\\" )>> AS ?t)',
        "BIND(<<( <urn:a> <urn:b> <<( <urn:c> <urn:d> 5 )>> )>> AS ?t)",
        "",
        "FILTER(false)",
    ):
        read, expected = both(where)
        assert read == expected


def test_a_blank_node_is_told_by_its_label() -> None:
    ((value,),) = rows_of(solutions("BIND(BNODE() AS ?n)"))
    assert isinstance(value, str)
    assert value.startswith("_:")


def test_long_answers_are_read_to_their_end() -> None:
    numbers = range(2 * PIECE + 1)
    rows = rows_of(solutions("VALUES ?n { " + " ".join(map(str, numbers)) + " }"))
    assert rows == tuple((number,) for number in numbers)
