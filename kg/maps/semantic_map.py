"""SemanticMap: the API of a map: records, queries, updates, past states, subscriptions."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Collection, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Self

from pyoxigraph import Quad

from kg import vocabulary as v
from kg.facts.map_metadata import Description, description_of, identity
from kg.facts.objects_and_places import RecordCodec
from kg.facts.searches import SearchRecords
from kg.history.replay.ontology_replay import changed_since
from kg.history.replay.point_in_time import Difference
from kg.history.reports.events import HistoryEvent
from kg.history.storage.log import HistoryLog
from kg.history.timestamps import Instant, sequence_of
from kg.maps.map_writer import MapWriter
from kg.maps.past_access import PastAccess
from kg.maps.record_reader import RecordReader
from kg.ontology.catalogue import Catalogue, StoredCatalogue
from kg.query.evaluation import evaluate
from kg.query.query_files import (
    ParameterizedQuery,
    Table,
    resolve_query,
)
from kg.query.subscriptions import RowsListener, Subscription
from kg.rdf.quad_store import QuadStore
from kg.records import (
    Assertion,
    DepartedRecord,
    DoorRecord,
    FloorTile,
    MapUpdate,
    ObjectRecord,
    PlaceRecord,
    RecordingRecord,
    RobotRecord,
)
from kg.store.transactional import TransactionalStore
from kg.transactions import Cause, ChangeSet, Listener
from kg.update.deletion_guard import DeletionLimit
from kg.update.ground_update import GroundUpdate

if TYPE_CHECKING:
    import networkx as nx
    import rdflib

    from kg.history.reports.explanation import Explanation
    from kg.history.storage.compaction import Compaction
    from kg.ontology.replacement import Replacement
    from kg.update.restoration import Restored


class SemanticMap:
    """A map in a folder, in memory or on a SPARQL server; `kg.opening` opens maps.

    A context manager that closes itself. Safe to use from several threads of one process. `base` is
    the map's own IRI, the start of all its things' IRIs.
    """

    def __init__(
        self,
        store: TransactionalStore,
        *,
        base: str | None = None,
        catalogue: Catalogue | None = None,
        history: HistoryLog | None = None,
    ) -> None:
        self._store = store
        self.base = identity(store) if base is None else base
        self._categories = StoredCatalogue(lambda: store.engine, catalogue)
        facts = RecordCodec(self.base, self._categories)
        self._past = PastAccess(store, self.base, history)
        self._writer = MapWriter(store, facts, self._categories, self._past)
        self._guard = self._writer.guard
        self._reader = RecordReader(store, facts, self._writer.assertions, self._categories)
        self._dataset: rdflib.Dataset | None = None
        self._subscriptions: list[Callable[[], None]] = []
        self.searches = SearchRecords(store)

    @property
    def store(self) -> TransactionalStore:
        """The transactional store that holds the map."""
        return self._store

    @property
    def engine(self) -> QuadStore:
        """The quad store, local or remote, for reading; direct writes bypass history and caches."""
        return self._store.engine

    @property
    def catalogue(self) -> Catalogue:
        """The categories of the map's ontology."""
        return self._categories()

    @property
    def sequence(self) -> int:
        """The number of the last transaction; 0 before the first."""
        return self._store.sequence

    @property
    def description(self) -> Description:
        """IRI, title, licence and time of creation."""
        return description_of(self.engine, self.base)

    def describe(
        self, *, title: str | None = None, licence: str | None = None, by: str | None = None
    ) -> ChangeSet | None:
        """Set the title or the licence (an absolute IRI); None: it was so before.

        Raises InvalidFactError for what is no title or no IRI.
        """
        return self._writer.describe(title, licence, by=by)

    @property
    def deletion_limit(self) -> DeletionLimit:
        """The largest deletion that updates and restorations make unconfirmed."""
        return self._writer.deletion_limit

    @deletion_limit.setter
    def deletion_limit(self, limit: DeletionLimit) -> None:
        self._writer.deletion_limit = limit

    @property
    def dataset(self) -> rdflib.Dataset:
        """The live store as rdflib sees it; the default graph is the union of all graphs.

        Hand it query strings: prepared queries fall back to rdflib's own, slow engine. Its
        ``update`` is that of this class, and may write graph:commonsense; single triples it refuses
        to write. Raises GraphError for a map on a server.
        """
        if self._dataset is None:
            import rdflib

            from kg.store.rdflib_view import DatasetView

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
        min_existence: float = 0.0,
        at: Instant | None = None,
    ) -> tuple[ObjectRecord, ...]:
        """Objects, oldest first: all, or those that satisfy every given condition.

        The query `objects` lists those of existence 0.5 and above: `objects(min_existence=0.5)`.
        `category` is a label or IRI and includes its subcategories; `place` a label, number or IRI.
        `near` is a point (x, y) [m] of the map or the IRI of an object, which is then itself left
        out; it selects objects within `radius` [m] over the floor, the nearest first. `at` reads
        that past state (see `at`). Raises UnknownCategoryError, QueryParameterError for invalid
        values, HistoryError for a past that is not kept.
        """
        if at is not None:
            with self.at(at) as then:
                return then.objects(
                    category, place=place, near=near, radius=radius, min_existence=min_existence
                )
        found = self._reader.objects(category, place, near, radius)
        return tuple(record for record in found if record.existence >= min_existence)

    def places(
        self,
        category: str | None = None,
        *,
        min_belief: float | None = None,
        at: Instant | None = None,
    ) -> tuple[PlaceRecord, ...]:
        """Places, by number: all, or those of a category or of a subcategory.

        A place counts for its most probable category; with `min_belief`, for each category of at
        least that probability (without a category: any). `at` reads that past state (see `at`).
        Raises UnknownCategoryError, and HistoryError for a past that is not kept.
        """
        if at is not None:
            with self.at(at) as then:
                return then.places(category, min_belief=min_belief)
        return self._reader.places(category, min_belief)

    def network(self, *, near: float = 1.0) -> nx.Graph[str]:
        """Objects and places as a networkx graph with edges "in" and "near" (within `near` [m])."""
        return self._reader.network(near)

    def robot(self) -> RobotRecord | None:
        """The last pose of the robot; None without any."""
        return self._reader.robot()

    def departed(self, iris: Collection[str] | None = None) -> tuple[DepartedRecord, ...]:
        """Objects that left where they stood, all or those among `iris`; the latest last."""
        return self._reader.departed(iris)

    def doors(self) -> tuple[DoorRecord, ...]:
        """The doors between places that were found in the mapped floor."""
        return self._reader.doors()

    def floor(self) -> tuple[FloorTile, ...]:
        """The occupancy grid's tiles, by storey, column and row; empty without depth frames."""
        return self._reader.floor()

    def recordings(self) -> tuple[RecordingRecord, ...]:
        """The progress of each recording, by name."""
        return self._reader.recordings()

    def ontology(self) -> tuple[Quad, ...]:
        """The quads of this map's ontology, with blank nodes, sorted."""
        return self._reader.ontology()

    def assertions(self, iri: str | None = None) -> tuple[Assertion, ...]:
        """Assertions, with what perception believes instead; of one thing or of all."""
        return self._reader.assertions(iri)

    def conflicts(self) -> tuple[Assertion, ...]:
        """The assertions that perception contradicts, with since when and how strongly."""
        return tuple(a for a in self.assertions() if a.since is not None)

    def perceived_objects(self, iris: Iterable[str] | None = None) -> tuple[ObjectRecord, ...]:
        """Objects as perception alone believes them, as `apply` takes them; all, or some."""
        return self._reader.perceived_objects(iris)

    def perceived_places(self) -> tuple[PlaceRecord, ...]:
        """Places as perception alone believes them, as `apply` takes them."""
        return self._reader.perceived_places()

    def query(self, question: str | Path | ParameterizedQuery, /, **parameters: object) -> Table:
        """The result of a query: the name of a shipped one, a ``.rq`` file, or SPARQL text.

        Text with a brace or an IRI, or that begins with DESCRIBE, is SPARQL: prefixes are
        predeclared, relative IRIs are the map's (``<object/17>``), patterns read the union of all
        named graphs, and CONSTRUCT and DESCRIBE give a TripleTable. A `category` parameter takes a
        label ("banana") or an IRI, a `place` parameter a label, a number or an IRI.
        Raises UnknownQueryError, QueryParameterError, UnknownCategoryError, and QueryError for a
        query that does not parse, that would write, or that has SERVICE.
        """
        query = resolve_query(question, parameters)
        sparql = query.bind(parameters, self.resolve)
        # shipped queries order values of one type; any other must not abort this process
        order = not query.shipped
        table = evaluate(self.engine, sparql, query.name, base=self.base, total_order=order)
        return query.check(table)

    def resolve(self, kind: str, text: str) -> str:
        """IRI of a "category", a "place" or any thing ("iri") by its name in queries.

        A place has a label, a number and an IRI. Raises UnknownCategoryError or
        QueryParameterError, which list the alternatives.
        """
        return self._reader.resolve(kind, text)

    def new_object_iri(self) -> str:
        """``<base>object/N`` with a number no object of this map has had or will have."""
        return self._writer.new_object_iri()

    @property
    def next_object(self) -> int:
        """The number of the next object."""
        return self._writer.next_object

    def place_iri(self, number: int) -> str:
        """``<base>place/N``."""
        return f"{self.base}place/{number}"

    def apply(self, update: MapUpdate, cause: Cause | None = None) -> ChangeSet | None:
        """Write what changed in one transaction, and return it; None: nothing changed.

        Without a `cause` it is the mapper's, with the frame of `update`. Raises
        InvalidFactError, with nothing written, for a record that has no valid facts.
        """
        return self._writer.apply(update, cause)

    def written_by(self, update: MapUpdate) -> frozenset[str]:
        """IRIs of the things whose facts `update` may change."""
        return self._writer.written_by(update)

    def update(
        self,
        sparql: str,
        *,
        by: str | None = None,
        allow: Collection[str] = (),
        confirmed: bool = False,
    ) -> ChangeSet | None:
        """Apply a SPARQL 1.1 Update of a person or program as one transaction; None: no change.

        A triple without GRAPH is one of graph:map; WHERE reads all graphs; relative IRIs are the
        map's (``<object/17>``). What follows from the edit is written with it
        (`kg.update.completion`).
        `allow` has names of graphs ("ontology", "commonsense", "dataset", "history", "assertions")
        that may be written though they usually may not. Raises QueryError for what does not parse
        or would reach out, ProtectedError and ShapeError for what may not be written; the graph is
        then untouched.
        """
        return self._writer.update(sparql, by=by, allow=allow, confirmed=confirmed)

    def apply_ground(
        self,
        update: GroundUpdate,
        note: str,
        *,
        by: str | None = None,
        allow: Collection[str] = (),
        confirmed: bool = False,
    ) -> ChangeSet | None:
        """Validate and apply an evaluated update as one transaction; otherwise as `update`.

        `note` is kept with the transaction. That the update fits the state of the map is for the
        caller to ensure, within `hold`.
        """
        return self._writer.apply_ground(update, note, by=by, allow=allow, confirmed=confirmed)

    def restore(
        self,
        when: Instant,
        *,
        only: Collection[str] = (),
        by: str | None = None,
        confirmed: bool = False,
        dry_run: bool = False,
    ) -> Restored:
        """Make the map what it was at `when`, in one new transaction; the history keeps both.

        `only` restores some of it: "objects", "places", "assertions", "ontology", or things by IRI
        (object/17); without it everything is restored but the number of the next object. A
        `dry_run` counts and writes nothing. Raises HistoryError for a past that is not kept,
        QueryParameterError for what cannot be restored, OntologyError and ShapeError where a part
        does not fit the rest as it is now, UnconfirmedDeletionError as `update`.
        """
        return self._writer.restore(when, only=only, by=by, confirmed=confirmed, dry_run=dry_run)

    def take_ontology(
        self, quads: Iterable[Quad], *, by: str | None = None, whole: bool = False
    ) -> Replacement:
        """Make the quads this map's ontology, in one transaction, while it is in use.

        What was written into graph:commonsense by other means stays. Raises OntologyError, with
        nothing changed, where they are malformed, lack terms that the map uses, or leave out
        ontologies of the map without `whole`; `kg.ontology.diagnostics` reads and validates files.
        """
        return self._writer.take_ontology(quads, by=by, whole=whole)

    def learn(self, labels: Iterable[str], kind: str, *, model: str) -> dict[str, str]:
        """A category for each label of a network: its IRI; None-like labels are left out.

        Labels without a category of that `kind` ("object" or "place") get a provisional one, in one
        transaction of `model`. Labels without a printable character are ignored.
        """
        return self._writer.learn(labels, kind, model=model)

    def assert_(self, iri: str, prop: str, value: object, *, by: str) -> ChangeSet | None:
        """Assert a property, which overrides perception until it is retracted.

        Of an object: category (label or IRI), position ((x, y, z) [m]), existence ("present" or
        "absent"), label; of a place: category, label. ``object/17`` is short for its IRI. Raises
        UnknownCategoryError, and InvalidFactError for unknown things and invalid properties or
        values.
        """
        return self._writer.assert_(iri, prop, value, by=by)

    def retract(self, iri: str, prop: str, *, by: str | None = None) -> ChangeSet | None:
        """Retract an assertion: the property is again as perception believes it.

        Raises InvalidFactError where there is no such assertion.
        """
        return self._writer.retract(iri, prop, by=by)

    @contextlib.contextmanager
    def hold(self) -> Iterator[None]:
        """Lock the map against writes of other threads for a block that reads and then writes.

        Writers wait until it ends; keep it to milliseconds.
        """
        with self._guard:
            yield

    def reread_ontology(self) -> None:
        """Read the categories of the ontology from the store again."""
        self._writer.reread_ontology()

    @property
    def history(self) -> HistoryLog:
        """The log of all transactions; HistoryError where the map keeps none."""
        return self._past.history

    def changes(self, since: int = 0) -> Iterator[ChangeSet]:
        """Change sets numbered above `since`, in order; HistoryError where they are not kept."""
        return self._past.changes(since)

    def state_of(self, iri: str, when: Instant) -> tuple[Quad, ...]:
        """All quads about one thing as of `when`, without replaying the whole map."""
        return self._past.state_of(iri, when)

    def diff(self, t1: Instant, t2: Instant) -> Difference:
        """The quads of `t2` that `t1` lacks, and the other way round."""
        return self._past.diff(t1, t2)

    def log(self, iri: str) -> Iterator[HistoryEvent]:
        """The history events of one thing, one a transaction; `iri` may be short (object/17)."""
        return self._past.events(iri)

    def why(self, what: str) -> tuple[Explanation, ...]:
        """The explanation of a thing (object/17), or of a fact ("object/17 here:inPlace").

        Terms may be short (`kg.history.curies`). A map without a history explains what it can.
        Raises QueryParameterError for a fact that the map never had.
        """
        return self._past.explain(what)

    def compact(self, keep: float | None = None) -> Compaction:
        """Drop the past more than `keep` seconds back (None: keep all), and pack the history."""
        return self._past.compact(keep)

    def retain(self, keep: float) -> None:
        """Retain the last `keep` seconds of history while the map is open; older ones are dropped.

        Raises HistoryError where the map keeps no history, GraphError where it is read-only.
        """
        self._past.retain(keep)

    def at(self, when: Instant) -> SemanticMap:
        """The map as believed at `when`, for reading only, and while this one is open.

        It is replayed into memory; the last ones are cached. `when` is a sequence number (42 or
        "#42"), a datetime, or ISO 8601 text, by the clock of the machine that wrote the map. Raises
        HistoryError where that past is not kept.
        """
        log = self.history
        sequence = sequence_of(log, when)
        known = None if changed_since(log, sequence) else self._categories.known
        then = self._past.store_at(sequence)
        return SemanticMap(then, base=self.base, catalogue=known)

    def snapshot(self) -> SemanticMap:
        """A read-only copy in memory of the current state."""
        with self._guard:
            return SemanticMap(TransactionalStore.in_memory(self.engine, read_only=True))

    @property
    def notifies_of_all(self) -> bool:
        """Whether listeners at `store` are notified of every transaction up to `catch_up`."""
        return not self._store.shared

    def catch_up(self) -> None:
        """Notify listeners of the commits of others so far; in the writer's process, a no-op."""

    def is_external(self, change: ChangeSet) -> bool:
        """Whether anybody but this process's mapper made a transaction."""
        return change.cause.kind != "frame" or change.cause.by is not None

    def listen(self, listener: Listener) -> Callable[[], None]:
        """Have `listener` called with each change set once it is stored; returns its unsubscribe.

        It runs on the committing thread: it must be quick, and must not write.
        """
        return self._store.listen(listener)

    def on(
        self, question: str | Path, callback: RowsListener, /, **parameters: object
    ) -> Callable[[], None]:
        """Subscribe `callback(added, removed)` to the rows by which commits change a result.

        `question` is what `query` takes. The callback runs on a thread of its own, with two Tables;
        the rows of the first result are not reported. On a plain SPARQL server, commits of other
        programs are noticed within a second. Returns the function that stops it; closing the map
        does too.
        """
        query = resolve_query(question, parameters)
        subscription = Subscription(
            lambda: self.query(query, **parameters),
            callback,
            lambda: self.sequence,
            polls=not self.notifies_of_all,
        )
        unsubscribe = self.listen(subscription.on_commit)

        def stop() -> None:
            if stop in self._subscriptions:
                self._subscriptions.remove(stop)
                unsubscribe()
            subscription.stop()

        self._subscriptions.append(stop)
        subscription.check()  # a commit may have preceded `listen`
        return stop

    def close(self) -> None:
        """Flush and close the store; closing twice is fine."""
        for stop in tuple(self._subscriptions):
            stop()
        with self._guard:
            self._dataset = None
            self._store.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _update_by_rdflib(self, sparql: str, /, *, confirmed: bool = False) -> None:
        self.update(sparql, by="rdflib", allow=("commonsense",), confirmed=confirmed)
