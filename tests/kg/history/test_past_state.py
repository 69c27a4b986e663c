"""The map as it was equals what it was, at every transaction and between any two."""

import re
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyoxigraph import BlankNode, Literal, NamedNode, Quad, Store

from kg.history.point_in_time import PastStates, difference, replay
from kg.history.storage import log as log_module
from kg.history.storage.maintenance import attach
from kg.history.timestamps import duration, instant, iso, moment, spoken
from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.errors import GraphError, HistoryError, InvalidFactError
from kg.model.records import MapUpdate
from kg.model.transactions import Cause, ChangeSet
from kg.serving.opening import create_map, open_map
from kg.store.transaction_quads import stored_sequence
from kg.store.transactional import TransactionalStore
from kg.store.type_inference import complete_types

Written = Callable[[int], SemanticMap]

_SUBJECTS = [NamedNode(f"urn:thing:{n}") for n in range(4)] + [BlankNode("b")]
_PREDICATES = [NamedNode(v.X), v.RDF_TYPE, NamedNode("urn:says")]
_OBJECTS = [
    *(Literal(n / 4) for n in range(6)),
    *(Literal(n) for n in range(3)),
    *(Literal("ä"), Literal("b", language="de"), NamedNode(v.HERE + "Chair"), BlankNode("b")),
]
_GRAPHS = [
    NamedNode(iri)
    for iri in (
        v.MAP_GRAPH.value,
        v.ASSERTIONS_GRAPH.value,
        v.DATASET_GRAPH.value,
        v.ONTOLOGY_GRAPH.value,
    )
]
# blank nodes have no name that outlives a SPARQL update: they come with the ontology alone
quads = st.builds(
    Quad,
    st.sampled_from(_SUBJECTS),
    st.sampled_from(_PREDICATES),
    st.sampled_from(_OBJECTS),
    st.sampled_from(_GRAPHS),
)
named = quads.filter(
    lambda q: not isinstance(q.subject, BlankNode) and not isinstance(q.object, BlankNode)
)
commits = st.lists(st.tuples(st.sets(named, max_size=6), st.sets(named, max_size=6)), max_size=25)


@settings(max_examples=60, deadline=None)
@given(st.sets(quads, max_size=8), commits, st.data())
def test_every_moment_is_what_it_was(first, changes, data):
    with TransactionalStore.in_memory(first) as store:
        log = attach(store, None, "urn:flat/")
        before = [set(store.engine)]
        for delete, insert in changes:
            if store.commit(delete, insert, Cause("update", by="ann")):
                before.append(set(store.engine))
        assert store.sequence == len(before) - 1
        for sequence, facts in enumerate(before):
            then = replay(log, store.engine, sequence)
            assert set(then) == facts
            assert stored_sequence(then) == sequence
        one, other = (data.draw(st.integers(0, len(before) - 1)) for _ in range(2))
        found = difference(log, one, other)
        assert set(found.removed) == _said(before[one] - before[other])
        assert set(found.added) == _said(before[other] - before[one])


def _said(facts: set[Quad]) -> set[Quad]:
    return {quad for quad in facts if quad.predicate.value != v.SEQUENCE}


def test_blank_nodes_are_refused_for_the_log_could_not_name_them() -> None:
    nameless = Quad(BlankNode("b"), _PREDICATES[0], _OBJECTS[0], _GRAPHS[0])
    with TransactionalStore.in_memory([]) as store:
        log = attach(store, None, "urn:flat/")
        with pytest.raises(InvalidFactError, match="blank node"):
            store.commit([], [nameless], Cause("update"))
        assert (store.sequence, log.last, len(store.engine)) == (0, 0, 0)


