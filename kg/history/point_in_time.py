"""Point-in-time queries: states and versions of one thing, and differences of two moments."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from pyoxigraph import NamedNode, Quad, RdfFormat, Store

from kg.history.storage.log import BACKGROUND, HistoryLog
from kg.history.storage.log_reader import net, quads_of
from kg.history.timestamps import brief, natural_order, short, word
from kg.model.errors import HistoryError
from kg.rdf.quad_store import QuadStore
from kg.store.transaction_quads import sequence_quad, stored_sequence
from kg.store.transactional import TransactionalStore
from kg.store.type_inference import complete_types

MAX_STEPS: Final = 200  # transactions read one by one; with more, two states are compared


@dataclass(frozen=True, slots=True)
class Difference:
    """The difference between the states after two transactions."""

    before: int  # sequence numbers
    after: int
    added: tuple[Quad, ...]
    removed: tuple[Quad, ...]

    def __len__(self) -> int:
        return len(self.added) + len(self.removed)

    def rows(self, base: str) -> list[tuple[str, str, str, str, str]]:
        """Rows of (``+``, ``-`` or ``~``, thing, property, before, after) in words, by thing."""
        sides: dict[tuple[str, str], tuple[list[str], list[str]]] = {}
        for side, quads in enumerate((self.removed, self.added)):
            for quad in quads:
                key = short(quad.subject, base), word(quad.predicate)
                sides.setdefault(key, ([], []))[side].append(brief(quad.object, base))
        rows = []
        for (subject, what), (before, after) in sides.items():
            sign = "~" if before and after else "+" if after else "-"
            rows.append((sign, subject, what, ", ".join(sorted(before)), ", ".join(sorted(after))))
        return sorted(rows, key=lambda row: (natural_order(row[1]), row[2]))


def state_of(log: HistoryLog, iri: str, sequence: int) -> tuple[Quad, ...]:
    """All quads about `iri` after `sequence`, without ontology and common sense."""
    return tuple(sorted(quads_of(log.facts(sequence, subject_line(iri))), key=str))


def difference(log: HistoryLog, before: int, after: int) -> Difference:
    """The net change between two transactions."""
    if before > after:
        turned = difference(log, after, before)
        return Difference(before, after, turned.removed, turned.added)
    background = net(log.change_lines(before, after, background=True))
    if after - before <= MAX_STEPS:
        removed, added = net(log.change_lines(before, after))
    else:
        old, new = log.facts(before), log.facts(after)
        removed, added = sorted(old - new), sorted(new - old)
    log.check_kept(before)
    return Difference(
        before,
        after,
        tuple(quads_of(background.added + added)),
        tuple(quads_of(background.removed + removed)),
    )


def subject_line(iri: str) -> bytes:
    """The IRI as in N-Quads; raises HistoryError if it is not absolute."""
    try:
        return str(NamedNode(iri)).encode()
    except ValueError:
        raise HistoryError(f"needs an absolute IRI, got {iri!r}") from None


@dataclass(frozen=True, slots=True)
class Version:
    """A version of a thing: its facts from one transaction that changed them until the next."""

    sequence: int
    time: float  # [s] since 1970-01-01 UTC
    empty: bool = False  # without facts: the thing had been removed


def versions(
    log: HistoryLog, iri: str, *, until: int | None = None, max_count: int = 1000
) -> list[Version]:
    """The last `max_count` versions (-1: all) up to the transaction `until`, the latest first.

    Ontology and common sense have no versions, since the log does not keep their first state.
    Raises HistoryError if `iri` is no absolute IRI.
    """
    subject, found = subject_line(iri), list[Version]()
    with log.lock:
        changes = log.history(subject, until, max_count)
        facts = log.facts(changes[0][0] - 1 if changes else log.floor, subject)
        if facts and len(changes) != max_count:
            found.append(Version(log.floor, log.floor_time))
        for sequence, change in changes:
            commit = log.commit(sequence)
            facts.difference_update(change.removed)
            facts.update(change.added)
            if commit is not None:
                found.append(Version(sequence, commit.time, not facts))
    return found[::-1]


def version_at(log: HistoryLog, iri: str, sequence: int) -> Version | None:
    """The version right after a transaction; None if the log has no version until then."""
    return next(iter(versions(log, iri, until=sequence, max_count=1)), None)


def first_version(log: HistoryLog, iri: str) -> Version | None:
    """The oldest version that is kept and has facts."""
    found = [version for version in versions(log, iri, max_count=-1) if not version.empty]
    return found[-1] if found else None


MAX_CACHED: Final = 300_000  # facts of all cached states together; about 150 MB


def replay(log: HistoryLog, present: QuadStore, sequence: int) -> Store:
    """A store of all facts of the map right after the transaction `sequence`.

    `present` holds the state of now, or after any later transaction. Raises HistoryError if the
    moment is not kept, or is dropped meanwhile.
    """
    store, text = Store(), b"\n".join(log.facts(sequence))
    if b"_:" in text:  # a bulk load renames blank nodes
        store.bulk_extend(quads_of(text.splitlines()))
    else:
        store.bulk_load(text, RdfFormat.N_QUADS, lenient=True)
    store.bulk_extend(background_at(log, present, sequence))
    if sequence:
        store.add(sequence_quad(sequence))
    complete_types(store)
    log.check_kept(sequence)
    return store


def background_at(log: HistoryLog, engine: QuadStore, sequence: int) -> set[Quad]:
    """The quads of ontology and common sense after the transaction `sequence`.

    `engine` holds the present state, or any state since `sequence`; it may be written meanwhile.
    """
    quads = {q for graph in BACKGROUND for q in engine.quads_for_pattern(None, None, None, graph)}
    # the log is read after the engine, so that it covers every change in the engine
    for quad, present in background_changes(log, sequence).items():
        (quads.add if present else quads.discard)(quad)
    return quads


def background_changes(log: HistoryLog, sequence: int) -> dict[Quad, bool]:
    """Quads of ontology and common sense that changed after `sequence`; True: present then.

    The first change of a quad decides, so that the result does not depend on the number of later
    changes in an engine.
    """
    present: dict[Quad, bool] = {}
    for change in log.change_lines(sequence, log.last, background=True):
        for side, before in zip(change, (True, False), strict=True):
            for quad in quads_of(side):
                present.setdefault(quad, before)
    return present


class PastStates:
    """Cache of the most recently used past states of one map; safe from several threads.

    `capacity` is the maximum number of facts of all states together; the last state is always kept.
    """

    def __init__(self, capacity: int = MAX_CACHED) -> None:
        self._capacity = capacity
        self._states: OrderedDict[int, tuple[Store, int]] = OrderedDict()  # with their sizes
        self._lock = threading.Lock()

    def at(self, log: HistoryLog, present: QuadStore, sequence: int) -> Store:
        """The state right after `sequence`, from the cache or replayed; raises as `replay`."""
        log.check_kept(sequence)
        with self._lock:  # a waiting thread then finds the state in the cache
            cached = self._states.pop(sequence, None)
            if cached is None:
                if self._size() > self._capacity:
                    self._states.clear()  # two large states may not fit into memory
                store = replay(log, present, sequence)
                cached = store, len(store)
            # a transaction that the store does not hold yet may still be withdrawn
            if sequence <= stored_sequence(present):
                self._states[sequence] = cached
                while len(self._states) > 1 and self._size() > self._capacity:
                    self._states.popitem(last=False)
            return cached[0]

    def _size(self) -> int:
        return sum(size for _, size in self._states.values())


class PastStore(TransactionalStore):
    """The read-only store of a past state, usable while its map is open."""

    def __init__(self, state: Store, sequence: int, present: Callable[[], QuadStore]) -> None:
        """`present` returns the map's engine, or raises GraphError if the map is closed."""
        super().__init__(state, where=f"#{sequence} of the past", read_only=True, lock=None)
        self._present = present

    @property
    def engine(self) -> QuadStore:
        """The state; raises GraphError after this store or its map is closed."""
        self._present()
        return super().engine
