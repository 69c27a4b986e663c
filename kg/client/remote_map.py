"""Remote map: the map of a running `hereabouts serve`, read by SPARQL, written through the server.

Unlike a plain SPARQL server it has a history, validates updates and sends notifications.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Collection, Iterable, Iterator
from datetime import datetime
from pathlib import Path
from typing import Final, Never

from pyoxigraph import NamedNode, Quad

from kg import vocabulary as v
from kg.client.change_stream import ChangeStream
from kg.client.served_server import ServedClient, served_at
from kg.errors import GraphError, HistoryError, RemoteError
from kg.facts.map_metadata import changed_description
from kg.history.replay.point_in_time import Difference
from kg.history.reports.events import HistoryEvent
from kg.history.reports.explanation import Explanation
from kg.history.storage.log import BACKGROUND
from kg.history.timestamps import Instant, moment
from kg.maps.map_writer import frame_cause
from kg.maps.semantic_map import SemanticMap
from kg.query.subscriptions import RowsListener
from kg.records import Assertion, MapUpdate
from kg.store.sparql_backend import SparqlBackend
from kg.store.transactional import TransactionalStore
from kg.transactions import Cause, ChangeSet, Listener
from kg.update.ground_update import update_text
from kg.update.restoration import Restored

RETRY_AFTER: Final = 5.0  # [s] until a refused subscription to the change stream is retried


class RemoteMap(SemanticMap):
    """As `SemanticMap`; a server's token, in HEREABOUTS_TOKEN, identifies who writes.

    A mapper may run on it (`apply`, `learn`): each frame is one request, applied by the server's
    one writer.
    """

    def __init__(self, store: TransactionalStore, served: ServedClient) -> None:
        self._served = served
        self._notified = served.sequence  # the last transaction that listeners were notified of
        self._caught_up = self._notified  # the last one that `catch_up` has read
        self._own: set[int] = set()  # transactions since then that `write` made
        self._held = 0  # blocks of `hold` that are open
        self._followers: list[ChangeStream] = []
        self._thread: threading.Thread | None = None  # reads the change stream for listeners
        self._closed = threading.Event()
        super().__init__(store)

    @classmethod
    def found_at(cls, store: TransactionalStore) -> RemoteMap | None:
        """The map behind a store on a server, where that is a `hereabouts serve`; else None."""
        served = served_at(store)
        return None if served is None else cls(store, served)

    @property
    def sequence(self) -> int:
        """The number of the last transaction; 0 before the first."""
        return self._served.sequence

    def at(self, when: Instant) -> SemanticMap:
        """The map as of `when`; each query is evaluated by the server."""
        number = self._served.sequence_at(text_of(when))
        store = TransactionalStore(
            SparqlBackend(self._served.root, always=(("at", str(number)),)),
            where=f"#{number} of {self._served.where}",
            read_only=True,
            lock=None,
        )
        try:
            return SemanticMap(store)
        except BaseException:
            store.close()
            raise

    def state_of(self, iri: str, when: Instant) -> tuple[Quad, ...]:
        """All quads about one thing as of `when`."""
        try:
            node = NamedNode(iri)
        except ValueError:
            raise HistoryError(f"needs an absolute IRI, got {iri!r}") from None
        with self.at(when) as past:
            quads = past.engine.quads_for_pattern(node, None, None)
            return tuple(sorted((q for q in quads if q.graph_name not in BACKGROUND), key=str))

    def diff(self, t1: Instant, t2: Instant) -> Difference:
        """The quads of `t2` that `t1` lacks, and the other way round."""
        return self._served.diff(text_of(t1), text_of(t2))

    def log(self, iri: str) -> Iterator[HistoryEvent]:
        """The history events of one thing, one a transaction; `iri` may be short (object/17)."""
        yield from self._served.log(iri)

    def why(self, what: str) -> tuple[Explanation, ...]:
        """The explanation of a thing (object/17), or of a fact ("object/17 here:inPlace")."""
        return self._served.why(what)

    def assert_(
        self, iri: str, prop: str, value: object, *, by: str | None = None
    ) -> ChangeSet | None:
        """Assert a property, by the holder of the token; `by` is ignored."""
        self._store.check_writable()
        return self._served.assert_(iri, prop, value)

    def retract(self, iri: str, prop: str, *, by: str | None = None) -> ChangeSet | None:
        """Retract an assertion, by the holder of the token; `by` is ignored."""
        self._store.check_writable()
        return self._served.retract(iri, prop)

    def assertions(self, iri: str | None = None) -> tuple[Assertion, ...]:
        """Assertions, with what perception believes instead; of one thing or of all."""
        return self._served.assertions(iri)

    def dump(self, *, seconds: float, most: int) -> bytes:
        """All quads of one state, as N-Quads; QueryTooLargeError beyond `most` bytes."""
        _, body = self._served.fetch(
            "dump.nq", (), "application/n-quads", seconds=seconds, most=most
        )
        return body

    def update(
        self,
        sparql: str,
        *,
        by: str | None = None,
        allow: Collection[str] = (),
        confirmed: bool = False,
    ) -> ChangeSet | None:
        """Apply a SPARQL 1.1 Update through the server, on the account of the token's holder."""
        self._store.check_writable()
        if allow:
            self._raise_not_remote("graphs that are usually not written")
        return self._served.update(sparql, confirmed=confirmed)

    def describe(
        self, *, title: str | None = None, licence: str | None = None, by: str | None = None
    ) -> ChangeSet | None:
        """As `SemanticMap.describe`, by the server and on the account of the token's holder."""
        self._store.check_writable()
        removed, added = changed_description(self.engine, self.base, title, licence)
        sparql = update_text(removed, added)
        return self._served.update(sparql) if removed or added else None

    def restore(
        self,
        when: Instant,
        *,
        only: Collection[str] = (),
        by: str | None = None,
        confirmed: bool = False,
        dry_run: bool = False,
    ) -> Restored:
        """As `SemanticMap.restore`, by the server and on the account of the token's holder."""
        self._store.check_writable()
        return self._served.restore(text_of(when), only, confirmed=confirmed, dry_run=dry_run)

    @property
    def notifies_of_all(self) -> bool:
        """Whether listeners at `store` are notified of every transaction up to `catch_up`."""
        return True

    def catch_up(self) -> None:
        """Notify listeners of the commits of others so far; within `hold`, of those before it.

        Raises HistoryError where the server does not keep them any more.
        """
        with self._guard:
            if self._held:
                return
            self._notify(self._served.changes(self._notified))
            self._caught_up = self._notified
            self._own.clear()

    def is_external(self, change: ChangeSet) -> bool:
        """Whether anybody but `apply` of this very object made a transaction."""
        return change.sequence not in self._own

    @contextlib.contextmanager
    def hold(self) -> Iterator[None]:
        """Lock this object against writes of other threads; other processes are not locked out.

        `apply` within the block is refused where they changed the same since it began.
        """
        with self._guard:
            self.catch_up()
            self._held += 1
            try:
                yield
            finally:
                self._held -= 1

    def apply(self, update: MapUpdate, cause: Cause | None = None) -> ChangeSet | None:
        """Have the server apply it in one transaction; returns once that is durable.

        Raises ConflictError, with nothing written, where others changed what it would write since
        the last `catch_up`: read it again, and write what follows from that.
        """
        with self._guard:
            self._store.check_writable()
            change = self._served.write(
                update, cause or frame_cause(update), known_sequence=self._caught_up, own=self._own
            )
            if change is not None:
                self._own.add(change.sequence)
                is_next = change.sequence == self._notified + 1
                self._notify((change,) if is_next else self._served.changes(self._notified))
            return change

    def new_object_iri(self) -> str:
        """``<base>object/N`` with a number no object of the map has had or will have."""
        self._store.check_writable()
        return self._served.new_object_iri()

    def learn(self, labels: Iterable[str], kind: str, *, model: str) -> dict[str, str]:
        """A category for each label of a network, found or added by the server."""
        self._store.check_writable()
        found = self._served.learn(tuple(labels), kind, model)
        if any(self.catalogue.by_iri(iri) is None for iri in found.values()):
            self.reread_ontology()
        return found

    def changes(self, since: int = 0) -> Iterator[ChangeSet]:
        """Change sets numbered above `since`, in order; HistoryError where they are not kept."""
        return self._served.changes(since)

    def follow(self, since: int | None = None) -> Iterator[ChangeSet]:
        """Change sets numbered above `since` (None: from now on), then each further one.

        Waits for the next one; it ends when the map is closed, and reconnects where a connection
        breaks.
        Raises HistoryError where the server no longer keeps the next one.
        """
        with self._guard:
            follower = ChangeStream(self._served.root, self.sequence if since is None else since)
            self._followers.append(follower)
        if self._closed.is_set():  # it was closed before the stream was registered
            follower.close()
        try:
            yield from follower
        finally:
            follower.close()
            self._followers.remove(follower)

    def listen(self, listener: Listener) -> Callable[[], None]:
        """Have `listener` called with each change set of any writer; returns its unsubscribe.

        It runs on a thread of this map, or on the one that writes; it must be quick.
        """
        stop = self._store.listen(listener)
        with self._guard:
            if self._thread is None:
                self._thread = threading.Thread(target=self._listen, name="changes", daemon=True)
                self._thread.start()
        return stop

    def on(
        self, question: str | Path, callback: RowsListener, /, **parameters: object
    ) -> Callable[[], None]:
        """As `SemanticMap.on`; the server sends each commit as it happens."""
        self.catch_up()
        return super().on(question, callback, **parameters)

    def close(self) -> None:
        """Close the connections; closing twice is fine."""
        self._closed.set()
        for follower in tuple(self._followers):
            follower.close()
        if self._thread is not None and threading.current_thread() is not self._thread:
            self._thread.join()
        self._served.close()
        super().close()

    def retain(self, keep: float) -> Never:
        """Refused: the retention of a served map is an option of the server."""
        raise HistoryError(
            f"the retention of the map at {self._served.where} is set by its server: "
            "hereabouts serve --keep"
        )

    def take_ontology(self, quads: object, *, by: str | None = None, whole: bool = False) -> Never:
        """Refused; `kg.editing.reloading.reload` replaces an ontology, here too."""
        self._raise_not_remote("an ontology")

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
            # the changes in between are lost: notify that there were some
            now = self._served.sequence
            with self._guard:
                self._notified = now - 1
                cause = Cause("recovery", note=str(error))
                self._notify((ChangeSet(now, time.time(), cause, (), ()),))

    def _notify(self, changes: Iterable[ChangeSet]) -> None:
        """Notify listeners of transactions, in order; those notified before are left out."""
        for change in changes:
            if change.sequence <= self._notified:
                continue
            if isinstance(self.engine, SparqlBackend):
                self.engine.not_before(change.sequence)
            if any(q.graph_name == v.ONTOLOGY_GRAPH for q in (*change.added, *change.removed)):
                self.reread_ontology()
            self._notified = change.sequence
            self._store.notify(change)

    def _raise_not_remote(self, what: str) -> Never:
        raise GraphError(
            f"the map at {self._served.where} is served, and {what} cannot be written remotely: "
            "write by apply, assert, retract, update or `hereabouts ontology reload`"
        )


def text_of(when: Instant) -> str:
    """A moment in the server's syntax."""
    if isinstance(when, datetime):
        return datetime.fromtimestamp(moment(when)).astimezone().isoformat()
    return str(when)
