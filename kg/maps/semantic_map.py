"""SemanticMap: a map's records, queries and updates, and its parts."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection
from contextlib import AbstractContextManager, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Self

from kg.history.timestamps import Instant
from kg.knowledge.ontology.catalogue import Catalogue, StoredCatalogue
from kg.knowledge.ontology.declared_terms import absent_terms
from kg.maps.facts.assertion_service import PerceivedRecords
from kg.maps.facts.object_filters import is_believed, select_objects
from kg.maps.facts.objects_and_places import RecordCodec
from kg.maps.facts.observations import departed_in
from kg.maps.facts.occupancy import tiles_in
from kg.maps.facts.robot import SearchRecords, recordings_in, robot_in
from kg.maps.facts.spatial_relations import doors_in
from kg.maps.map_metadata import Description, description_of
from kg.maps.map_parts import MapAssertions, MapHistory, MapOntology, MapRooms, lazy
from kg.maps.networkx_graph import network
from kg.maps.object_pictures import ObjectPictures
from kg.maps.query.evaluation import Table, evaluate
from kg.maps.query.parameter_resolution import ParameterResolver
from kg.maps.query.query_files import ParameterizedQuery, resolve_query
from kg.maps.subscriptions import MapSubscriptions
from kg.maps.surface.surface_store import SurfaceStore
from kg.maps.surface.voxels import Surface
from kg.model.errors import QueryParameterError
from kg.model.records import (
    DepartedRecord,
    DoorRecord,
    FloorTile,
    MapUpdate,
    ObjectRecord,
    PlaceRecord,
    RecordingRecord,
    RobotRecord,
)
from kg.model.transactions import Cause, ChangeSet
from kg.model.vocabulary import UNNAMED_THING
from kg.rdf.quad_store import QuadStore, subcategories
from kg.store.transactional import TransactionalStore

if TYPE_CHECKING:
    import networkx as nx
    import rdflib
    from numpy.typing import ArrayLike

    from kg.maps.update.restoration import Restored


class SemanticMap(ABC):
    """A map in a folder, in memory or on a server; `kg.serving.opening` opens maps.

    A context manager that closes itself; safe to use from several threads of one process.
    """

    base: str
    """IRI of the map; the IRIs of its things begin with it."""

    store: TransactionalStore
    """The transactional store that holds the map."""

    history: MapHistory
    """Past transactions, and the reasons for facts."""

    ontology: MapOntology
    """The ontology: its quads, new labels, replacement."""

    assertions: MapAssertions
    """Assertions of persons about objects and places."""

    rooms: MapRooms
    """Edits of rooms by persons: split, merge, draw, name."""

    perceived: PerceivedRecords = lazy(lambda self: PerceivedRecords(self.store, self._facts))
    """Objects and places as perception alone estimates them, in the form that `apply` takes."""

    searches: SearchRecords = lazy(lambda self: SearchRecords(self.store))
    """The searches that robots made on this map."""

    subscriptions: MapSubscriptions
    """Listeners to transactions, and to changes of a query's result."""

    surface_store: SurfaceStore | None = None
    """Store of the surface; None for a map on a server or of the past."""

    def __init__(self, store: TransactionalStore, base: str, categories: StoredCatalogue) -> None:
        self.store, self.base, self._categories = store, base, categories
        self._facts = RecordCodec(base, categories)
        self._dataset: rdflib.Dataset | None = None

    @property
    def engine(self) -> QuadStore:
        """The quad store, local or remote, for reading; direct writes bypass history and caches."""
        return self.store.engine

    @property
    def catalogue(self) -> Catalogue:
        """The categories of the map's ontology."""
        return self._categories()

    @property
    def sequence(self) -> int:
        """The number of the last transaction; 0 before the first."""
        return self.store.sequence

    @property
    def description(self) -> Description:
        """IRI, title, licence and time of creation."""
        return description_of(self.engine, self.base)

    @property
    def dataset(self) -> rdflib.Dataset:
        """The live store as rdflib sees it; the default graph is the union of all graphs.

        Pass queries as text: prepared queries use rdflib's own, slow engine. Its ``update`` is that
        of this class, and may write graph:commonsense; it refuses to write single triples. Raises
        GraphError for a map on a server.
        """
        if self._dataset is None:
            from kg.store.rdflib_view import dataset_of

            self._dataset = dataset_of(self.store.native, self._update_by_rdflib)
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

        - `category`: a label or IRI; includes its subcategories
        - `place`: a label, number or IRI
        - `near`: a point (x, y) [m], whose z is passed over, or the name or IRI of an object,
          which is itself left out; selects objects within `radius` [m] over the floor, the nearest
          first
        - `min_existence`: 0.5 gives the objects of the query `objects`
        - `at`: reads that past state (see `at`)

        Raises UnknownCategoryError, QueryParameterError for invalid values, HistoryError for a past
        that is not kept.
        """
        if at is not None:
            with self.at(at) as then:
                return then.objects(
                    category, place=place, near=near, radius=radius, min_existence=min_existence
                )
        if near is not None and (view := self.in_one_frame()) is not self:
            return view.objects(
                category, place=place, near=near, radius=radius, min_existence=min_existence
            )
        found = select_objects(
            self.engine,
            self._facts,
            None if category is None else self.resolve("category", category),
            None if place is None else self.resolve("place", str(place)),
            self.resolve("iri", near) if isinstance(near, str) else near,
            radius,
        )
        return tuple(record for record in found if record.existence >= min_existence)

    def unnamed_things(self) -> tuple[ObjectRecord, ...]:
        """Things that stand out of their surroundings and that nobody named, oldest first.

        `objects` leaves them out, as all lists of objects do.
        """
        return self._facts.unnamed_things(self.engine)

    def places(
        self,
        category: str | None = None,
        *,
        min_belief: float | None = None,
        at: Instant | None = None,
    ) -> tuple[PlaceRecord, ...]:
        """Places, by number: all, or those of a category or of a subcategory.

        A place has its most probable category; with `min_belief` it has each category of at least
        that probability (without `category`: any). `at` reads that past state (see `at`).
        Raises UnknownCategoryError, and HistoryError for a past that is not kept.
        """
        if at is not None:
            with self.at(at) as then:
                return then.places(category, min_belief=min_belief)
        places = self._facts.places(self.engine)
        if category is None and min_belief is None:
            return places
        kinds = None
        if category is not None:
            wanted = self.catalogue.find(category, "place").iri
            kinds = subcategories(self.engine, wanted)
        return tuple(place for place in places if is_believed(place, kinds, min_belief))

    def network(self, *, near: float = 1.0) -> nx.Graph[str]:
        """Objects and places as a networkx graph with edges "in" and "near" (within `near` [m])."""
        if not near > 0:
            raise QueryParameterError(f"near must be a distance above 0 m, got {near!r}")
        view = self.in_one_frame()
        return network(view.objects(), view.places(), view.catalogue, near)

    def robot(self) -> RobotRecord | None:
        """The last pose of the robot; None without a robot."""
        return robot_in(self.engine, self.base)

    def departed(self, iris: Collection[str] | None = None) -> tuple[DepartedRecord, ...]:
        """Departed objects, all or only `iris`; the latest last."""
        return tuple(departed_in(self.engine, iris))

    def doors(self) -> tuple[DoorRecord, ...]:
        """The doors between places."""
        return doors_in(self.engine)

    def floor(self) -> tuple[FloorTile, ...]:
        """The occupancy grid's tiles, by storey, column and row; empty without depth frames."""
        return tiles_in(self.engine)

    def recordings(self) -> tuple[RecordingRecord, ...]:
        """The progress of each recording, by name."""
        return recordings_in(self.engine, self.base)

    def picture(self, iri: str) -> bytes | None:
        """JPEG of the best observation of an object; None without one, and for past moments."""
        found = self.perceived.objects([iri])
        return ObjectPictures(path).read(found[0]) if found and (path := self.store.path) else None

    def query(
        self,
        question: str | Path | ParameterizedQuery,
        /,
        *,
        language: str = "",
        **parameters: object,
    ) -> Table:
        """The result of a query: the name of a shipped one, a ``.rq`` file, or SPARQL text.

        Text with a brace or an IRI, or that begins with DESCRIBE, is SPARQL: prefixes are
        predeclared, relative IRIs are the map's (``<object/17>``), patterns read the union of all
        named graphs, and CONSTRUCT and DESCRIBE give a TripleTable. A `category` parameter takes a
        label ("banana") or an IRI, a `place` parameter a label, a number or an IRI. Shipped queries
        give each thing one label: in `language` ("de", or "de, fr;q=0.5") where it has one.
        Raises UnknownQueryError, QueryParameterError, UnknownCategoryError, and QueryError for a
        query that does not parse, would write, or has SERVICE. An empty Table has `notes` on terms
        that the map lacks.
        """
        query = resolve_query(question, parameters)
        if query.measures and (view := self.in_one_frame()) is not self:
            return view.query(query, language=language, **parameters)
        sparql = query.bind(parameters, self.resolve, language)
        table = evaluate(self.engine, sparql, query.name, base=self.base, shipped=query.shipped)
        if not query.shipped and not table.rows:
            table = replace(table, notes=absent_terms(sparql, self.engine))
        return query.check(table)

    def resolve(self, kind: str, text: str) -> str:
        """IRI of a "category", a "place" or any thing ("iri") by its name, at every door.

        As "size" a category gives its usual longest side [m] as text.
        A place has a label, a number and an IRI; a thing an id (object/17), an IRI, a label in
        large or small letters, with or without an article, and its category where it alone has it.
        As "thing" only ids, IRIs and labels count, and other texts are "". As "asserted" a thing
        also has the name that it would have without the assertions about it. Raises
        UnknownCategoryError or QueryParameterError, which list the alternatives.
        """
        resolver = ParameterResolver(
            self.engine, self.base, self.catalogue, self.places, self._believed_of
        )
        if kind != "asserted":
            return resolver.resolve(kind, text)
        try:
            return resolver.resolve("iri", text)
        except QueryParameterError:
            perceived = replace(
                resolver, places=self.perceived.places, objects_of=self._perceived_of
            )
            with suppress(QueryParameterError):
                return perceived.resolve("iri", text)
            raise

    def _perceived_of(self, category: str) -> list[str]:
        """As `_believed_of`, as perception alone estimates them."""
        kinds = subcategories(self.engine, category)
        found = self.perceived.objects()
        return [one.iri for one in found if one.category in kinds and one.existence >= 0.5]

    def _believed_of(self, category: str) -> tuple[str, ...]:
        """IRIs of the objects of a category (IRI), of things without a name too."""
        if category == UNNAMED_THING:
            return tuple(record.iri for record in self.unnamed_things())
        return tuple(record.iri for record in self.objects(category, min_existence=0.5))

    def place_iri(self, number: int) -> str:
        """``<base>place/N``."""
        return f"{self.base}place/{number}"

    @abstractmethod
    def surface(self, *, min_count: int = 1) -> Surface:
        """The coloured voxels of what depth images showed, from `min_count` frames on.

        Centres (n, 3) [m] in the map frame, colours (n, 3), counts and times, all of length n; n is
        0 for a map without a surface. A past map (`at`) has the voxels that had been seen by then
        and were not gone yet, with the present colours. Raises GraphError for a damaged file.
        """

    @abstractmethod
    def new_object_iri(self) -> str:
        """``<base>object/N`` with a number no object of this map has had or will have."""

    @abstractmethod
    def apply(self, update: MapUpdate, cause: Cause | None = None) -> ChangeSet | None:
        """Write the changes in one transaction, and return it; None if nothing changed.

        Without a `cause` the transaction is the mapper's, with the frame of `update`. Raises
        InvalidFactError for an invalid record and, on a server, ConflictError if others changed the
        same things since the last `subscriptions.catch_up`; nothing is then written.
        """

    @abstractmethod
    def update(
        self, sparql: str, *, by: str | None = None, confirmed: bool = False
    ) -> ChangeSet | None:
        """Apply a SPARQL 1.1 Update of a person or program as one transaction; None if no change.

        A triple without GRAPH is one of graph:map; WHERE reads all graphs; relative IRIs are the
        map's (``<object/17>``). Derived facts are written too
        (`kg.maps.update.completion`). A large deletion must be `confirmed`.

        If an error is raised, nothing is written: QueryError for an update that does not parse or
        reads other sources, ProtectedError, ShapeError and UnconfirmedDeletionError for changes
        that are not allowed.
        """

    @abstractmethod
    def describe(
        self, *, title: str | None = None, licence: str | None = None, by: str | None = None
    ) -> ChangeSet | None:
        """Set the title or the licence (an absolute IRI); returns None if nothing changed.

        Raises InvalidFactError for an invalid title or IRI.
        """

    @abstractmethod
    def place_frame(
        self, relative_to: str, T: ArrayLike, *, by: str | None = None
    ) -> ChangeSet | None:
        """State that `T` (4, 4) takes coordinates of this map to the frame with IRI `relative_to`.

        Replaces an earlier transform; returns None if nothing changed. Raises InvalidFactError for
        a transform that is not rigid or tilts the vertical, and for the map's own frame.
        """

    @abstractmethod
    def restore(
        self,
        when: Instant,
        *,
        only: Collection[str] = (),
        by: str | None = None,
        confirmed: bool = False,
        dry_run: bool = False,
    ) -> Restored:
        """Restore the state at `when` in one new transaction; the history keeps both states.

        `only` restores parts: "objects", "places", "assertions", "ontology", or things by IRI
        (object/17). Without it everything is restored except the number of the next object. A
        `dry_run` counts the changes and writes nothing.

        Raises HistoryError for a past that is not kept, QueryParameterError for an unknown part,
        OntologyError and ShapeError if a part does not fit the present rest, and
        UnconfirmedDeletionError as `update` does.
        """

    @abstractmethod
    def hold(self) -> AbstractContextManager[None]:
        """Lock the map against writes of other threads for a block that reads and then writes.

        Other threads wait until the block ends, so it should take milliseconds. Other processes,
        which share a map on a server, are not locked out: within the block `apply` raises
        ConflictError if they changed the same things since it began.
        """

    @abstractmethod
    def at(self, when: Instant) -> SemanticMap:
        """The read-only state of the map at `when`, usable while this map is open.

        `when` is a sequence number (42 or "#42"), a datetime, or ISO 8601 text, by the clock of the
        machine that wrote the map. Raises HistoryError for a past that is not kept.
        """

    def in_one_frame(self, name: str | None = None) -> SemanticMap:
        """This map with those of its store whose frames have a known way to its own, in its frame.

        A store of published or merged maps has several, and their coordinates are comparable in one
        frame only; maps without a known way are left out (`kg.maps.facts.coordinate_frames`).
        `name`, a title or IRI, chooses another map. The result is this map itself where all
        coordinates are in its frame, else a read-only copy in memory. Raises QueryParameterError
        for an unknown name.
        """
        return self

    @abstractmethod
    def snapshot(self) -> SemanticMap:
        """A read-only copy in memory of the current state."""

    def close(self) -> None:
        """Flush and close the store; a second call does nothing."""
        if "subscriptions" in vars(self):
            self.subscriptions.close()
        with self.hold():
            self._dataset = None
            self.store.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _update_by_rdflib(self, sparql: str, /, *, confirmed: bool = False) -> None:
        self.update(sparql, by="rdflib", confirmed=confirmed)