@pytest.mark.parametrize("flushes", [0, 1, 5])
def test_the_past_does_not_depend_on_where_key_frames_lie(written, frame, monkeypatch, flushes):
    monkeypatch.setattr(log_module, "KEY_FRAME_AFTER", 0)
    frames = 30
    with written(1) as semantic_map:
        for number in range(1, frames):
            semantic_map.apply(frame(number))
            if flushes and not number % (frames // flushes - 1):
                semantic_map.store.flush()
        select = "SELECT count(DISTINCT sequence) FROM state"
        (key_frames,) = semantic_map.history.log.db.execute(select).fetchone()
        assert key_frames == 1 + flushes, "the floor is one too"
        chair = semantic_map.base + "object/1"
        for sequence in range(1, frames + 1):
            facts = {
                q.predicate.value: q.object for q in semantic_map.history.state_of(chair, sequence)
            }
            assert facts[v.OBSERVATION_COUNT] == Literal(sequence)
            assert facts[v.X] == Literal(round(1 + 0.01 * (sequence - 1), 2))


def test_who_reads_the_changes_has_the_map(written: Written) -> None:
    with written(20) as semantic_map:
        heard: list[ChangeSet] = []
        stop = semantic_map.subscriptions.listen(heard.append)
        changes = semantic_map.history.changes()
        assert next(changes).sequence == 1
        semantic_map.apply(MapUpdate(removed=(semantic_map.base + "object/2",)))
        stop()
        assert [change.sequence for change in changes] == [*range(2, 21)]  # up to the first read
        read = list(semantic_map.history.changes())
        assert [change.sequence for change in read] == list(range(1, 22))
        assert (read[-1].time, read[-1].cause) == (heard[0].time, heard[0].cause)
        assert set(read[-1].removed) == set(heard[0].removed)
        follower = Store()
        with semantic_map.at(0) as start:
            follower.extend(start.engine)
        for change in read:
            for quad in change.removed:
                assert quad in follower
                follower.remove(quad)
            follower.extend(change.added)
        complete_types(follower)  # which follow from the changes
        assert set(follower) == _said(set(semantic_map.engine))
        assert [change.sequence for change in semantic_map.history.changes(19)] == [20, 21]


def test_a_past_map_answers_questions_and_refuses_writes(written: Written) -> None:
    with written(10) as semantic_map:
        now = semantic_map.query("objects", least=0).records()
        with semantic_map.at("#4") as then:
            rows = then.query("objects", least=0).records()
            assert [row["observations"] for row in rows] == [4, 4]
            assert then.description.title == semantic_map.description.title
            assert then.query("located-at", category="banana").rows
            with pytest.raises(HistoryError, match="keeps no history"):
                then.at(1)
            assert then.store.read_only
        assert semantic_map.query("objects", least=0).records() == now


def test_a_past_map_goes_with_the_map_it_is_of(written: Written) -> None:
    with written(5) as semantic_map:
        path = semantic_map.store.where
        then = semantic_map.at(3)
        assert len(then.objects()) == 2
    with open_map(path) as again, pytest.raises(GraphError, match="is closed"):
        assert len(again.objects()) == 2
        then.query("places")


def test_moments_by_the_clock(written: Written, frame: Callable[..., MapUpdate]) -> None:
    with written(4) as semantic_map:
        time.sleep(0.01)
        moment = datetime.now(UTC)
        time.sleep(0.01)
        semantic_map.apply(frame(4))
        for when in (moment, moment.isoformat(), iso(moment.timestamp()), "#4", 4):
            assert semantic_map.at(when).sequence == 4
        assert semantic_map.at(datetime.now(UTC)).sequence == 5
        assert semantic_map.at(moment.replace(tzinfo=None)).sequence == 4


@pytest.mark.parametrize(
    ("when", "message"),
    [
        ("#99", "no transaction #99 is kept; there are #0 to #2"),
        (-1, "no transaction #-1 is kept"),
        ("someday", "no moment 'someday'"),
        ("3 days ago", "its past is kept since .* at .*Z"),
        ("0001-01-01T00:00:00+23:00", "no moment"),  # years that cannot be written
        ("9999-12-31T23:59:59-12:00", "no moment"),
        ("2001-01-01", "its past is kept since .* at .*Z"),
    ],
)
def test_moments_that_are_not_there(written: Written, when: int | str, message: str) -> None:
    with written(2) as semantic_map, pytest.raises(HistoryError, match=message):
        semantic_map.at(when)


def test_a_clock_set_back_does_not_turn_the_past_round(written, frame, monkeypatch):
    with written(3) as semantic_map:
        monkeypatch.setattr("kg.rdf.literals.time.time_ns", lambda: 10**12)
        semantic_map.apply(frame(3))
        times = [change.time for change in semantic_map.history.changes()]
        assert times == sorted(times) and times[0] > 1000.0


def test_times_are_what_is_printed_even_within_the_millisecond_a_history_begins(
    written: Written, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("kg.rdf.literals.time.time_ns", lambda: 1_795_344_157_514_876_543)
    monkeypatch.setattr("kg.rdf.literals.time.time", lambda: 1_795_344_157.514876)
    with written(3) as semantic_map:
        times = [change.time for change in semantic_map.history.changes()]
        assert times and all(moment(iso(time)) == time for time in times)


@pytest.mark.parametrize(
    ("text", "seconds"),
    [("30d", 2592000), ("1.5h", 5400), ("90s", 90), ("20 min", 1200), ("2 Weeks", 1209600)]
    + [(text, None) for text in ("", "30", "d", "-1d", "1 month", "3 moons", "1  h")],
)
def test_durations(text: str, seconds: float | None) -> None:
    if seconds is None:
        with pytest.raises(HistoryError, match="no duration"):
            duration(text)
    else:
        assert duration(text) == seconds


class PrunesWhenRead:
    """The engine of a map, whose history is pruned while the engine is read."""

    def __init__(self, semantic_map: SemanticMap) -> None:
        self._map = semantic_map

    def quads_for_pattern(self, *terms: Any) -> Iterator[Quad]:
        self._map.history.compact(keep=0.0)
        return self._map.engine.quads_for_pattern(*terms)


def test_a_past_that_is_dropped_while_it_is_read_is_not_half_told(written: Written) -> None:
    with written(6) as semantic_map:
        log = semantic_map.history.log
        with pytest.raises(HistoryError, match="no longer kept"):
            replay(log, PrunesWhenRead(semantic_map), 2)


def test_a_past_state_holds_what_a_copy_made_then_holds(tmp_path, frame):
    """Frames, people and changes of common sense write; questions are asked of equal stores."""
    copies: dict[int, set[Quad]] = {}
    with create_map(tmp_path / "flat.map", base="https://example.org/flat/") as made:

        def copy(*_: object) -> None:
            if made.sequence in (0, 9, 21, 23):
                copies[made.sequence] = set(made.engine)

        copy()
        made.subscriptions.listen(copy)
        for number in range(18):
            made.apply(frame(number))
        known = "{ GRAPH graph:commonsense { here:Cup here:isA here:Chair } }"
        made.update(f"INSERT DATA {known}", allow=("commonsense",))
        made.assertions.add("object/1", "label", "my chair", by="ann")
        made.apply(MapUpdate(removed=(f"{made.base}object/2",)))
        made.update(f"DELETE DATA {known}", allow=("commonsense",))
        made.apply(frame(22))
        assert [*copies] == [0, 9, 21, 23]
        for number, facts in copies.items():
            past = made.at(number).engine
            assert isinstance(past, Store)
            assert set(past) == facts


def test_a_state_asked_again_is_the_cached_one_and_the_last_ones_are_kept() -> None:
    node, causes = NamedNode("urn:a"), Cause("update")
    with TransactionalStore.in_memory([]) as store:
        log = attach(store, None, "urn:flat/")
        for number in range(4):
            text = f'INSERT DATA {{ GRAPH <urn:g> {{ <urn:a> <urn:b> "{number}" }} }}'
            scratch = Store()
            scratch.update(text)
            store.commit([], scratch, causes)
        states = PastStates(capacity=8)  # facts: state N has N, and its number

        def at(number: int) -> Store:
            return states.at(log, store.engine, number)

        third = at(3)
        assert len(list(third.quads_for_pattern(node, None, None))) == 3
        assert at(3) is third
        second = at(2)
        assert (at(3) is third, at(2) is second) == (True, True)
        at(1)  # 2 + 3 + 4 facts are more than 8: the one asked longest ago goes
        assert (at(2) is second, at(3) is third) == (True, False)


def test_a_state_that_is_withdrawn_is_not_cached() -> None:
    states = PastStates()
    with TransactionalStore.in_memory([]) as store:
        log = attach(store, None, "urn:flat/")
        scratch = Store()
        scratch.update('INSERT DATA { GRAPH <urn:g> { <urn:a> <urn:b> "refused" } }')
        change = store.commit([], scratch, Cause("update"))
        assert change is not None
        number = change.sequence + 1
        log.append(replace(change, sequence=number, removed=tuple(scratch), added=()))
        assert len(states.at(log, store.engine, number)) == 1  # its number
        log.withdraw(number)
        scratch.update('INSERT DATA { GRAPH <urn:g> { <urn:a> <urn:b> "accepted" } }')
        store.commit([], scratch, Cause("update"))
        assert len(states.at(log, store.engine, number)) == 3


def test_a_time_is_said_in_words_that_are_read_as_that_time() -> None:
    now = time.time() // 60 * 60
    assert spoken(now).startswith("today at ")
    assert spoken(now - 86400).startswith("yesterday at ")
    for seconds in (now, now - 86400):
        assert moment(instant(spoken(seconds), time.time())) == seconds
    assert re.fullmatch(r"on 20\d\d-\d\d-\d\d at \d\d:\d\d", spoken(now - 9 * 86400))
