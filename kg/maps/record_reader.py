"""Records of a map, read from its graph: objects, places, searches, recordings, assertions."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import TYPE_CHECKING

from pyoxigraph import Quad

from kg import vocabulary as v
from kg.errors import QueryParameterError
from kg.facts.assertion_service import AssertionService
from kg.facts.departed_objects import departed_in
from kg.facts.doors import doors_in
from kg.facts.networkx_graph import network
from kg.facts.object_filters import is_believed, select_objects, subcategories
from kg.facts.objects_and_places import RecordCodec
from kg.facts.occupancy import tiles_in
from kg.facts.robot_and_recordings import recordings_in, robot_in
from kg.ontology.catalogue import StoredCatalogue
from kg.query.parameter_resolution import ParameterResolver
from kg.rdf.skolem import anonymous
from kg.records import (
    Assertion,
    DepartedRecord,
    DoorRecord,
    FloorTile,
    ObjectRecord,
    PlaceRecord,
    RecordingRecord,
    RobotRecord,
)
from kg.store.transactional import TransactionalStore

if TYPE_CHECKING:
    import networkx as nx


class RecordReader:
    """Reads the records of the map in `store`, as `SemanticMap` documents its methods."""

    def __init__(
        self,
        store: TransactionalStore,
        facts: RecordCodec,
        assertions: AssertionService,
        categories: StoredCatalogue,
    ) -> None:
        self._store, self._facts, self._assertions = store, facts, assertions
        self._categories = categories

    def objects(
        self,
        category: str | None,
        place: str | int | None,
        near: tuple[float, float] | str | None,
        radius: float,
    ) -> tuple[ObjectRecord, ...]:
        """Objects that satisfy every given condition."""
        wanted = None if category is None else self._categories().find(category).iri
        room = None if place is None else self.resolve("place", str(place))
        return select_objects(self._store.engine, self._facts, wanted, room, near, radius)

    def places(self, category: str | None, min_belief: float | None) -> tuple[PlaceRecord, ...]:
        """Places of a category, or believed to be of it at least that much."""
        places = self.all_places()
        if category is None and min_belief is None:
            return places
        kinds = None
        if category is not None:
            wanted = self._categories().find(category, "place").iri
            kinds = subcategories(self._store.engine, wanted)
        return tuple(place for place in places if is_believed(place, kinds, min_belief))

    def all_places(self) -> tuple[PlaceRecord, ...]:
        """Places, by number."""
        return self._facts.places(self._store.engine)

    def network(self, near: float) -> nx.Graph[str]:
        """Objects and places as a networkx graph."""
        if not near > 0:
            raise QueryParameterError(f"near must be a distance above 0 m, got {near!r}")
        objects = self.objects(None, None, None, 0.0)
        return network(objects, self.all_places(), self._categories(), near)

    def robot(self) -> RobotRecord | None:
        """The last pose of the robot."""
        return robot_in(self._store.engine, self._facts.base)

    def departed(self, iris: Collection[str] | None) -> tuple[DepartedRecord, ...]:
        """Objects that left; all, or some."""
        return tuple(departed_in(self._store.engine, iris))

    def doors(self) -> tuple[DoorRecord, ...]:
        """The doors between places."""
        return doors_in(self._store.engine)

    def floor(self) -> tuple[FloorTile, ...]:
        """The tiles of the occupancy grid."""
        return tiles_in(self._store.engine)

    def recordings(self) -> tuple[RecordingRecord, ...]:
        """How far each recording has been applied."""
        return recordings_in(self._store.engine, self._facts.base)

    def ontology(self) -> tuple[Quad, ...]:
        """The quads of graph:ontology, with blank nodes, sorted."""
        graph = v.ONTOLOGY_GRAPH
        quads = self._store.engine.quads_for_pattern(None, None, None, graph)
        return tuple(sorted(anonymous(quads), key=str))

    def assertions(self, iri: str | None) -> tuple[Assertion, ...]:
        """Assertions of one thing, or of all."""
        return self._assertions.assertions(iri)

    def perceived_objects(self, iris: Iterable[str] | None) -> tuple[ObjectRecord, ...]:
        """Objects as perceived, without assertions; all, or some."""
        return self._assertions.objects(None if iris is None else tuple(iris))

    def perceived_places(self) -> tuple[PlaceRecord, ...]:
        """Places as perceived, without assertions."""
        return self._assertions.places()

    def resolve(self, kind: str, text: str) -> str:
        """The IRI of a category, place or thing given as a query parameter."""
        catalogue, base = self._categories(), self._facts.base
        return ParameterResolver(self._store.engine, base, catalogue, self.all_places).resolve(
            kind, text
        )
