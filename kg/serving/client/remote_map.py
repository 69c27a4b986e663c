"""Remote map: the map of a running `hereabouts serve`, read by SPARQL, written through the server.

Unlike a plain SPARQL server it has a history, validates updates and sends notifications.
"""

from __future__ import annotations

import contextlib
from collections.abc import Collection, Iterable, Iterator
from dataclasses import asdict
from datetime import datetime
from functools import partial
from typing import Never

from numpy.typing import ArrayLike
from pyoxigraph import NamedNode, Quad

from kg.history.point_in_time import Difference
from kg.history.reports.comparison import FAR, Comparison
from kg.history.reports.events import HistoryEvent
from kg.history.reports.explanation import Explanation
from kg.history.storage.log import WITHOUT_KEY_FRAMES
from kg.history.timestamps import Instant, moment
from kg.knowledge.ontology.catalogue import StoredCatalogue
from kg.maps.facts.coordinate_frames import changed_frame
from kg.maps.map_metadata import changed_description, identity
from kg.maps.semantic_map import SemanticMap
from kg.maps.stored_map import StoredMap, frame_cause
from kg.maps.stored_ontology import ontology_quads
from kg.maps.surface.voxels import Surface
from kg.maps.update.change_draft import update_text
from kg.maps.update.restoration import Restored
from kg.model.errors import GraphError, HistoryError
from kg.model.records import Assertion, MapUpdate
from kg.model.room_edit import RoomEdit
from kg.model.transactions import Cause, ChangeSet
from kg.serving.client.change_stream import RemoteSubscriptions
from kg.serving.client.record_codec import (
    Json,
    assertion_from_json,
    cause_to_json,
    comparison_from_json,
    difference_from_json,
    entry_from_json,
    reason_from_json,
    restored_from_json,
)
from kg.serving.client.served_server import ServedClient, change_of_reply
from kg.serving.client.update_codec import update_to_json
from kg.store.sparql_backend import SparqlBackend
from kg.store.transactional import TransactionalStore


