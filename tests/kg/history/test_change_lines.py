"""Change sets as compressed lines: every term comes back to the letter."""

from __future__ import annotations

import zlib
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyoxigraph import BlankNode, Literal, NamedNode, Quad

from kg.history.storage import log_reader
from kg.history.storage.log_reader import (
    LineCodec,
    dictionary_for,
    lines_of,
    net,
    quads_of,
    subject_of,
)
from kg.model import vocabulary as v
from kg.model.errors import HistoryError, InvalidFactError

_CODEC = LineCodec(dictionary_for("https://example.org/flat/"))
_TEXT = st.text(
    st.characters(blacklist_categories=("Cs",), blacklist_characters="\x00"), max_size=12
)
_DATATYPES = st.sampled_from(
    [v.XSD + name for name in ("double", "integer", "dateTime", "decimal", "boolean", "string")]
)
objects = st.one_of(
    st.builds(Literal, st.floats()),
    st.builds(Literal, _TEXT),
    st.builds(lambda text: Literal(text, language="en"), _TEXT),
    st.builds(lambda text, kind: Literal(text, datatype=NamedNode(kind)), _TEXT, _DATATYPES),
    st.sampled_from([NamedNode(v.HERE + "Chair"), BlankNode("b0")]),
)
subjects = st.sampled_from(
    [NamedNode(f"https://example.org/flat/{n}") for n in ("1", "1/belief/x", "10", "ä")]
    + [BlankNode("b"), BlankNode("b0")]
)
quads = st.builds(
    Quad,
    subjects,
    st.sampled_from([NamedNode(v.X), v.RDF_TYPE]),
    objects,
    st.sampled_from([v.MAP_GRAPH, v.ASSERTIONS_GRAPH]),
)
sets = st.sets(quads, max_size=12)


@given(sets, sets)
def test_a_change_comes_back_from_its_bytes(removed: set[Quad], added: set[Quad]) -> None:
    data = _CODEC.encode(lines_of(removed), lines_of(added))
    change = _CODEC.change(data)
    assert (set(quads_of(change.removed)), set(quads_of(change.added))) == (removed, added)


@given(sets, sets, subjects)
def test_one_subject_is_picked_from_a_change(
    removed: set[Quad], added: set[Quad], subject: NamedNode | BlankNode
) -> None:
    name = str(subject).encode()
    whole, part = (lines_of(removed), lines_of(added)), _CODEC.encode
    picked = _CODEC.change_about(part(*whole), name)
    for lines, side in zip(picked, whole, strict=True):
        assert sorted(lines) == sorted(line for line in side if subject_of(line) == name)


@given(st.lists(sets, max_size=6))
def test_net_changes_lead_from_the_first_state_to_the_last(states: list[set[Quad]]) -> None:
    lines = [set(lines_of(state)) for state in (states or [set()])]
    changes = [
        _CODEC.change(_CODEC.encode(before - after, after - before))
        for before, after in pairwise(lines)
    ]
    removed, added = net(changes)
    assert (set(removed), set(added)) == (lines[0] - lines[-1], lines[-1] - lines[0])


def test_names_cost_little_in_a_small_change() -> None:
    thing, graph = NamedNode("https://example.org/flat/object/7"), v.MAP_GRAPH
    before, after = (
        lines_of([Quad(thing, NamedNode(v.X), Literal(x), graph)]) for x in (1.25, 1.5)
    )
    assert len(before[0]) > 100
    assert len(_CODEC.encode(before, after)) < 40


@pytest.mark.parametrize(
    "data",
    [b"\x99 no such block", b"\x00", zlib.compress(b"x" * 100), _CODEC.encode([b"no quad"])],
)
def test_a_damaged_row_is_one_line(data: bytes) -> None:
    with pytest.raises(HistoryError, match=r"damaged.*history\.sqlite"):
        quads_of(_CODEC.state(data))


def test_a_row_that_unpacks_beyond_the_limit_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    line = b'<urn:a> <urn:b> "' + b"x" * 5000 + b'" .'
    data = _CODEC.encode([line])
    monkeypatch.setattr(log_reader, "MAX_TEXT", 4000)
    with pytest.raises(HistoryError, match="more than 4,000 bytes"):
        _CODEC.state(data)
    with pytest.raises(InvalidFactError, match="at most 4,000"):
        _CODEC.encode([line])
