"""The past of a map, as its front door opens on it: `SemanticMap` inherits these."""

from __future__ import annotations

from collections.abc import Iterator

from pyoxigraph import Quad

from kg.commits import ChangeSet
from kg.engine import Engine
from kg.errors import HistoryError
from kg.history.compaction import Compaction, compact, retain
from kg.history.instants import Instant, sequence_of
from kg.history.log import Log
from kg.history.naming import thing
from kg.history.past import Difference, difference, state_of
from kg.history.recovery import without_past
from kg.history.telling import Entry, tell
from kg.history.why import Reason, explain
from kg.store import MapStore


class Remembering:
    """A map that remembers: what it said when, what changed, and why it says what it says."""

    base: str
    _store: MapStore
    _history: Log | None

    def __init__(self, store: MapStore) -> None:
        self._store = store
        self._history = None

    @property
    def engine(self) -> Engine:
        """The live store, here or on a server, for the other modules of this room to read.

        What is written to it directly, no history holds and no writer hears of.
        """
        return self._store.engine

    @property
    def sequence(self) -> int:
        """The number of the last transaction; 0 before the first."""
        return self._store.sequence

    @property
    def history(self) -> Log:
        """The log of all transactions; HistoryError where the map keeps none."""
        if self._history is None:
            remedy = (
                "ask where its folder is"
                if self._store.shared
                else "one begins when the map is opened for writing"
            )
            raise HistoryError(f"the map at {self._store.where} keeps no history; {remedy}")
        return self._history

    def changes(self, since: int = 0) -> Iterator[ChangeSet]:
        """Change sets numbered above `since`, in order; HistoryError where they are not kept."""
        log = self.history
        if since < log.floor:
            raise HistoryError(f"changes up to #{log.floor} are not kept, asked since #{since}")
        return log.changes(since, self.sequence)

    def state_of(self, iri: str, when: Instant) -> tuple[Quad, ...]:
        """All quads about one thing as of `when`, without building the whole map of then."""
        return state_of(self.history, iri, sequence_of(self.history, when))

    def diff(self, t1: Instant, t2: Instant) -> Difference:
        """What the map says at `t2` and not at `t1`, and the other way round."""
        log = self.history
        return difference(log, sequence_of(log, t1), sequence_of(log, t2))

    def log(self, iri: str) -> Iterator[Entry]:
        """Each transaction that changed one thing, in words; `iri` may be short (object/17)."""
        return tell(self.history, thing(iri, self.base), self.base)

    def why(self, what: str) -> tuple[Reason, ...]:
        """Why the map says so: of a thing (object/17), or of a fact ("object/17 here:inPlace").

        Terms may be short (`kg.history.naming`). A map without a history explains what it can.
        Raises QueryParameterError for what the map never said.
        """
        log = self._history or without_past(self._store, self.base)
        return explain(self.engine, log, self.base, what, recorded=self._history is not None)

    def compact(self, keep: float | None = None) -> Compaction:
        """Drop the past more than `keep` seconds back (None: keep all), and pack the history."""
        self._store.refuse_read_only()
        return compact(self.history, keep)

    def retain(self, keep: float) -> None:
        """Remember the last `keep` seconds, while it is open: the rest is dropped as time goes on.

        Raises HistoryError where the map keeps no history, GraphError where it is only read.
        """
        self._store.refuse_read_only()
        if not keep >= 0:
            raise HistoryError(f"what is kept must last 0 s or longer, got {keep:g}")
        retain(self.history, keep)