class RemoteMap(SemanticMap):
    """The map of a running server; the token in HEREABOUTS_TOKEN identifies the writer.

    A mapper may run on it (`apply`, `ontology.learn`): each frame is one request, applied by the
    server's one writer.
    """

    history: RemoteHistory
    subscriptions: RemoteSubscriptions

    def __init__(self, store: TransactionalStore, served: ServedClient) -> None:
        categories = StoredCatalogue(lambda: store.engine)
        super().__init__(store, identity(store), categories)
        self._served = served
        served.check_writable = store.check_writable
        self.history = RemoteHistory(served)
        self.ontology = RemoteOntology(store, served, categories)
        self.assertions = RemoteAssertions(served)
        self.rooms = RemoteRooms(served)
        self.subscriptions = RemoteSubscriptions(self, served)

    @classmethod
    def found_at(cls, store: TransactionalStore) -> RemoteMap | None:
        """The map behind a store on a server; None unless a `hereabouts serve` runs there."""
        engine = store.engine
        if not isinstance(engine, SparqlBackend) or not engine.query_url.endswith("/sparql"):
            return None
        served = ServedClient.at(engine.query_url.removesuffix("/sparql"))
        return None if served is None else cls(store, served)

    @property
    def sequence(self) -> int:
        """The number of the last transaction; 0 before the first."""
        return self._served.sequence

    def at(self, when: Instant) -> SemanticMap:
        """The map at `when`; the server evaluates each query."""
        return _past_map(self._served, when)

    def snapshot(self) -> SemanticMap:
        """A read-only copy in memory of the current state, read from the server."""
        with self.hold():
            return StoredMap(TransactionalStore.in_memory(self.engine, read_only=True))

    def surface(self, *, min_count: int = 1) -> Surface:
        """The coloured voxels of what depth images showed, from the server."""
        return self._served.surface(None, min_count)

    def picture(self, iri: str) -> bytes | None:
        """JPEG of the best observation of an object, from the server."""
        return self._served.picture(iri.rpartition("/")[2])

    def dump(self, *, seconds: float, max_bytes: int) -> bytes:
        """All quads of one state, as N-Quads; raises QueryTooLargeError beyond `max_bytes`."""
        _, body = self._served.fetch(
            "dump.nq", (), "application/n-quads", seconds=seconds, max_bytes=max_bytes
        )
        return body

    def update(
        self, sparql: str, *, by: str | None = None, confirmed: bool = False
    ) -> ChangeSet | None:
        """Apply a SPARQL 1.1 Update through the server, as the holder of the token."""
        return self._served.update(sparql, confirmed=confirmed)

    def describe(
        self, *, title: str | None = None, licence: str | None = None, by: str | None = None
    ) -> ChangeSet | None:
        """Set title or licence through the server, as the holder of the token."""
        self.store.check_writable()
        removed, added = changed_description(self.engine, self.base, title, licence)
        sparql = update_text(removed, added)
        return self._served.update(sparql) if removed or added else None

    def place_frame(
        self, relative_to: str, T: ArrayLike, *, by: str | None = None
    ) -> ChangeSet | None:
        """State the transform to another frame through the server."""
        self.store.check_writable()
        removed, added = changed_frame(self.engine, self.base, relative_to, T)
        return self._served.update(update_text(removed, added)) if removed or added else None

    def restore(
        self,
        when: Instant,
        *,
        only: Collection[str] = (),
        by: str | None = None,
        confirmed: bool = False,
        dry_run: bool = False,
    ) -> Restored:
        """Restore a past state through the server, as the holder of the token."""
        wanted = {"to": text_of(when), "only": list(only), "dry_run": dry_run}
        return self._served.post(restored_from_json, "restore", wanted, confirmed=confirmed)

    def hold(self) -> contextlib.AbstractContextManager[None]:
        """Lock this object against writes of other threads; other processes are not locked out."""
        return self.subscriptions.hold()

    def apply(self, update: MapUpdate, cause: Cause | None = None) -> ChangeSet | None:
        """Apply an update on the server in one transaction; returns once that is durable.

        Raises ConflictError, with nothing written, if others changed the same things since the last
        `subscriptions.catch_up`. The caller then has to read them again.
        """
        with self.subscriptions.writing() as (known_sequence, own, written):
            change = self._served.post(
                change_of_reply,
                "records",
                {
                    "update": update_to_json(update),
                    "cause": cause_to_json(cause or frame_cause(update)),
                    "seen": known_sequence,
                    "own": sorted(own),
                },
            )
            if change is not None:
                written(change)
            return change

    def new_object_iri(self) -> str:
        """``<base>object/N`` with a number no object of the map has had or will have."""
        return self._served.post(lambda data: NamedNode(data["iri"]).value, "numbers", {})

    def close(self) -> None:
        """Close the connections; a second call does nothing."""
        self.subscriptions.close()
        self._served.close()
        self._dataset = None
        self.store.close()


class RemoteHistory:
    """The history of a served map, as `kg.maps.map_parts.MapHistory` documents it."""

    def __init__(self, served: ServedClient) -> None:
        self._served = served

    @property
    def log(self) -> Never:
        """Not on a server: raises HistoryError."""
        raise self._elsewhere()

    def changes(self, since: int = 0) -> Iterator[ChangeSet]:
        """Change sets numbered above `since`, in order."""
        return self._served.changes(since)

    def state_of(self, iri: str, when: Instant) -> tuple[Quad, ...]:
        """All quads about one thing at `when`."""
        try:
            node = NamedNode(iri)
        except ValueError:
            raise HistoryError(f"needs an absolute IRI, got {iri!r}") from None
        with _past_map(self._served, when) as past:
            quads = past.engine.quads_for_pattern(node, None, None)
            return tuple(
                sorted((q for q in quads if q.graph_name not in WITHOUT_KEY_FRAMES), key=str)
            )

    def diff(self, t1: Instant, t2: Instant) -> Difference:
        """The quads of `t2` that `t1` lacks, and the other way round."""
        moments = {"from": text_of(t1), "to": text_of(t2)}
        return self._served.get(difference_from_json, "diff", facts="1", **moments)

    def compare(self, t1: Instant, t2: Instant | None = None, far: float = FAR) -> Comparison:
        """The objects that appeared, are gone, moved or have another name, from `t1` to `t2`."""
        moments = {"from": text_of(t1)} | ({} if t2 is None else {"to": text_of(t2)})
        return self._served.get(comparison_from_json, "diff", far=f"{far:g}", **moments)

    def events(self, iri: str) -> Iterator[HistoryEvent]:
        """The history events of one thing, one a transaction."""
        yield from self._served.get(lambda data: tuple(map(entry_from_json, data)), "log", iri=iri)

    def explain(self, what: str) -> tuple[Explanation, ...]:
        """The explanation of a thing or of a fact."""
        return self._served.get(lambda data: tuple(map(reason_from_json, data)), "why", what=what)

    def compact(self, keep: float | None = None) -> Never:
        """Not on a server: raises HistoryError."""
        raise self._elsewhere()

    def retain(self, keep: float) -> Never:
        """Not on a server: raises HistoryError."""
        raise self._elsewhere()

    def _elsewhere(self) -> HistoryError:
        return HistoryError(
            f"the history of the map at {self._served.where} is on its server. Read it by log, "
            "diff and --at; set the retained time with hereabouts serve --keep"
        )


