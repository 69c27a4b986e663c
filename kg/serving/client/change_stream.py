"""Change stream: the transactions of a running `hereabouts serve`, as server-sent events.

Each transaction is delivered once, in order, without a gap. After a broken connection or a restart
of the server the stream continues after the last one.
"""

from __future__ import annotations

import contextlib
import json
import threading
import time
from collections.abc import Callable, Collection, Iterable, Iterator
from typing import Final

import requests
from urllib3.exceptions import HTTPError

from kg.maps.semantic_map import SemanticMap
from kg.maps.subscriptions import MapSubscriptions
from kg.model import vocabulary as v
from kg.model.errors import HistoryError, RemoteError
from kg.model.transactions import Cause, ChangeSet, Listener
from kg.serving.client.record_codec import change_from_json, decoded_reply
from kg.serving.client.served_server import ServedClient
from kg.store.http_session import HttpSession
from kg.store.sparql_backend import SparqlBackend
from kg.store.sparql_client import without_secrets

SILENCE: Final = 60.0  # [s] without event or heartbeat until a connection is closed
PAUSES: Final = (0.1, 0.5, 2.0, 5.0)  # [s] before the 1st, 2nd, ... attempt after a failed one

_BUSY: Final = (429, 502, 503, 504)
_BROKEN: Final = (OSError, HTTPError, EOFError)
_CHUNK: Final = 1 << 16


class ChangeStream:
    """Iterates over the change sets numbered above `since`, and waits for later ones.

    `close`, from any thread, ends the iteration. Raises HistoryError if the server does not keep
    the next change set any more, RemoteError if it refuses the stream.
    """

    def __init__(self, root: str, since: int) -> None:
        self._root, self.since = root.rstrip("/"), since
        self._over = threading.Event()
        self._http = HttpSession(root)

    def __iter__(self) -> Iterator[ChangeSet]:
        failed = 0
        try:
            while not self._over.is_set():
                try:
                    for change in self._connected():
                        failed, self.since = 0, change.sequence
                        yield change
                        if self._over.is_set():
                            return
                except _BROKEN:
                    pass
                self._over.wait(PAUSES[min(failed, len(PAUSES) - 1)])
                failed += 1
        finally:
            self._http.close()

    def close(self) -> None:
        """End the iteration."""
        self._over.set()
        self._http.interrupt()
        self._http.close()

    def _connected(self) -> Iterator[ChangeSet]:
        """The change sets of one connection."""
        with self._http.send(
            "GET",
            f"{self._root}/changes",
            headers={"Accept": "text/event-stream", "Accept-Encoding": "identity"},
            seconds=SILENCE,
            safe=True,
            params={"since": str(self.since)},
            stream=True,
        ) as reply:
            self._check_status(reply)
            where = without_secrets(self._root)
            for data in _data(reply):
                yield decoded_reply(where, lambda data: change_from_json(json.loads(data)), data)

    def _check_status(self, reply: requests.Response) -> None:
        if reply.status_code == 200:
            return
        detail = " ".join(reply.raw.read(2000).decode("utf-8", "replace").split())
        if reply.status_code in _BUSY:
            raise EOFError(detail)
        if reply.status_code == 410:
            raise HistoryError(detail)
        where, status = without_secrets(self._root), reply.status_code
        raise RemoteError(f"{where} refused the change stream ({status}): {detail}")


def _data(reply: requests.Response) -> Iterator[str]:
    """The data of each server-sent event."""
    data: list[str] = []
    for line in _lines(reply):
        name, _, value = line.partition(":")
        if name == "data":
            data.append(value.removeprefix(" "))
        elif not line and data:
            yield "\n".join(data)
            data = []


def _lines(reply: requests.Response) -> Iterator[str]:
    """The lines of a reply, each as soon as it is complete."""
    rest = b""
    while part := reply.raw.read1(_CHUNK):
        *lines, rest = (rest + part).split(b"\n")
        for line in lines:
            yield line.decode("utf-8", "replace").rstrip("\r")


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
