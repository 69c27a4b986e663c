"""Subscriptions: to commits of a map, to new rows of a query's result, and caches kept true."""

from __future__ import annotations

import threading
import weakref
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Final

from pyoxigraph import NamedNode

from kg.maps.facts.assertions import Assertions
from kg.maps.query.evaluation import Row, Table
from kg.maps.query.query_files import resolve_query
from kg.model import vocabulary as v
from kg.model.errors import GraphError, RemoteError
from kg.model.records import ObjectRecord
from kg.model.transactions import ChangeSet, Listener
from kg.store.transactional import TransactionalStore

if TYPE_CHECKING:
    from kg.maps.semantic_map import SemanticMap

POLL_EVERY = 1.0  # [s] between polls of a map whose other writers send no notifications

#: Called with the rows added and the rows removed since the last call.
RowsListener = Callable[[Table, Table], None]


class Subscription:
    """A query that is evaluated again after each commit, on a thread of its own, until `stop`.

    A slow query therefore delays no writer; its next evaluation then covers several commits.

    - `answer` evaluates the query.
    - `callback` gets the rows added and removed, not those of the first result. If it raises, the
      subscription ends.
    - `sequence` returns the number of the map's last transaction. With `polls` it is called
      regularly, since other programs may commit without a notification.
    """

    def __init__(
        self,
        answer: Callable[[], Table],
        callback: RowsListener,
        sequence: Callable[[], int],
        *,
        polls: bool,
    ) -> None:
        self._answer, self._callback, self._sequence = answer, callback, sequence
        self._every = POLL_EVERY if polls else None
        self._changed, self._stopped = threading.Event(), threading.Event()
        self._last_sequence = sequence()
        self._last = answer()
        self._thread = threading.Thread(target=self._run, name="subscription", daemon=True)
        self._thread.start()

    def on_commit(self, change: ChangeSet) -> None:
        """Cause a new evaluation; returns at once."""
        self._changed.set()

    def check(self) -> None:
        """Cause a new evaluation if the map has changed since the first result."""
        if self._has_moved():
            self._changed.set()

    def stop(self) -> None:
        """End the subscription, and wait for a running callback (unless called from it)."""
        self._stopped.set()
        self._changed.set()
        if threading.current_thread() is not self._thread:
            self._thread.join()

    def _run(self) -> None:
        with suppress(GraphError):  # the map was closed meanwhile
            while not self._stopped.is_set():
                notified = self._changed.wait(self._every)
                self._changed.clear()
                try:
                    if not self._stopped.is_set() and (notified or self._has_moved()):
                        self._report(self._answer())
                except RemoteError:  # a server may be unreachable or busy for a while
                    self._changed.set()
                    self._stopped.wait(POLL_EVERY)

    def _has_moved(self) -> bool:
        before, self._last_sequence = self._last_sequence, self._sequence()
        return self._last_sequence != before

    def _report(self, now: Table) -> None:
        added, removed = difference(self._last, now)
        self._last = now
        if (added.rows or removed.rows) and not self._stopped.is_set():
            self._callback(added, removed)


def difference(before: Table, now: Table) -> tuple[Table, Table]:
    """Rows of `now` that `before` lacks, and rows of `before` that `now` lacks, in their order."""
    return _without(now, before), _without(before, now)


def _without(table: Table, other: Table) -> Table:
    left = Counter(other.rows)
    rows: list[Row] = []
    for row in table.rows:
        if left[row] > 0:
            left[row] -= 1
        else:
            rows.append(row)
    return Table(table.columns, tuple(rows))


class MapSubscriptions(ABC):
    """Listeners of one map, which `query` reads; `sequence` is its last transaction."""

    def __init__(self, query: Callable[..., Table], sequence: Callable[[], int]) -> None:
        self._query, self._sequence = query, sequence
        self._stops: list[Callable[[], None]] = []

    @property
    @abstractmethod
    def notifies_of_all(self) -> bool:
        """Whether listeners are notified of every transaction up to `catch_up`."""

    @abstractmethod
    def catch_up(self) -> None:
        """Notify listeners of the commits of others so far; in the writer's process, a no-op."""

    @abstractmethod
    def is_external(self, change: ChangeSet) -> bool:
        """Whether a transaction was made by anybody other than this process's mapper."""

    @abstractmethod
    def listen(self, listener: Listener) -> Callable[[], None]:
        """Call `listener` with each change set once it is stored; returns a function that stops it.

        The listener runs on the committing thread: it must be quick, and must not write.
        """

    def on(
        self,
        question: str | Path,
        callback: RowsListener,
        /,
        *,
        language: str = "",
        **parameters: object,
    ) -> Callable[[], None]:
        """Subscribe `callback(added, removed)` to the rows by which commits change a result.

        `question` and `language` are as for `SemanticMap.query`. The callback gets two Tables, on
        a thread of its own; the rows of the first result are not reported. Commits to a map
        published on a SPARQL server are noticed within a second. Returns a function that ends the
        subscription; closing the map ends it too.
        """
        self.catch_up()
        query = resolve_query(question, parameters)
        subscription = Subscription(
            lambda: self._query(query, language=language, **parameters),
            callback,
            self._sequence,
            polls=not self.notifies_of_all,
        )
        unsubscribe = self.listen(subscription.on_commit)

        def stop() -> None:
            if stop in self._stops:
                self._stops.remove(stop)
                unsubscribe()
            subscription.stop()

        self._stops.append(stop)
        subscription.check()  # a commit may have preceded `listen`
        return stop

    def close(self) -> None:
        """End all subscriptions to queries."""
        for stop in tuple(self._stops):
            stop()


