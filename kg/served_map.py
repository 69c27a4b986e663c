"""The map of a running `hereabouts serve`, from afar: read by SPARQL, written by its one writer.

What a plain SPARQL server cannot do, this one can: it knows the past, and validates what is said.
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
from kg.commits import Cause, ChangeSet, Listener
from kg.errors import GraphError, HistoryError, RemoteError
from kg.following import Follower
from kg.history.instants import Instant, moment
from kg.history.log import BACKGROUND
from kg.history.past import Difference
from kg.history.telling import Entry
from kg.history.why import Reason
from kg.records import Assertion, MapUpdate
from kg.remote import RemoteEngine
from kg.semantic_map import SemanticMap
from kg.served import Served, served_at
from kg.standing import RowsListener
from kg.store import MapStore
from kg.writing import frame_cause

AGAIN: Final = 5.0  # [s] until a server that tells no changes is asked for them again

_ONTOLOGY: Final = NamedNode(v.ONTOLOGY_GRAPH)


class ServedMap(SemanticMap):
    """As `SemanticMap`; a server's token, in HEREABOUTS_TOKEN, says on whose account it is written.

    A mapper may run on it (`apply`, `learn`): each frame is one request, applied by the server's
    one writer.
    """

    def __init__(self, store: MapStore, served: Served) -> None:
        self._served = served
        self._heard = served.sequence  # the last transaction that was told to who listens
        self._seen = self._heard  # the last one before which nothing is unknown to who writes
        self._own: set[int] = set()  # transactions since then that `write` made
        self._held = 0  # blocks of `hold` that are open
        self._followers: list[Follower] = []
        self._thread: threading.Thread | None = None  # hears what happens, where somebody listens
        self._closed = threading.Event()
        super().__init__(store)

    @classmethod
    def found_at(cls, store: MapStore) -> ServedMap | None:
        """The map behind a store on a server, where that is a `hereabouts serve`; else None."""
        served = served_at(store)
        return None if served is None else cls(store, served)

    @property
    def sequence(self) -> int:
        """The number of the last transaction; 0 before the first."""
        return self._served.sequence

    def at(self, when: Instant) -> SemanticMap:
        """The map as believed at `when`, asked of the server question by question."""
        number = self._served.sequence_at(text_of(when))
        store = MapStore(
            RemoteEngine(self._served.root, always=(("at", str(number)),)),
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
        with self.at(when) as then:
            quads = then.engine.quads_for_pattern(node, None, None)
            return tuple(sorted((q for q in quads if q.graph_name not in BACKGROUND), key=str))

    def diff(self, t1: Instant, t2: Instant) -> Difference:
        """What the map says at `t2` and not at `t1`, and the other way round."""
        return self._served.diff(text_of(t1), text_of(t2))

    def log(self, iri: str) -> Iterator[Entry]:
        """Each transaction that changed one thing, in words; `iri` may be short (object/17)."""
        yield from self._served.log(iri)

    def why(self, what: str) -> tuple[Reason, ...]:
        """Why the map says so: of a thing (object/17), or of a fact ("object/17 here:inPlace")."""
        return self._served.why(what)

    def assert_(
        self, iri: str, prop: str, value: object, *, by: str | None = None
    ) -> ChangeSet | None:
        """Have something be as said; whoever `by` names, the token's holder is who says it."""
        self._store.refuse_read_only()
        return self._served.assert_(iri, prop, value)

    def retract(self, iri: str, prop: str, *, by: str | None = None) -> ChangeSet | None:
        """Take back what was said, on the account of the token's holder."""
        self._store.refuse_read_only()
        return self._served.retract(iri, prop)

    def assertions(self, iri: str | None = None) -> tuple[Assertion, ...]:
        """What people said, and what perception believes of it; of one thing or of all."""
        return self._served.assertions(iri)

    def update(
        self, sparql: str, *, by: str | None = None, allow: Collection[str] = ()
    ) -> ChangeSet | None:
        """Apply a SPARQL 1.1 Update through the server, on the account of the token's holder."""
        self._store.refuse_read_only()
        if allow:
            self._refuse("graphs that are usually not written")
        return self._served.update(sparql)

    @property
    def hears_all(self) -> bool:
        """Whether every transaction is told, once `catch_up` has run, to who listens at `store`."""
        return True

    def catch_up(self) -> None:
        """Hear of what others wrote so far; within `hold`, of what they wrote before it.

        Raises HistoryError where the server does not keep that any more.
        """
        with self._guard:
            if self._held:
                return
            self._hear(self._served.changes(self._heard))
            self._seen = self._heard
            self._own.clear()

    def is_others(self, change: ChangeSet) -> bool:
        """Whether anybody but `apply`, of this very object, made a transaction that was told."""
        return change.sequence not in self._own

    @contextlib.contextmanager
    def hold(self) -> Iterator[None]:
        """Keep other threads from writing; others elsewhere cannot be kept from it.

        What `apply` writes within is refused where they changed the same since the block began.
        """
        with self._guard:
            self.catch_up()
            self._held += 1
            try:
                yield
            finally:
                self._held -= 1

    def write(self, update: MapUpdate, cause: Cause | None = None) -> ChangeSet | None:
        """Have the server apply it in one transaction; returns once that is sure to stay.

        Raises ConflictError, with nothing written, where others changed what it would write since
        this map was last caught up with: read it anew, and write what follows from that.
        """
        with self._guard:
            self._store.refuse_read_only()
            change = self._served.write(
                update, cause or frame_cause(update), seen=self._seen, own=self._own
            )
            if change is not None:
                self._own.add(change.sequence)
                is_next = change.sequence == self._heard + 1
                self._hear((change,) if is_next else self._served.changes(self._heard))
            return change

    def new_object_iri(self) -> str:
        """``<base>object/N`` with a number no object of the map has had or will have."""
        self._store.refuse_read_only()
        return self._served.new_object_iri()

    def learn(self, labels: Iterable[str], kind: str, *, model: str) -> dict[str, str]:
        """A category for each label of a network, as the server finds or makes it."""
        self._store.refuse_read_only()
        found = self._served.learn(tuple(labels), kind, model)
        if any(self.catalogue.by_iri(iri) is None for iri in found.values()):
            self.reread_ontology()
        return found

    def changes(self, since: int = 0) -> Iterator[ChangeSet]:
        """Change sets numbered above `since`, in order; HistoryError where they are not kept."""
        return self._served.changes(since)

    def follow(self, since: int | None = None) -> Iterator[ChangeSet]:
        """Change sets numbered above `since` (None: from now on), and those to come, as they come.

        Waits for the next one; it ends when the map is closed, and survives connections that break.
        Raises HistoryError where the server does not keep what would come next.
        """
        with self._guard:
            follower = Follower(self._served.root, self.sequence if since is None else since)
            self._followers.append(follower)
        try:
            yield from follower
        finally:
            follower.close()
            self._followers.remove(follower)

    def listen(self, listener: Listener) -> Callable[[], None]:
        """Have `listener` called with each change set, whoever makes it; returns how to stop.

        It runs on a thread of this map's, or on the one that writes; it must be quick.
        """
        stop = self._store.listen(listener)
        with self._guard:
            if self._thread is None:
                self._thread = threading.Thread(target=self._listen, name="changes", daemon=True)
                self._thread.start()
        return stop

    def on(
        self, question: str | Path, callback: RowsListener, **parameters: object
    ) -> Callable[[], None]:
        """As `SemanticMap.on`; the server tells of each commit as it happens."""
        self.catch_up()
        return super().on(question, callback, **parameters)

    def close(self) -> None:
        """Let go of the server; closing twice is fine."""
        self._closed.set()
        for follower in tuple(self._followers):
            follower.close()
        if self._thread is not None and threading.current_thread() is not self._thread:
            self._thread.join()
        super().close()

    def retain(self, keep: float) -> Never:
        """Refused: how far back a served map remembers is said where it is served."""
        raise HistoryError(
            f"how far back the map at {self._served.where} remembers is said where it is served: "
            "hereabouts serve --keep"
        )

    def take_ontology(self, quads: object, *, by: str | None = None, whole: bool = False) -> Never:
        """Refused; `kg.editing.reloading.reload` takes an ontology in, here too."""
        self._refuse("an ontology")

    def _listen(self) -> None:
        """Hear of what happens until the map is closed."""
        while not self._closed.is_set():
            follower = Follower(self._served.root, self._heard)
            self._followers.append(follower)
            try:
                if not self._closed.is_set():
                    self._hear_all(follower)
            except RemoteError:
                self._closed.wait(AGAIN)
            finally:
                self._followers.remove(follower)

    def _hear_all(self, follower: Iterable[ChangeSet]) -> None:
        try:
            for change in follower:
                with self._guard:
                    if not self._closed.is_set():
                        self._hear((change,))
        except HistoryError as error:
            # what came in between is not to be had any more: only that something did
            now = self._served.sequence
            with self._guard:
                self._heard = now - 1
                cause = Cause("recovery", note=str(error))
                self._hear((ChangeSet(now, time.time(), cause, (), ()),))

    def _hear(self, changes: Iterable[ChangeSet]) -> None:
        """Take note of transactions, in order; those heard of before are left out."""
        for change in changes:
            if change.sequence <= self._heard:
                continue
            if isinstance(self.engine, RemoteEngine):
                self.engine.not_before(change.sequence)
            if any(q.graph_name == _ONTOLOGY for q in (*change.added, *change.removed)):
                self.reread_ontology()
            self._heard = change.sequence
            self._store.tell(change)

    def _refuse(self, what: str) -> Never:
        raise GraphError(
            f"the map at {self._served.where} is served, and {what} is not written into it from "
            "afar: write by apply, assert, retract, update or `hereabouts ontology reload`"
        )


def text_of(when: Instant) -> str:
    """A moment as the server takes it."""
    if isinstance(when, datetime):
        return datetime.fromtimestamp(moment(when)).astimezone().isoformat()
    return str(when)
