"""Placement evidence of ontologies, ConceptNet and statistics for each pair, as arrays."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Final, Protocol

import numpy as np
from pyoxigraph import Quad

from kg.knowledge.conceptnet.edges import probability_of
from kg.knowledge.ontology.catalogue import Catalogue
from kg.knowledge.ontology.loading import superclasses
from kg.knowledge.ontology.relations import CategoryRelation, RelationEvidence, relations
from kg.knowledge.placement.belief_model import (
    HALF_SEARCHED_VIEWS,
    MIN_VIEWS,
    EvidenceArrays,
    Matrix,
)
from kg.knowledge.placement.statistics import RoomStatistics, statistics
from kg.knowledge.placement.surveys import survey_features
from kg.model import vocabulary as v
from kg.model.records import PlaceRecord
from kg.model.resources import table_rows

#: prefix of the sources of the shipped relations: a list without probabilities of its own
_THESIS = "thesis"

TABLE: Final = Path(__file__).with_name("tables") / "conceptnet.csv"
SOURCE: Final = "ConceptNet 4 (CC BY-SA 4.0)"


@dataclass(frozen=True, slots=True)
class PlacementEvidence:
    """Placement evidence of one ontology, with the indices of objects and places."""

    objects: Mapping[str, int]  # IRI -> row
    places: Mapping[str, int]  # IRI -> column
    above: Mapping[str, tuple[str, ...]]  # IRI -> itself and all its superclasses
    evidence: EvidenceArrays
    #: by row and column: the source of each stated relation, and the relation in words
    stated_relations: Mapping[tuple[int, int], tuple[tuple[str, str], ...]]
    near: Mapping[tuple[str, str], tuple[float, float]]  # (object, other) -> sum of p, count
    sources: tuple[str, ...] = field(default=())  # of the statistics


def placement_evidence(quads: Iterable[Quad], catalogue: Catalogue) -> PlacementEvidence:
    """Placement evidence in an ontology's quads about all its objects and places.

    A relation of a class counts for its subclasses too. The class here:Place is a column for places
    of unknown category. An ontology without ConceptNet relations gets the shipped weights. Raises
    OntologyError as `relations` and `statistics`.
    """
    quads = tuple(quads)
    above = superclasses(quads)
    object_iris, place_iris = (
        [c.iri for c in catalogue.categories if c.kind == kind] for kind in ("object", "place")
    )
    objects = {iri: row for row, iri in enumerate(object_iris)}
    places = {iri: column for column, iri in enumerate((*place_iris, v.PLACE))}
    edges = relations(quads)
    counts = statistics(quads)
    builder = _Builder(objects, places, above)
    if not any(e.imported for r in edges for e in r.evidence):
        edges = (*edges, *shipped_relations(catalogue))
    for relation in edges:
        builder.add(relation)
    rooms, held = room_counts(counts, objects, places)
    _inherit_counts(rooms, held, objects, above)
    return PlacementEvidence(
        objects=objects,
        places=places,
        above=above,
        evidence=EvidenceArrays(
            listed=builder.listed,
            weight=builder.weight,
            surveys=survey_features(tuple(objects), tuple(places), catalogue, above),
            rooms=rooms,
            rooms_with=held,
            building_with=np.zeros_like(rooms),
            building_without=np.zeros_like(rooms),
            stated=builder.stated,
            statements=builder.statements,
        ),
        stated_relations={
            cell: tuple(dict.fromkeys(found)) for cell, found in builder.stated_relations.items()
        },
        near=_near(edges),
        sources=tuple(sorted({count.source for count in counts})),
    )


class _Builder:
    """Adds relations to the cells of all subclasses of their classes."""

    def __init__(
        self,
        objects: Mapping[str, int],
        places: Mapping[str, int],
        above: Mapping[str, tuple[str, ...]],
    ) -> None:
        self._rows, self._columns = _below(objects, above), _below(places, above)
        shape = (len(objects), len(places))
        self.listed, self.weight = np.zeros(shape), np.zeros(shape)
        self.stated, self.statements = np.zeros(shape), np.zeros(shape)
        self.stated_relations: dict[tuple[int, int], list[tuple[str, str]]] = defaultdict(list)

    def add(self, relation: CategoryRelation) -> None:
        """Add a here:locatedAt; other relations are ignored."""
        if relation.kind != v.LOCATED_AT:
            return
        cells = np.ix_(self._rows[relation.subject], self._columns[relation.target])
        for evidence in relation.evidence:
            sources = (str(getattr(source, "value", source)) for source in evidence.sources)
            source = "; ".join(sources) or "ontology"
            if evidence.imported:
                net = max((evidence.weight or 0.0) - evidence.weight_against, 0.0)
                self.weight[cells] = np.maximum(self.weight[cells], net)
                text = f"weight {net:g}"
            elif source.startswith(_THESIS):
                self.listed[cells] = 1.0
                text = f"listed, {evidence.probability:g}"
            else:
                self.stated[cells] += evidence.probability
                self.statements[cells] += 1
                text = f"stated, {evidence.probability:g}"
            for row in self._rows[relation.subject]:
                for column in self._columns[relation.target]:
                    self.stated_relations[row, column].append((source, text))


def _below(
    index: Mapping[str, int], above: Mapping[str, tuple[str, ...]]
) -> defaultdict[str, list[int]]:
    """For each class, the indices of itself and of its subclasses."""
    found: defaultdict[str, list[int]] = defaultdict(list)
    for iri, number in index.items():
        for up in above.get(iri, (iri,)):
            found[up].append(number)
    return found


def room_counts(
    counts: Iterable[RoomStatistics], objects: Mapping[str, int], places: Mapping[str, int]
) -> tuple[Matrix, Matrix]:
    """(n, m) rooms searched and rooms with the object, over all sources.

    A source that lists an object anywhere, also with 0, searched all its rooms for it: a pair
    without a count then means 0 of the rooms of that place. Objects that a source never lists do
    not count.
    """
    rooms, held = np.zeros((2, len(objects), len(places)))
    by_source: dict[str, list[RoomStatistics]] = defaultdict(list)
    for count in counts:
        by_source[count.source].append(count)
    for found in by_source.values():
        sought = sorted({objects[c.object] for c in found if c.object in objects})
        for place, number in _rooms_of(found).items():
            if place in places:
                rooms[sought, places[place]] += number
        for count in found:
            if count.object in objects and count.place in places:
                held[objects[count.object], places[count.place]] += count.rooms_with
    return rooms, held


def _rooms_of(counts: Iterable[RoomStatistics]) -> dict[str, int]:
    """The rooms of each kind of place in the counts of one source."""
    most: dict[str, int] = defaultdict(int)
    for count in counts:
        most[count.place] = max(most[count.place], count.rooms)
    return most


def _inherit_counts(
    rooms: Matrix, held: Matrix, objects: Mapping[str, int], above: Mapping[str, tuple[str, ...]]
) -> None:
    """Objects without counts inherit the counts of their nearest counted superclass."""
    counted = {iri for iri, row in objects.items() if rooms[row].any()}
    for iri, row in objects.items():
        ancestors = [up for up in above.get(iri, ()) if up in counted and up != iri]
        if iri not in counted and ancestors:
            nearest = max(ancestors, key=lambda up: (len(above[up]), up))
            rooms[row], held[row] = rooms[objects[nearest]], held[objects[nearest]]


def _near(edges: Iterable[CategoryRelation]) -> dict[tuple[str, str], tuple[float, float]]:
    found: dict[tuple[str, str], tuple[float, float]] = {}
    for edge in edges:
        if edge.kind == v.NEAR_BY:
            found[edge.subject, edge.target] = (
                sum(e.probability for e in edge.evidence),
                float(len(edge.evidence)),
            )
    return found


def shipped_relations(catalogue: Catalogue) -> Iterator[CategoryRelation]:
    """A here:locatedAt for each row of `tables/conceptnet.csv` with two known categories.

    The table has the weights that `hereabouts import conceptnet` finds in ConceptNet 4 for the
    shipped categories. The shipped ontologies contain only the relations of the thesis.
    """
    for row in _shipped_rows():
        subject, target = (
            catalogue.get(row["object"], "object"),
            catalogue.get(row["place"], "place"),
        )
        if subject is None or target is None:
            continue
        weight, against = float(row["weight"]), float(row["weight_against"])
        p = probability_of(max(weight - against, 0.0))
        evidence = RelationEvidence(p, (SOURCE,), weight, against, stated=False)
        yield CategoryRelation(v.LOCATED_AT, subject.iri, target.iri, p, (SOURCE,), (evidence,))


@cache
def _shipped_rows() -> list[dict[str, str]]:
    return table_rows(TABLE)


@dataclass(frozen=True, slots=True)
class MapCounts:
    """Beliefs about the r places of a map: their categories and the objects they hold."""

    kind: Matrix  # (r, m) belief in each place category
    holds: Matrix  # (r, n) probability that the place holds an object of each kind
    searched: Matrix  # (r, n) fraction of the place that was searched for each kind, 0..1

    @property
    def with_object(self) -> Matrix:
        """(n, m) expected number of rooms of each kind with each object."""
        return np.asarray(self.holds.T @ self.kind)

    @property
    def without_object(self) -> Matrix:
        """(n, m) expected number of rooms of each kind searched without finding the object."""
        return np.asarray(((1 - self.holds) * self.searched).T @ self.kind)

    def near(self, row: int, other: int) -> tuple[float, float]:
        """Expected number of rooms with `other` and with, or without, the object `row`."""
        with_other = self.holds[:, other]
        without = (1 - self.holds[:, row]) * self.searched[:, row]
        return float(with_other @ self.holds[:, row]), float(with_other @ without)


def searched_fraction(views: int) -> float:
    """Fraction of a place, 0..1, that counts as searched after `views` scene categorisations."""
    return views / (views + HALF_SEARCHED_VIEWS) if views >= MIN_VIEWS else 0.0


class PlacedObject(Protocol):
    """An object counts by these properties; an `ObjectRecord` has them."""

    @property
    def category(self) -> str:
        """IRI."""

    @property
    def place(self) -> str | None:
        """IRI, if it is in a place."""

    @property
    def existence(self) -> float:
        """Probability, 0..1."""


def map_counts(
    places: Iterable[PlaceRecord],
    records: Iterable[PlacedObject],
    objects: Mapping[str, int],
    columns: Mapping[str, int],
    above: Mapping[str, tuple[str, ...]],
    sought: Collection[str] | None = None,
) -> MapCounts:
    """Room counts of a map's records, with the numbers of objects and places by IRI.

    A place counts for each category in proportion to its belief. It holds an object with the
    probability that at least one object of the category, or of a subcategory, exists there. It was
    searched for the objects with IRIs in `sought` (None: for all).
    """
    rooms = tuple(places)
    number = {room.iri: n for n, room in enumerate(rooms)}
    kind = np.zeros((len(rooms), len(columns)))
    for n, room in enumerate(rooms):
        for iri, belief in room.beliefs.items():
            if iri in columns:
                kind[n, columns[iri]] = min(max(belief, 0.0), 1.0)
    absent = np.ones((len(rooms), len(objects)))
    for record in records:
        if record.place in number:
            for iri in above.get(record.category, (record.category,)):
                if iri in objects:
                    absent[number[record.place], objects[iri]] *= 1 - record.existence
    share = np.array([searched_fraction(room.views) for room in rooms])
    mask = [float(sought is None or iri in sought) for iri in objects]
    return MapCounts(kind, 1 - absent, share.reshape(-1, 1) * np.array(mask))
