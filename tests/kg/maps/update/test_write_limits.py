"""Writes that others wait for: linear in the document, beside each other, within limits."""

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from pyoxigraph import BlankNode, Literal, NamedNode, Quad

from kg.maps.stored_map import StoredMap
from kg.maps.update.change_draft import ChangeDraft, GroundUpdate, QuadChange, ReadState
from kg.model import vocabulary as v
from kg.model.errors import (
    ConflictError,
    GraphError,
    InvalidFactError,
    PoolBusyError,
    QueryTimeoutError,
)
from kg.model.transactions import Cause
from kg.serving.opening import create_map, open_map
from kg.store.scheduling import MAX_FACTS, WriteLimit, WriterLock, check_time
from kg.store.transactional import LOADED, TransactionalStore

BASE = "https://example.org/maps/limits/"
RDF = "http://www.w3.org/1999/02/22-rdf-syntax-ns#"


def fact(subject: str | BlankNode, predicate: str, value: object) -> Quad:
    node = subject if isinstance(subject, BlankNode) else NamedNode(subject)
    term = value if isinstance(value, NamedNode | BlankNode) else Literal(value)  # type: ignore[arg-type]
    return Quad(node, NamedNode(predicate), term, v.MAP_GRAPH)


def subjects(n: int) -> Iterator[Quad]:
    return (fact(f"urn:e:{n}:{i}", "urn:p", i) for i in range(n))


def one_subject(n: int) -> Iterator[Quad]:
    return (fact(f"urn:one:{n}", "urn:p", i) for i in range(n))


def one_object(n: int) -> Iterator[Quad]:
    return (fact(f"urn:o:{n}:{i}", "urn:p", NamedNode(f"urn:hub:{n}")) for i in range(n))


def a_list(n: int) -> Iterator[Quad]:
    nodes = [BlankNode() for _ in range(n)]
    for i, node in enumerate(nodes[:-1]):
        yield fact(node, RDF + "first", i)
        yield fact(node, RDF + "rest", nodes[i + 1])


def labels(n: int) -> Iterator[Quad]:
    return (fact(f"urn:l:{n}", v.RDFS_LABEL, f"label {i}") for i in range(n))


SHAPES = (subjects, one_subject, one_object, a_list, labels)


@pytest.fixture
def semantic_map(tmp_path: Path) -> Iterator[StoredMap]:
    with create_map(tmp_path / "limits.map", base=BASE) as made:
        assert isinstance(made, StoredMap)
        yield made


def added(quads: Iterator[Quad] | list[Quad]) -> GroundUpdate:
    return GroundUpdate((QuadChange((), tuple(quads)),))


@pytest.fixture
def quads_read(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """A list whose one number is how many quads a change has read so far."""
    count = [0]
    read = ReadState.quads_for_pattern

    def counted(state: ReadState, *pattern: Any) -> Iterator[Quad]:
        for quad in read(state, *pattern):
            count[0] += 1
            yield quad

    monkeypatch.setattr(ReadState, "quads_for_pattern", counted)
    return count


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.__name__)
def test_the_work_of_a_write_is_linear_in_its_document(semantic_map, quads_read, shape):
    taken = []
    for n in (100, 1000):
        quads = tuple(shape(n))
        for update in (QuadChange((), quads), QuadChange(quads, ())):
            quads_read[0] = 0
            semantic_map.apply_ground(GroundUpdate((update,)), "", by="ann")
            taken.append(quads_read[0])
    assert taken[2] <= 30 * max(taken[0], 100)  # quadratic: 100 times
    assert taken[3] <= 30 * max(taken[1], 100)


def test_others_write_while_a_large_document_is_validated(semantic_map: StoredMap) -> None:
    thread = threading.Thread(
        target=lambda: semantic_map.apply_ground(added(subjects(2_000)), "", by="ann")
    )
    thread.start()
    numbers = []
    while thread.is_alive():
        change = semantic_map.apply_ground(added(subjects(len(numbers) + 1)), "", by="bob")
        assert change is not None
        numbers.append(change.sequence)
    thread.join()
    (large,) = {*range(1, semantic_map.sequence + 1)} - {*numbers}
    assert min(numbers) < large


def test_a_draft_notices_that_others_changed_what_it_read(semantic_map: StoredMap) -> None:
    store, cause = semantic_map.store, Cause("update", by="bob")
    draft = ChangeDraft(store)
    draft.change((), [fact("urn:read", "urn:p", 1)])
    draft.facts(NamedNode("urn:other"), "urn:p")
    assert not list(draft.after(None, None, NamedNode("urn:target"), v.MAP_GRAPH))
    for quad, stale in (
        (fact("urn:elsewhere", "urn:p", 1), False),
        (fact("urn:read", "urn:q", 1), True),
        (fact("urn:other", "urn:q", 1), True),
        (fact("urn:elsewhere", "urn:q", NamedNode("urn:target")), True),
        (Quad(NamedNode("urn:c"), v.RDF_TYPE, NamedNode(v.OWL_CLASS), v.ONTOLOGY_GRAPH), True),
    ):
        change = store.commit([], [quad], cause)
        assert change is not None
        assert draft.state.is_changed_by(change) is stale


