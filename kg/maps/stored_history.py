"""The history of a map in a store: change sets, past states, and the reasons for its facts."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

from pyoxigraph import Quad

from kg.history.map_state import Categories
from kg.history.point_in_time import Difference, PastStates, PastStore, difference, state_of
from kg.history.reports.comparison import FAR, Comparison, compare
from kg.history.storage.log import HistoryLog
from kg.history.storage.maintenance import without_past
from kg.history.timestamps import Instant, sequence_of, thing
from kg.maps.map_parts import lazy
from kg.model.errors import HistoryError
from kg.model.transactions import ChangeSet
from kg.store.transactional import TransactionalStore

if TYPE_CHECKING:
    from kg.history.reports.events import HistoryEvent
    from kg.history.reports.explanation import Explanation
    from kg.history.storage.maintenance import Compaction


class StoredHistory:
    """The history of the map in `store`, as `kg.maps.map_parts.MapHistory` documents it.

    `surface_area` gives [m^2] of the map's surface at a transaction.
    """

    _states: PastStates = lazy(lambda _: PastStates())

    def __init__(
        self,
        store: TransactionalStore,
        base: str,
        log: HistoryLog | None,
        surface_area: Callable[[int], float],
    ) -> None:
        self._store, self._base, self._log = store, base, log
        self._surface_area = surface_area

    @property
    def log(self) -> HistoryLog:
        """The log of all transactions; HistoryError where the map keeps none."""
        if self._log is None:
            remedy = (
                "read it from its folder, or ask a running `hereabouts serve` by log, diff and --at"
                if self._store.shared
                else "one begins when the map is opened for writing"
            )
            raise HistoryError(f"the map at {self._store.where} keeps no history here; {remedy}")
        return self._log

    def changes(self, since: int = 0) -> Iterator[ChangeSet]:
        """Change sets numbered above `since`, in order."""
        log = self.log
        if since < log.floor:
            raise HistoryError(f"changes up to #{log.floor} are not kept, requested since #{since}")
        return log.changes(since, self._store.sequence)

    def store_at(self, sequence: int) -> PastStore:
        """The state after a transaction, replayed into memory; the last ones are cached."""
        state = self._states.at(self.log, self._store.engine, sequence)
        return PastStore(state, sequence, lambda: self._store.engine)

    def state_of(self, iri: str, when: Instant) -> tuple[Quad, ...]:
        """All quads about one thing at `when`."""
        return state_of(self.log, iri, sequence_of(self.log, when))

    def diff(self, t1: Instant, t2: Instant) -> Difference:
        """Quads of `t2` that `t1` lacks, and the other way round."""
        log = self.log
        return difference(log, sequence_of(log, t1, since=True), sequence_of(log, t2))

    def compare(self, t1: Instant, t2: Instant | None = None, far: float = FAR) -> Comparison:
        """The objects that appeared, are gone, moved or have another name, from `t1` to `t2`."""
        log, categories = self.log, Categories.of(self._store.engine)
        before = sequence_of(log, t1, since=True)
        after = log.last if t2 is None else sequence_of(log, t2)
        found = compare(log, categories, self._base, before, after, far)
        return replace(found, surface=(self._surface_area(before), self._surface_area(after)))

    def events(self, iri: str) -> Iterator[HistoryEvent]:
        """The history events of one thing."""
        from kg.history.reports.events import history_events

        return history_events(self.log, self._store.engine, thing(iri, self._base), self._base)

    def explain(self, what: str) -> tuple[Explanation, ...]:
        """The reasons for a thing or a fact; without a history, only those in the graph."""
        from kg.history.reports.explanation import explain_fact

        log = self._log or without_past(self._store, self._base)
        return explain_fact(
            self._store.engine, log, self._base, what, recorded=self._log is not None
        )

    def compact(self, keep: float | None = None) -> Compaction:
        """Drop the past older than `keep` seconds, and pack the file."""
        from kg.history.storage.maintenance import compact

        self._store.check_writable()
        return compact(self.log, keep)

    def retain(self, keep: float) -> None:
        """Drop the past older than `keep` seconds, now and while the map is open."""
        from kg.history.storage.maintenance import retain

        self._store.check_writable()
        if not keep >= 0:
            raise HistoryError(f"the retained time must be 0 s or longer, got {keep:g}")
        retain(self.log, keep)
