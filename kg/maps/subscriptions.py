"""Subscriptions to the commits of a map, and to the rows by which they change a query's result."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from kg.maps.query.query_files import resolve_query
from kg.maps.query.subscriptions import RowsListener, Subscription
from kg.model.transactions import ChangeSet, Listener

if TYPE_CHECKING:
    from kg.maps.semantic_map import SemanticMap


class MapSubscriptions(ABC):
    """Listeners of one map."""

    def __init__(self, semantic_map: SemanticMap) -> None:
        self._map = semantic_map
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
        """Whether anybody but this process's mapper made a transaction."""

    @abstractmethod
    def listen(self, listener: Listener) -> Callable[[], None]:
        """Have `listener` called with each change set once it is stored; returns its unsubscribe.

        It runs on the committing thread: it must be quick, and must not write.
        """

    def on(
        self, question: str | Path, callback: RowsListener, /, **parameters: object
    ) -> Callable[[], None]:
        """Subscribe `callback(added, removed)` to the rows by which commits change a result.

        `question` is as for `SemanticMap.query`. The callback runs on a thread of its own, with two
        Tables; the rows of the first result are not reported. On a plain SPARQL server, commits of
        other programs are noticed within a second. Returns the function that stops it; closing the
        map does too.
        """
        self.catch_up()
        query = resolve_query(question, parameters)
        subscription = Subscription(
            lambda: self._map.query(query, **parameters),
            callback,
            lambda: self._map.sequence,
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

    @property
    def notifies_of_all(self) -> bool:
        """Whether listeners are notified of every transaction up to `catch_up`."""
        return not self._map.store.shared

    def catch_up(self) -> None:
        """Nothing: listeners were notified at each commit."""

    def is_external(self, change: ChangeSet) -> bool:
        """Whether anybody but this process's mapper made a transaction."""
        return change.cause.kind != "frame" or change.cause.by is not None

    def listen(self, listener: Listener) -> Callable[[], None]:
        """Have `listener` called on the committing thread; returns its unsubscribe."""
        return self._map.store.listen(listener)