class RemoteOntology:
    """The ontology of a served map, as `kg.maps.map_parts.MapOntology` documents it."""

    def __init__(
        self, store: TransactionalStore, served: ServedClient, categories: StoredCatalogue
    ) -> None:
        self._store, self._served, self._categories = store, served, categories

    def quads(self) -> tuple[Quad, ...]:
        """The quads of the ontology, with blank nodes, sorted."""
        return ontology_quads(self._store.engine)

    def learn(self, labels: Iterable[str], kind: str, *, model: str) -> dict[str, str]:
        """A category for each label of a network, found or added by the server."""
        wanted = {"labels": [*labels], "kind": kind, "model": model}
        found = self._served.post(_categories, "labels", wanted)
        if any(self._categories().by_iri(iri) is None for iri in found.values()):
            self.reread()
        return found

    def replace(self, quads: object, *, by: str | None = None, whole: bool = False) -> Never:
        """Raises GraphError: use `kg.serving.reloading.reload`."""
        raise GraphError(
            f"the map at {self._served.where} is served: its ontology is replaced by "
            "hereabouts ontology reload"
        )

    def reread(self) -> None:
        """Read the categories from the server again at their next use."""
        self._categories.forget()


class RemoteAssertions:
    """Assertions in a served map, made and retracted by the holder of the token."""

    def __init__(self, served: ServedClient) -> None:
        self._served = served

    def all(self, iri: str | None = None) -> tuple[Assertion, ...]:
        """Assertions, with the perceived values; of one thing or of all."""
        of_thing = {} if iri is None else {"iri": iri}
        return self._served.get(_assertions, "assertions", **of_thing)

    def conflicts(self) -> tuple[Assertion, ...]:
        """The assertions that perception contradicts."""
        return tuple(assertion for assertion in self.all() if assertion.since is not None)

    def add(self, iri: str, prop: str, value: object, *, by: str = "") -> ChangeSet | None:
        """Assert a property, by the holder of the token; `by` is ignored."""
        given = value if isinstance(value, str) else _plain(value)
        content = {"thing": iri, "property": prop, "value": given}
        return self._served.post(change_of_reply, "assertions", content)

    def retract(self, iri: str, prop: str, *, by: str | None = None) -> ChangeSet | None:
        """Retract an assertion, by the holder of the token; `by` is ignored."""
        return self._served.delete("assertions", iri=iri, property=prop)


class RemoteRooms:
    """Edits of the rooms of a served map, by the holder of the token."""

    def __init__(self, served: ServedClient) -> None:
        self._served = served

    def edit(self, edit: RoomEdit, *, by: str = "") -> ChangeSet | None:
        """Apply an edit, by the holder of the token; `by` is ignored."""
        return self._served.post(change_of_reply, "rooms", asdict(edit))


def _assertions(data: Json) -> tuple[Assertion, ...]:
    return tuple(map(assertion_from_json, data["assertions"]))


def _categories(data: Json) -> dict[str, str]:
    return {str(label): NamedNode(iri).value for label, iri in data["categories"].items()}


def _plain(value: object) -> object:
    """A position of any sequence type as a list of numbers; anything else as text."""
    try:
        return [float(number) for number in value]  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        return str(value)


def _past_map(served: ServedClient, when: Instant) -> SemanticMap:
    number = served.sequence_at(text_of(when))
    store = TransactionalStore(
        SparqlBackend(served.root, always=(("at", str(number)),)),
        where=f"#{number} of {served.where}",
        read_only=True,
        lock=None,
    )
    try:
        past = StoredMap(store)
    except BaseException:
        store.close()
        raise
    past.read_surface = partial(served.surface, number)
    return past


def text_of(when: Instant) -> str:
    """A moment in the server's syntax."""
    if isinstance(when, datetime):
        return datetime.fromtimestamp(moment(when)).astimezone().isoformat()
    return str(when)