class Interrupted(tuple[QuadChange, ...]):
    """Steps of an update; another writes while they are read for the first time."""

    write: Callable[[], object] | None = None

    def __iter__(self) -> Iterator[QuadChange]:
        yield from super().__iter__()
        write, self.write = self.write, None
        if write is not None:
            write()


def test_a_document_is_validated_again_when_others_change_what_it_reads(semantic_map):
    """A fact that another deletes meanwhile is no change of this update any more."""
    quad, store = fact("urn:e", "urn:p", 1), semantic_map.store
    store.commit([], [quad], Cause("update", by="bob"))
    steps = Interrupted([QuadChange((quad,), ())])
    steps.write = lambda: store.commit([quad], [], Cause("update", by="bob"))
    assert semantic_map.apply_ground(GroundUpdate(steps), "", by="ann") is None
    assert steps.write is None


def test_a_check_that_fails_under_the_lock_writes_nothing(semantic_map: StoredMap) -> None:
    def check() -> None:
        raise ConflictError("others wrote")

    before = semantic_map.sequence
    with pytest.raises(ConflictError):
        semantic_map.apply_ground(added(subjects(3)), "", by="ann", check=check)
    assert semantic_map.sequence == before


def test_a_write_ends_at_its_time_limit(semantic_map: StoredMap) -> None:
    with WriteLimit(0.05).in_force(), pytest.raises(QueryTimeoutError, match=r"more than 0\.05 s"):
        semantic_map.apply_ground(added(subjects(5000)), "", by="ann")
    assert semantic_map.sequence == 0


def test_a_write_ends_with_the_server(semantic_map: StoredMap) -> None:
    limit = WriteLimit(10.0)
    limit.ending.set()
    with limit.in_force(), pytest.raises(PoolBusyError, match="the server ends"):
        semantic_map.apply_ground(added(subjects(5)), "", by="ann")
    assert semantic_map.sequence == 0


def test_too_many_facts_are_refused_where_others_wait(semantic_map: StoredMap) -> None:
    update = added(one_subject(MAX_FACTS + 1))
    for write in (
        lambda: semantic_map.apply_ground(update, "", by="ann"),
        lambda: semantic_map.store.commit([], update.steps[0].insert, Cause("update")),
    ):
        with WriteLimit(60.0).in_force(), pytest.raises(InvalidFactError, match="60,001 facts"):
            write()
    assert semantic_map.sequence == 0


def test_a_limited_write_does_not_wait_forever_for_the_lock() -> None:
    lock, held, done = WriterLock(), threading.Event(), threading.Event()

    def hold() -> None:
        with lock:
            held.set()
            done.wait(60)

    thread = threading.Thread(target=hold)
    thread.start()
    held.wait(60)
    try:
        with WriteLimit(0.05).in_force(), pytest.raises(PoolBusyError, match="others write"), lock:
            pass
    finally:
        done.set()
        thread.join()


def test_a_limited_write_holds_the_lock_no_longer_for_taking_it_twice(monkeypatch):
    monkeypatch.setattr("kg.store.scheduling.HELD", 0.02)
    with WriteLimit(60.0).in_force(), WriterLock() as lock:
        began = time.thread_time()
        while time.thread_time() < began + 0.03:
            pass
        with lock, pytest.raises(QueryTimeoutError, match="makes others wait"):
            check_time()


class BrokenStore(TransactionalStore):
    """A store whose disk fails after the facts of a transaction were loaded."""

    breaks = False

    def _update(self, sparql: str) -> None:
        if self.breaks:
            self._failed = True
            raise GraphError("the disk failed")
        super()._update(sparql)


def test_a_large_transaction_is_whole_after_a_crash_or_is_taken_back(tmp_path: Path) -> None:
    path = tmp_path / "house.map"
    quads = list(subjects(LOADED + 1))
    with create_map(path, base=BASE):
        pass
    with open_map(path) as semantic_map:
        store = semantic_map.store
        store.__class__ = BrokenStore
        assert isinstance(store, BrokenStore)
        store.breaks = True
        with pytest.raises(GraphError, match="the disk failed"):
            store.commit([], quads, Cause("update", by="ann"))
        store.breaks = False
        store.recover()
        assert quads[0] not in store.engine
        assert store.sequence == 0
        assert store.journal is not None
        store.breaks = True
        with pytest.raises(GraphError, match="the disk failed"):
            store.commit([], quads, Cause("update", by="ann"))
        store.journal, store._loaded = None, None  # as a process that is killed here
    with open_map(path) as semantic_map:
        assert semantic_map.sequence == 1
        assert all(quad in semantic_map.engine for quad in quads)
