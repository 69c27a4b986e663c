"""Facts as bytes: whatever term it is, it comes back to the letter."""

from __future__ import annotations

import sqlite3

from hypothesis import given
from hypothesis import strategies as st
from pyoxigraph import BlankNode, Literal, NamedNode

from kg import vocabulary as v
from kg.history.storage.row_codec import (
    INTERNED,
    OTHER,
    Coded,
    code_literal,
    decode_delta,
    decode_literal,
    decode_numbers,
    encode_delta,
    encode_numbers,
)
from kg.history.storage.schema import SCHEMA
from kg.history.storage.term_dictionary import TermDictionary

_TEXT = st.text(
    st.characters(blacklist_categories=("Cs",), blacklist_characters="\x00"), max_size=12
)
_DATATYPES = st.sampled_from(
    [v.XSD + name for name in ("double", "integer", "dateTime", "decimal", "boolean", "string")]
)
literals = st.one_of(
    st.builds(Literal, st.floats()),
    st.builds(lambda n: Literal(n / 100), st.integers(-100_000, 100_000)),
    st.builds(Literal, st.integers(-(2**63), 2**63 - 1)),
    st.builds(Literal, _TEXT),
    st.builds(lambda text: Literal(text, language="en"), _TEXT),
    st.builds(lambda text, kind: Literal(text, datatype=NamedNode(kind)), _TEXT, _DATATYPES),
    st.builds(
        lambda moment: Literal(
            moment.strftime("%Y-%m-%dT%H:%M:%SZ"), datatype=NamedNode(v.XSD + "dateTime")
        ),
        st.datetimes(),
    ),
)
_INTERNED = st.builds(Coded, st.integers(1, 99), st.just(INTERNED), st.integers(0, 2**40))
_SPELT = st.builds(lambda p, term: Coded(p, *code_literal(term)), st.integers(1, 99), literals)
facts = st.sets(st.one_of(_INTERNED, _SPELT), max_size=12)


@given(literals)
def test_every_literal_comes_back_to_the_letter(literal: Literal) -> None:
    assert decode_literal(*code_literal(literal)) == literal


def test_what_only_looks_like_a_plain_number_is_kept_as_it_is_written() -> None:
    double = NamedNode(v.XSD_DOUBLE)
    for text in ("1.230", "1.23E0", "-0.0", "NaN", "INF", "0.123", " 1.0"):
        assert code_literal(Literal(text, datatype=double)) != code_literal(Literal(1.23))
        assert decode_literal(*code_literal(Literal(text, datatype=double))).value == text
    assert code_literal(Literal("007", datatype=NamedNode(v.XSD + "integer")))[0] == OTHER


@given(facts, facts)
def test_a_change_comes_back_from_its_bytes(removed: set[Coded], added: set[Coded]) -> None:
    delta = decode_delta(encode_delta(removed, added))
    assert set(delta.removed) == removed
    assert set(delta.added) == added


@given(st.sets(st.integers(0, 2**50)))
def test_numbers_come_back_sorted(numbers: set[int]) -> None:
    assert decode_numbers(encode_numbers(numbers)) == sorted(numbers)


def test_a_moved_object_costs_a_few_bytes() -> None:
    before, after = Literal(12.34), Literal(12.35)
    row = encode_delta([Coded(1, *code_literal(before))], [Coded(1, *code_literal(after))])
    assert len(row) <= 6


def test_terms_are_interned_relative_to_the_map_and_come_back() -> None:
    connection = sqlite3.connect(":memory:", isolation_level=None)
    connection.executescript(SCHEMA)
    terms = TermDictionary(connection, "https://example.org/flat/")
    things = [
        NamedNode("https://example.org/flat/object/1"),
        NamedNode("https://example.org/flat/"),
        NamedNode("https://example.org/flatter"),
        NamedNode(v.HERE + "Chair"),
        BlankNode("b0"),
    ]
    numbers = [terms.number(thing) for thing in things]
    assert len(set(numbers)) == len(things)
    terms.forget()
    assert [terms.term(number) for number in numbers] == things
    assert [terms.find(thing) for thing in things] == numbers
    kept = {text for (text,) in connection.execute("SELECT text FROM term")}
    assert "~object/1" in kept
    connection.close()