class StoredSubscriptions(MapSubscriptions):
    """Listeners of a map in a store, notified on the committing thread."""

    def __init__(self, query: Callable[..., Table], store: TransactionalStore) -> None:
        super().__init__(query, lambda: store.sequence)
        self._store = store

    @property
    def notifies_of_all(self) -> bool:
        """Whether no other program writes to the store unnoticed."""
        return not self._store.shared

    def catch_up(self) -> None:
        """Nothing: listeners were notified at each commit."""

    def is_external(self, change: ChangeSet) -> bool:
        """Whether a transaction is not a mapper's frame."""
        return change.cause.kind != "frame" or change.cause.by is not None

    def listen(self, listener: Listener) -> Callable[[], None]:
        """Call `listener` on the committing thread; returns a function that stops it."""
        return self._store.listen(listener)


_WATCHED: Final = {v.MAP_GRAPH.value, v.ASSERTIONS_GRAPH.value}


class ExternalChanges:
    """Collects the things of graph:map that writers other than the mapper changed.

    Garbage collection unsubscribes it. `take` requests the changes from a running `hereabouts
    serve`.
    """

    def __init__(self, semantic_map: SemanticMap) -> None:
        self._map = semantic_map
        self._assertions = Assertions(semantic_map.base)
        self._lock = threading.Lock()
        self._touched: set[str] = set()
        self._restored = False
        reference = weakref.ref(self)

        def notify(change: ChangeSet) -> None:
            watch = reference()
            if watch is not None:
                watch._on_commit(change)

        weakref.finalize(self, semantic_map.store.listen(notify))

    def take(self) -> frozenset[str]:
        """IRIs of subjects and objects of the quads that changed since the last call."""
        self._map.subscriptions.catch_up()
        if not self._touched:
            return frozenset()
        with self._lock:
            touched, self._touched = frozenset(self._touched), set()
        return touched

    def take_restored(self) -> bool:
        """Whether a past state of the map was restored since the last call."""
        with self._lock:
            restored, self._restored = self._restored, False
        return restored

    def _on_commit(self, change: ChangeSet) -> None:
        if self._map.subscriptions.is_external(change):
            self._add_touched(change)

    def invalidate(self, iris: Iterable[str]) -> None:
        """Count things as changed."""
        with self._lock:
            self._touched |= {*iris}

    def _add_touched(self, change: ChangeSet) -> None:
        names = {
            term.value
            for quad in (*change.added, *change.removed)
            if getattr(quad.graph_name, "value", "") in _WATCHED
            for term in (quad.subject, quad.object)
            if isinstance(term, NamedNode)
        }
        subjects = {self._assertions.subject(name) for name in names} - {None}
        with self._lock:
            self._restored |= change.cause.kind == "restore"
            self._touched |= names | {subject for subject in subjects if subject is not None}


class PerceivedObjects(dict[str, ObjectRecord]):
    """Perceived objects by IRI; `refresh` reads changed objects again."""

    def __init__(self, semantic_map: SemanticMap) -> None:
        self._map = semantic_map
        self._watch = ExternalChanges(semantic_map)
        super().__init__((record.iri, record) for record in semantic_map.perceived.objects())

    def invalidate(self, iris: Iterable[str]) -> None:
        """Mark objects to be read again at the next `refresh`."""
        self._watch.invalidate(iris)

    def refresh(self) -> frozenset[str]:
        """IRIs of things that others changed since the last call; cheap without changes."""
        touched = self._watch.take()
        if not touched:
            return touched
        found = {record.iri: record for record in self._map.perceived.objects(touched)}
        for iri in touched - found.keys():
            self.pop(iri, None)
        self.update(found)
        return touched
