"""What ontologies, ConceptNet and statistics say of every pair of object and place, as arrays."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from pyoxigraph import Quad

from kg import vocabulary as v
from kg.categories import Catalogue
from kg.ontology import superclasses
from kg.placement.commonplace import commonplaces
from kg.placement.model import Evidence, Matrix
from kg.placement.rooms import similar_places
from kg.placement.statistics import RoomStatistics, statistics
from kg.relations import Relation, relations

#: how the sources of the shipped relations begin: a list without probabilities of its own
_THESIS = "thesis"


@dataclass(frozen=True, slots=True)
class Said:
    """One piece of evidence, as a reason shows it."""

    source: str
    text: str


@dataclass(frozen=True, slots=True)
class Knowledge:
    """The evidence of one ontology, with what its rows (objects) and columns (places) are."""

    objects: Mapping[str, int]  # IRI -> row
    places: Mapping[str, int]  # IRI -> column
    above: Mapping[str, tuple[str, ...]]  # IRI -> itself and all its superclasses
    evidence: Evidence
    said: Mapping[tuple[int, int], tuple[Said, ...]]  # by row and column
    near: Mapping[tuple[str, str], tuple[float, float]]  # (object, other) -> sum of p, how many
    counted: Mapping[str, float]  # place IRI -> rooms of it in the statistics
    sources: tuple[str, ...] = field(default=())  # of the statistics


def knowledge(quads: Iterable[Quad], catalogue: Catalogue, *, shipped: bool = True) -> Knowledge:
    """The evidence in an ontology's quads about all its objects and places.

    A relation of a class is one of its subclasses too; here:Place itself is a column, for places
    of which nothing is known. With `shipped`, an ontology into which nobody imported ConceptNet is
    taken with the weights that ship (`kg.placement.commonplace`). Raises OntologyError as
    `relations` and `statistics` do.
    """
    quads = tuple(quads)
    above = superclasses(quads)
    of = {kind: [c.iri for c in catalogue.categories if c.kind == kind] for kind in _KINDS}
    objects = {iri: row for row, iri in enumerate(of["object"])}
    places = {iri: column for column, iri in enumerate((*of["place"], v.PLACE))}
    edges = relations(quads)
    counts = statistics(quads)
    builder = _Builder(objects, places, above)
    if shipped and not any(e.imported for r in edges for e in r.evidence):
        edges = (*edges, *commonplaces(catalogue))
    for relation in edges:
        builder.add(relation)
    rooms, held = room_counts(counts, objects, places)
    _lend_to_subclasses(rooms, held, objects, above)
    return Knowledge(
        objects=objects,
        places=places,
        above=above,
        evidence=Evidence(
            listed=builder.listed,
            weight=builder.weight,
            rooms=rooms,
            rooms_with=held,
            similar=similar_places(tuple(places), catalogue, above),
            kindred=_kindred(tuple(objects), above),
            seen_with=np.zeros_like(rooms),
            seen_without=np.zeros_like(rooms),
            stated=builder.stated,
            statements=builder.statements,
        ),
        said={cell: tuple(dict.fromkeys(said)) for cell, said in builder.said.items()},
        near=_near(edges),
        counted=_rooms_of(counts),
        sources=tuple(sorted({count.source for count in counts})),
    )


_KINDS = ("object", "place")


class _Builder:
    """Spreads relations over the rows and columns of the classes below theirs."""

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
        self.said: dict[tuple[int, int], list[Said]] = defaultdict(list)

    def add(self, relation: Relation) -> None:
        """Take in a here:locatedAt; others are left out."""
        if relation.kind != v.LOCATED_AT:
            return
        cells = np.ix_(self._rows[relation.subject], self._columns[relation.target])
        for evidence in relation.evidence:
            source = "; ".join(_text(s) for s in evidence.sources) or "ontology"
            if evidence.imported:
                net = max((evidence.weight or 0.0) - evidence.weight_against, 0.0)
                self.weight[cells] = np.maximum(self.weight[cells], net)
                text = f"weight {net:g}"
            elif source.startswith(_THESIS):
                self.listed[cells] = np.maximum(self.listed[cells], evidence.probability)
                text = f"listed, {evidence.probability:g}"
            else:
                self.stated[cells] += evidence.probability
                self.statements[cells] += 1
                text = f"stated, {evidence.probability:g}"
            for row in self._rows[relation.subject]:
                for column in self._columns[relation.target]:
                    self.said[row, column].append(Said(source, text))


def _text(source: object) -> str:
    return str(getattr(source, "value", source))


def _below(
    index: Mapping[str, int], above: Mapping[str, tuple[str, ...]]
) -> defaultdict[str, list[int]]:
    """For each class, the indices of itself and of what is below it."""
    found: defaultdict[str, list[int]] = defaultdict(list)
    for iri, number in index.items():
        for up in above.get(iri, (iri,)):
            found[up].append(number)
    return found


def room_counts(
    counts: Iterable[RoomStatistics], objects: Mapping[str, int], places: Mapping[str, int]
) -> tuple[Matrix, Matrix]:
    """(n, m) rooms searched and rooms that held the object, all sources together.

    A source searched all its rooms for every object it names anywhere: a pair it does not name is
    0 of the rooms of that place. An object it never names it did not look for.
    """
    rooms, held = np.zeros((2, len(objects), len(places)))
    by_source: dict[str, list[RoomStatistics]] = defaultdict(list)
    for count in counts:
        by_source[count.source].append(count)
    for found in by_source.values():
        sought = sorted({objects[c.object] for c in found if c.object in objects and c.rooms_with})
        for place, number in _rooms_of(found).items():
            if place in places:
                rooms[sought, places[place]] += number
        for count in found:
            if count.object in objects and count.place in places:
                held[objects[count.object], places[count.place]] += count.rooms_with
    return rooms, held


def _rooms_of(counts: Iterable[RoomStatistics]) -> dict[str, float]:
    most: dict[tuple[str, str], int] = {}
    for count in counts:
        key = (count.source, count.place)
        most[key] = max(most.get(key, 0), count.rooms)
    total: dict[str, float] = defaultdict(float)
    for (_, place), number in most.items():
        total[place] += number
    return dict(total)


def _lend_to_subclasses(
    rooms: Matrix, held: Matrix, objects: Mapping[str, int], above: Mapping[str, tuple[str, ...]]
) -> None:
    """An object nobody counted takes the counts of its nearest counted superclass."""
    counted = {iri for iri, row in objects.items() if rooms[row].any()}
    for iri, row in objects.items():
        lenders = [up for up in above.get(iri, ()) if up in counted and up != iri]
        if iri not in counted and lenders:
            nearest = max(lenders, key=lambda up: (len(above[up]), up))
            rooms[row], held[row] = rooms[objects[nearest]], held[objects[nearest]]


def _kindred(objects: tuple[str, ...], above: Mapping[str, tuple[str, ...]]) -> Matrix:
    ups = [set(above.get(iri, ())) - {iri, v.OBJECT} for iri in objects]
    alike = np.array([[float(bool(a & b)) for b in ups] for a in ups])
    return alike.reshape(len(objects), len(objects)) * (1 - np.eye(len(objects)))


def _near(edges: Iterable[Relation]) -> dict[tuple[str, str], tuple[float, float]]:
    found: dict[tuple[str, str], tuple[float, float]] = {}
    for edge in edges:
        if edge.kind == v.NEAR_BY:
            found[edge.subject, edge.target] = (
                sum(e.probability for e in edge.evidence),
                float(len(edge.evidence)),
            )
    return found
