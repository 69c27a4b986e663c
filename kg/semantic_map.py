"""The front door of the graph: create or open a map, read records, apply updates, ask questions."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Self

import networkx as nx
import rdflib
from pyoxigraph import NamedNode

from kg import vocabulary as v
from kg.categories import Catalogue
from kg.commits import ChangeSet, Listener
from kg.dataset_view import DatasetView
from kg.endpoint import is_url
from kg.errors import MapNotFoundError, QueryParameterError
from kg.history.background import changed_since
from kg.history.instants import Instant, sequence_of
from kg.history.log import Log
from kg.history.past import store_at
from kg.history.recovery import attach, look_into, one_reader_at_a_time
from kg.identity import first_quads, identity
from kg.network import network
from kg.questions import any_question
from kg.records import ObjectRecord, PlaceRecord
from kg.selection import is_believed, select_objects, subcategories
from kg.standing import RowsListener, Standing
from kg.store import MapStore
from kg.writing import Writing

_TYPE = NamedNode(v.RDF_TYPE)
_MAP = NamedNode(v.MAP_GRAPH)


class SemanticMap(Writing):
    """A map on disk or in memory; made by `create`, `open`, `open_or_create` or `in_memory`.

    A context manager that closes itself. Safe to use from several threads of one process. `base` is
    the map's own IRI, the start of all its things' IRIs; `catalogue` knows the categories.
    """

    def __init__(
        self, store: MapStore, *, base: str | None = None, catalogue: Catalogue | None = None
    ) -> None:
        super().__init__(store, base=base, catalogue=catalogue)
        self._dataset: rdflib.Dataset | None = None
        self._standing: list[Callable[[], None]] = []

    @classmethod
    def create(
        cls,
        path: Path | str,
        *,
        title: str | None = None,
        base: str | None = None,
        power_safe: bool = False,
    ) -> Self:
        """A new map in the folder, or on the SPARQL server, at `path`; with the shipped ontologies.

        Whole or not at all, also when killed midway. With `power_safe` each transaction waits for
        the disk, and survives a power cut too. Raises GraphError where a map lies there.
        """
        if is_url(path):
            return cls(MapStore.create_on(str(path), first_quads(title or "map", base)))
        path = Path(path)
        store = MapStore.create(path, first_quads(title or path.resolve().name, base))
        return cls._with_history(store, path, power_safe)

    @classmethod
    def open(
        cls, path: Path | str, *, read_only: bool = False, power_safe: bool = False
    ) -> SemanticMap:
        """The map in the folder, or on the SPARQL server, at `path` (``http://127.0.0.1:7878``).

        What a crash kept from the store is applied from its history first; `power_safe` is as for
        `create`. Raises MapNotFoundError (creating nothing) or MapBusyError: a folder has one
        writer at a time and no reader beside it; readers share. Raises RemoteError where no server
        answers. Of a running `hereabouts serve` it is a `kg.served_map.ServedMap`: the past can be
        asked for, and all that is written goes through the server.
        """
        if is_url(path):
            return cls._on_server(MapStore.connect(str(path), read_only=read_only))
        path = Path(path)
        if not read_only:
            return cls._with_history(MapStore.open(path), path, power_safe)
        with one_reader_at_a_time(path):
            found = cls._with_history(MapStore.open(path, read_only=True), path, False)
            if found._history is None or found._history.last <= found.sequence:
                return found
            found.close()
            cls.open(path).close()  # opened for writing, it catches up
            return cls._with_history(MapStore.open(path, read_only=True), path, False)

    @classmethod
    def open_or_create(
        cls,
        path: Path | str,
        *,
        title: str | None = None,
        base: str | None = None,
        power_safe: bool = False,
    ) -> SemanticMap:
        """The map at `path` for writing, created with `title` and `base` where there is none."""
        if is_url(path):
            try:
                return cls.open(path)
            except MapNotFoundError:
                return cls.create(path, title=title, base=base)
        path = Path(path)
        if path.exists() and not (path.is_dir() and not any(path.iterdir())):
            return cls.open(path, power_safe=power_safe)
        return cls.create(path, title=title, base=base, power_safe=power_safe)

    @classmethod
    def in_memory(cls, *, title: str = "map", base: str | None = None) -> Self:
        """A map without a path, for tests and simulations of a few thousand frames."""
        return cls._with_history(MapStore.in_memory(first_quads(title, base)), None, False)

    @property
    def read_only(self) -> bool:
        """Whether it was opened for reading only."""
        return self._store.read_only

    @property
    def store(self) -> MapStore:
        """The store that holds the map, for the other modules of this room."""
        return self._store

    @property
    def dataset(self) -> rdflib.Dataset:
        """The live store as rdflib sees it; the default graph is the union of all graphs.

        Hand it query strings: prepared queries fall back to rdflib's own, slow engine. Its
        ``update`` is that of this class, and may write graph:commonsense; single triples it refuses
        to write. Raises GraphError for a map on a server.
        """
        if self._dataset is None:
            store = DatasetView(self._store.native, self._update_by_rdflib)
            view = rdflib.Dataset(store=store, default_union=True)
            for prefix, namespace in v.PREFIXES.items():
                view.bind(prefix, namespace)
            self._dataset = view
        return self._dataset

    def objects(
        self,
        category: str | None = None,
        *,
        place: str | int | None = None,
        near: tuple[float, float] | str | None = None,
        radius: float = 2.0,
        at: Instant | None = None,
    ) -> tuple[ObjectRecord, ...]:
        """Objects, oldest first: all, or those that every given condition admits.

        `category` is a label or IRI and includes what is below it; `place` a label, number or IRI.
        `near` is a point (x, y) [m] of the map or the IRI of an object, which is then itself left
        out; it admits what is within `radius` [m] over the floor, and puts the nearest first.
        `at` asks the map of then (see `at`). Raises UnknownCategoryError, QueryParameterError for
        what makes no sense, HistoryError for a past that is not kept.
        """
        if at is not None:
            with self.at(at) as then:
                return then.objects(category, place=place, near=near, radius=radius)
        wanted = None if category is None else self.catalogue.find(category).iri
        room = None if place is None else self._resolve("place", str(place))
        return select_objects(self.engine, self._facts, wanted, room, near, radius)

    def places(
        self,
        category: str | None = None,
        *,
        min_belief: float | None = None,
        at: Instant | None = None,
    ) -> tuple[PlaceRecord, ...]:
        """Places, by number: all, or those of a category or of one below it.

        Of a category are the places most believed to be so; with `min_belief`, those believed to be
        so at least that much (without a category: to be anything). `at` asks the map of then (see
        `at`). Raises UnknownCategoryError, and HistoryError for a past that is not kept.
        """
        if at is not None:
            with self.at(at) as then:
                return then.places(category, min_belief=min_belief)
        places = self._facts.places(self.engine)
        if category is None and min_belief is None:
            return places
        kinds = None
        if category is not None:
            kinds = subcategories(self.engine, self.catalogue.find(category, "place").iri)
        return tuple(place for place in places if is_believed(place, kinds, min_belief))

    def network(self, *, near: float = 1.0) -> nx.Graph[str]:
        """Objects and places as a networkx graph: who is in what, who within `near` [m] of whom."""
        if not near > 0:
            raise QueryParameterError(f"near must be a distance above 0 m, got {near!r}")
        return network(self.objects(), self.places(), self.catalogue, near)

    def at(self, when: Instant) -> SemanticMap:
        """The map as believed at `when`, for reading only, and while this one is open.

        It is made in memory as far as it is asked for. `when` is a sequence number (42 or "#42"), a
        datetime, or ISO 8601 text, by the clock of the machine that wrote the map. Raises
        HistoryError where that past is not kept; so does what is asked of it once it is dropped.
        """
        log, catalogue = self.history, self.catalogue
        sequence = sequence_of(log, when)
        known = None if changed_since(log, sequence) else catalogue
        then = store_at(log, lambda: self.engine, sequence)
        return SemanticMap(then, base=self.base, catalogue=known)

    def snapshot(self) -> SemanticMap:
        """A copy in memory for reading only: the map as it is now, whatever happens to it then."""
        with self._guard:
            return SemanticMap(MapStore.in_memory(self.engine, read_only=True))

    @property
    def hears_all(self) -> bool:
        """Whether every transaction is told, once `catch_up` has run, to who listens at `store`."""
        return not self._store.shared

    def catch_up(self) -> None:
        """Hear of what others wrote so far; in the process of the writer that is heard anyway."""

    def is_others(self, change: ChangeSet) -> bool:
        """Whether anybody but this process's mapper made a transaction that was told."""
        return change.cause.kind != "frame" or change.cause.by is not None

    def listen(self, listener: Listener) -> Callable[[], None]:
        """Have `listener` called with each change set once it is stored; returns how to stop.

        It runs on the committing thread: it must be quick, and must not write.
        """
        return self._store.listen(listener)

    def on(
        self, question: str | Path, callback: RowsListener, **parameters: object
    ) -> Callable[[], None]:
        """Have `callback(added, removed)` called with the rows by which commits change an answer.

        `question` is what `query` takes. The callback runs on a thread of its own, with two Tables;
        the rows of now are not reported. On a plain SPARQL server, commits of other programs are
        noticed within a second. Returns how to stop; closing the map does too.
        """
        asked = any_question(question, parameters)
        standing = Standing(
            lambda: self._answer(asked, parameters),
            callback,
            lambda: self.sequence,
            polls=not self.hears_all,
        )
        deaf = self.listen(standing.hear)

        def stop() -> None:
            if stop in self._standing:
                self._standing.remove(stop)
                deaf()
            standing.stop()

        self._standing.append(stop)
        standing.look()  # a commit may have come before it was listened to
        return stop

    def flush(self) -> None:
        """Write everything to disk; happens every few seconds by itself."""
        self._store.flush()

    def close(self) -> None:
        """Flush and let go of the store; closing twice is fine."""
        for stop in tuple(self._standing):
            stop()
        with self._guard:
            self._dataset = None
            self._store.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _update_by_rdflib(self, sparql: str) -> None:
        self.update(sparql, by="rdflib", allow=("commonsense",))

    @classmethod
    def _with_history(cls, store: MapStore, folder: Path | None, power_safe: bool) -> Self:
        try:
            base, _ = identity(store)
            if not store.read_only:
                log: Log | None = attach(store, folder, base, power_safe=power_safe)
            else:
                log = look_into(store, folder, base) if folder else None
            found = cls(store)
        except BaseException:
            store.close()
            raise
        found._history = log
        return found

    @classmethod
    def _on_server(cls, store: MapStore) -> SemanticMap:
        from kg.served_map import ServedMap  # which is a SemanticMap itself

        try:
            return ServedMap.found_at(store) or cls(store)
        except BaseException:
            store.close()
            raise
