"""Subscriptions to a map on a server: its commits are read from the change stream."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Collection, Iterable, Iterator
from typing import Final

from kg.maps.semantic_map import SemanticMap
from kg.maps.subscriptions import MapSubscriptions
from kg.model import vocabulary as v
from kg.model.errors import HistoryError, RemoteError
from kg.model.transactions import Cause, ChangeSet, Listener
from kg.serving.client.change_stream import ChangeStream
from kg.serving.client.served_server import ServedClient
from kg.store.sparql_backend import SparqlBackend

RETRY_AFTER: Final = 5.0  # [s] until a refused subscription to the change stream is retried


class RemoteSubscriptions(MapSubscriptions):
    """Listeners of one served map, and the number of the last transaction that was read."""

    def __init__(self, semantic_map: SemanticMap, served: ServedClient) -> None:
        super().__init__(semantic_map.query, lambda: semantic_map.sequence)
        self._map = semantic_map
        self._served = served
        self._guard = threading.RLock()
        self._notified = served.sequence  # the last transaction that listeners were notified of
        self._caught_up = self._notified  # the last one that `catch_up` has read
        self._own: set[int] = set()  # transactions since then that this process made
        self._open_holds = 0  # blocks of `hold` that are open
        self._followers: list[ChangeStream] = []
        self._thread: threading.Thread | None = None  # reads the change stream for listeners
        self._closed = threading.Event()

    @property
    def notifies_of_all(self) -> bool:
        """Whether listeners are notified of every transaction up to `catch_up`."""
        return True

    def catch_up(self) -> None:
        """Notify listeners of the commits of others so far (within `hold`: before its start).

        Raises HistoryError if the server does not keep them any more.
        """
        with self._guard:
            if self._open_holds:
                return
            self._notify(self._served.changes(self._notified))
            self._caught_up = self._notified
            self._own.clear()

    def is_external(self, change: ChangeSet) -> bool:
        """Whether a transaction was not made by `SemanticMap.apply` of this object."""
        return change.sequence not in self._own

    @contextlib.contextmanager
    def hold(self) -> Iterator[None]:
        """Lock the map against other threads; writes are checked for conflicts since its start."""
        with self._guard:
            self.catch_up()
            self._open_holds += 1
            try:
                yield
            finally:
                self._open_holds -= 1

    @contextlib.contextmanager
    def writing(self) -> Iterator[tuple[int, Collection[int], Callable[[ChangeSet], None]]]:
        """The last transaction read, the own transactions, and a function to register a new one."""
        with self._guard:
            yield self._caught_up, self._own, self._written

    def _written(self, change: ChangeSet) -> None:
        self._own.add(change.sequence)
        is_next = change.sequence == self._notified + 1
        self._notify((change,) if is_next else self._served.changes(self._notified))

    def follow(self, since: int | None = None) -> Iterator[ChangeSet]:
        """Change sets numbered above `since` (None: from now on), then each further one.

        Waits for each next one, and reconnects if necessary; ends when the map is closed.
        Raises HistoryError if the server does not keep the next one any more.
        """
        with self._guard:
            start = self._map.sequence if since is None else since
            follower = ChangeStream(self._served.root, start)
            self._followers.append(follower)
        if self._closed.is_set():  # the map was closed before the stream was registered
            follower.close()
        try:
            yield from follower
        finally:
            follower.close()
            self._followers.remove(follower)

    def listen(self, listener: Listener) -> Callable[[], None]:
        """Call `listener` with each change set of any writer; returns a function that stops it.

        The listener runs on a thread of this map or on the writing thread; it must be quick.
        """
        stop = self._map.store.listen(listener)
        with self._guard:
            if self._thread is None:
                self._thread = threading.Thread(target=self._listen, name="changes", daemon=True)
                self._thread.start()
        return stop

    def close(self) -> None:
        """End the streams and all subscriptions to queries."""
        self._closed.set()
        for follower in tuple(self._followers):
            follower.close()
        if self._thread is not None and threading.current_thread() is not self._thread:
            self._thread.join()
        super().close()

    def _listen(self) -> None:
        """Notify listeners of the change stream until the map is closed."""
        while not self._closed.is_set():
            follower = ChangeStream(self._served.root, self._notified)
            self._followers.append(follower)
            try:
                if not self._closed.is_set():
                    self._notify_of(follower)
            except RemoteError:
                self._closed.wait(RETRY_AFTER)
            finally:
                self._followers.remove(follower)

    def _notify_of(self, follower: Iterable[ChangeSet]) -> None:
        try:
            for change in follower:
                with self._guard:
                    if not self._closed.is_set():
                        self._notify((change,))
        except HistoryError as error:
            # the changes in between are lost: notify listeners of one empty change
            now = self._served.sequence
            with self._guard:
                self._notified = now - 1
                cause = Cause("recovery", note=str(error))
                self._notify((ChangeSet(now, time.time(), cause, (), ()),))

    def _notify(self, changes: Iterable[ChangeSet]) -> None:
        """Notify listeners of new transactions, in order."""
        for change in changes:
            if change.sequence <= self._notified:
                continue
            engine = self._map.engine
            if isinstance(engine, SparqlBackend):
                engine.not_before(change.sequence)
            if any(q.graph_name == v.ONTOLOGY_GRAPH for q in (*change.added, *change.removed)):
                self._map.ontology.reread()
            self._notified = change.sequence
            self._map.store.notify(change)
