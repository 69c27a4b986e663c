"""Many subjects folded side by side say what each of them says folded alone."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyoxigraph import BlankNode, Literal, NamedNode, Quad

from kg import vocabulary as v
from kg.history.replay import batch_replay as states
from kg.history.replay import column_decoding as columns
from kg.history.replay.batch_replay import foreground, states_at
from kg.history.replay.column_decoding import NOTHING, TextColumns, decode_rows
from kg.history.replay.subject_replay import facts_at
from kg.history.storage.log import KEYFRAME, HistoryLog
from kg.history.storage.row_codec import Coded, decode_delta, encode_delta
from kg.maps.semantic_map import SemanticMap
from kg.transactions import Cause, ChangeSet

_TIME = NamedNode(v.XSD + "dateTime")
_HUGE = 10**18  # a difference of two of them takes more than 63 bits
_SUBJECTS = [NamedNode(f"urn:thing:{n}") for n in range(3)] + [BlankNode("b")]
_PREDICATES = [NamedNode(v.X), NamedNode(v.BOX), NamedNode(v.RDF_TYPE)]
_OBJECTS = [
    *(Literal(n) for n in (0, 1, -1, 63, 64, -65, 1 << 40, 4 * _HUGE, -4 * _HUGE, 1 << 70)),
    *(Literal(n / 4) for n in range(-3, 3)),
    *(
        Literal(text)
        for text in ("", "chair", "chair 17", "stühle", "\x7f椅子椅子椅子椅子", "a" * 200)
    ),
    *(Literal("b", language="de"), Literal("2026-01-01T00:00:00Z", datatype=_TIME)),
    *(NamedNode(v.HERE + "Chair"), NamedNode(v.HERE + "Cup"), BlankNode("b")),
]
_GRAPHS = [NamedNode(v.MAP_GRAPH), NamedNode(v.ASSERTIONS_GRAPH), NamedNode(v.ONTOLOGY_GRAPH)]
quads = st.sets(
    st.builds(
        Quad,
        st.sampled_from(_SUBJECTS),
        st.sampled_from(_PREDICATES),
        st.sampled_from(_OBJECTS),
        st.sampled_from(_GRAPHS),
    ),
    max_size=9,
)


@pytest.fixture(params=[0, 2, 24])
def few(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows from which on they are taken one by one."""
    monkeypatch.setattr(columns, "_FEW", request.param)


def coded_of(kind: int) -> st.SearchStrategy[int | str]:
    if kind >= columns.STRING:
        return st.text(st.characters(codec="utf-8"), max_size=12)
    numbers = st.integers(-_HUGE * 4, _HUGE * 4) | st.integers(-200, 200)
    return st.integers(1, 1 << 40) if kind == 0 else numbers


facts = st.integers(0, 5).flatmap(
    lambda kind: st.builds(Coded, st.integers(1, 300), st.just(kind), coded_of(kind))
)
deltas = st.tuples(st.sets(facts, max_size=7), st.sets(facts, max_size=7))


@pytest.mark.usefixtures("few")
@settings(max_examples=25, deadline=None)
@given(st.lists(deltas, max_size=8))
def test_rows_say_the_same_side_by_side(rows: list[tuple[set[Coded], set[Coded]]]) -> None:
    encoded = [encode_delta(sorted(gone, key=str), sorted(came, key=str)) for gone, came in rows]
    texts = TextColumns()
    found = decode_rows(encoded, texts)
    for number, data in enumerate(encoded):
        removed, added = decode_delta(data)
        assert sorted(side(found, number, texts, new=False), key=str) == sorted(removed, key=str)
        assert sorted(side(found, number, texts, new=True), key=str) == sorted(added, key=str)


def side(found: columns.ChangeColumns, row: int, texts: TextColumns, *, new: bool) -> list[Coded]:
    kinds, values = (found.new_kind, found.new) if new else (found.old_kind, found.old)
    lines = zip(found.row, found.predicate, kinds, values, strict=True)
    return [
        Coded(int(p), int(k), texts.all[value] if k >= columns.STRING else int(value))
        for r, p, k, value in lines
        if r == row and k != NOTHING
    ]


@pytest.mark.usefixtures("few")
@settings(max_examples=25, deadline=None)
@given(quads, st.lists(st.tuples(quads, quads), max_size=2 * KEYFRAME + 2), st.integers(0, 1000))
def test_states_are_those_of_each_subject(
    floor: set[Quad], changes: list[tuple[set[Quad], set[Quad]]], moment: int
) -> None:
    log = HistoryLog.open(None, "urn:flat/")
    log.begin(0, 0.0, (q for q in floor if q.graph_name != _GRAPHS[2]))
    for number, (removed, added) in enumerate(changes, 1):
        # neither need the removed have been there, nor the added not: all are sets
        cause = Cause("update")
        log.append(ChangeSet(number, number, cause, tuple(added), tuple(removed - added)))
    sequence = moment % (len(changes) + 1)
    nodes = foreground(log).node.tolist()
    assert {log.terms.pair(n)[0] for n in log.nodes()} - {log.terms.pair(n)[0] for n in nodes} <= {
        _GRAPHS[2]
    }
    told = states_at(log, nodes, sequence)
    for node in nodes:
        assert told.facts(node) == facts_at(log.db, node, sequence)
    assert set(told.node.tolist()) <= set(nodes)


@pytest.mark.parametrize("held", [1, 500])
def test_states_of_a_map_at_any_moment(
    written: Callable[[int], SemanticMap], monkeypatch: pytest.MonkeyPatch, held: int
) -> None:
    monkeypatch.setattr(states, "HELD", held)
    monkeypatch.setattr(states, "AT_ONCE", 3 * held)
    with written(2 * KEYFRAME + 3) as semantic_map:
        log = semantic_map.history
        for sequence in (0, 1, KEYFRAME - 1, KEYFRAME, KEYFRAME + 1, log.last):
            told = states_at(log, foreground(log).node.tolist(), sequence)
            for node in foreground(log).node.tolist():
                assert told.facts(node) == log.facts(node, sequence)
        semantic_map.compact(keep=0.0)
        told = states_at(log, foreground(log).node.tolist(), log.floor)
        for node in foreground(log).node.tolist():
            assert told.facts(node) == log.facts(node, log.floor)


def test_nobody_has_no_states() -> None:
    log = HistoryLog.open(None, "urn:flat/")
    assert len(states_at(log, foreground(log).node.tolist(), 0).node) == 0
