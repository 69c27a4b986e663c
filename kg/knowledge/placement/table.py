"""Placement table: p(object in place) with its uncertainty and its reasons.

table = table_of(quads)
table.probability(banana, kitchen)       # IRIs; 0.31
table.placement(banana, kitchen).reasons # its sources, and the share of each
table.place_posterior({oven: 1, sink: 1}, prior)
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from pyoxigraph import Quad

from kg.knowledge.ontology.catalogue import Catalogue
from kg.knowledge.placement.belief_model import (
    BASE,
    CONCEPTNET,
    FITTED,
    LISTED,
    STATEMENT_STRENGTH,
    PlacementParameters,
    log_odds_terms,
    posterior,
    posterior_belief,
)
from kg.knowledge.placement.evidence import (
    MapCounts,
    PlacedObject,
    PlacementEvidence,
    map_counts,
    placement_evidence,
)
from kg.knowledge.placement.surveys import room_frequencies
from kg.model import vocabulary as v
from kg.model.errors import UnknownCategoryError
from kg.model.records import PlaceRecord


@dataclass(frozen=True, slots=True)
class PlacementReason:
    """One source of a probability with its share; the shares of a placement add up to 1."""

    source: str
    text: str
    share: float  # 0..1


@dataclass(frozen=True, slots=True)
class Placement:
    """Probability that a place of a kind holds at least one object of a kind: Beta(alpha, beta)."""

    object: str  # IRI
    place: str  # IRI
    probability: float  # alpha / (alpha + beta), strictly between 0 and 1
    alpha: float
    beta: float
    reasons: tuple[PlacementReason, ...]  # the largest share first


def table_of(
    quads: Iterable[Quad],
    places: Iterable[PlaceRecord] = (),
    objects: Iterable[PlacedObject] = (),
    *,
    catalogue: Catalogue | None = None,
    parameters: PlacementParameters = FITTED,
    sought: Collection[str] | None = None,
) -> PlacementTable:
    """Placement table of an ontology, with its imported statistics, and of a map's rooms.

    Args:
        quads: quads of graph:ontology.
        places: rooms of a map, if any.
        objects: objects of the map.
        catalogue: that of `quads`; it is read from them where it is not given.
        parameters: strengths of the sources.
        sought: IRIs of the objects that the map's detector can detect; only for these does a
            searched room count as a room without the object. None: all objects.

    Raises:
        OntologyError: for an invalid ontology.
    """
    quads = tuple(quads)
    catalogue = catalogue or Catalogue.from_quads(quads)
    known = placement_evidence(quads, catalogue)
    rooms = map_counts(places, objects, known.objects, known.places, known.above, sought)
    return PlacementTable(known, catalogue, rooms, parameters)


class PlacementTable:
    """Placement probabilities of one moment; immutable. Arguments are IRIs of categories.

    A supercategory as object means at least one of its members. A place outside of the table counts
    as a place of unknown category. Unknown objects raise UnknownCategoryError.
    """

    def __init__(
        self,
        known: PlacementEvidence,
        catalogue: Catalogue,
        rooms: MapCounts,
        parameters: PlacementParameters,
    ) -> None:
        self._known, self._catalogue = known, catalogue
        self._rooms, self._parameters = rooms, parameters
        self._evidence = replace(
            known.evidence, building_with=rooms.with_object, building_without=rooms.without_object
        )
        self._belief = posterior_belief(self._evidence, parameters)
        self._mean = self._belief.mean
        e = self._evidence
        counted = sum((survey.covers_place for survey in e.surveys), e.rooms)
        total = e.listed + e.weight + counted + e.statements + e.building_with
        #: (n, m) whether a pair has any evidence
        self._informed: NDArray[np.bool_] = np.asarray(total > 0)

    @property
    def objects(self) -> tuple[str, ...]:
        """IRIs of the object categories in the table."""
        return tuple(self._known.objects)

    @property
    def places(self) -> tuple[str, ...]:
        """IRIs of the place categories in the table."""
        return tuple(iri for iri in self._known.places if iri != v.PLACE)

    @property
    def room_frequencies(self) -> Mapping[str, float]:
        """Probability that a room of a home has each place category (by IRI), adding up to 1."""
        shares = room_frequencies(self.places, self._catalogue)
        return dict(zip(self.places, map(float, shares), strict=True))

    def probability(self, object_iri: str, place_iri: str) -> float:
        """Probability that a place of that category holds at least one such object."""
        rows, column = self._rows(object_iri), self._column(place_iri)
        return float(1 - np.prod(1 - self._mean[rows, column]))

    def placement(self, object_iri: str, place_iri: str) -> Placement:
        """Probability, uncertainty and reasons (of its likeliest member for a supercategory)."""
        rows, column = self._rows(object_iri), self._column(place_iri)
        p = self.probability(object_iri, place_iri)
        total = min(self._total(row, column) for row in rows)
        best = max(rows, key=lambda row: float(self._mean[row, column]))
        reasons = sorted(self._reasons(best, column), key=lambda r: (-r.share, r.source, r.text))
        return Placement(object_iri, place_iri, p, p * total, (1 - p) * total, tuple(reasons))

    def near(self, object_iri: str, other_iri: str) -> float:
        """Probability that the room of the other object holds at least one of the first object.

        It is the probability that places explain, updated by stated here:nearBy relations and by
        the rooms of this map with the other object.
        """
        rows, others = self._rows(object_iri), self._rows(other_iri)
        return float(np.mean([1 - np.prod([1 - self._near(a, b) for a in rows]) for b in others]))

    def place_posterior(
        self, observed: Mapping[str, float], prior: Mapping[str, float]
    ) -> dict[str, float]:
        """p(place category | objects in the place), by IRI, adding up to 1.

        Objects outside of the table are ignored.

        Args:
            observed: number of objects of each category; more than one counts as one, and a
                fraction is the probability of at least one.
            prior: prior beliefs of the candidate categories, >= 0.

        Raises:
            UnknownCategoryError: `prior` has no known category with a belief above 0.
        """
        weights = {iri: p for iri, p in prior.items() if iri in self._known.places and p > 0}
        if not weights:
            raise UnknownCategoryError(
                "no place category of the prior is known and believed: "
                f"{', '.join(prior) or 'none'}"
            )
        counts = {
            self._known.objects[o]: n for o, n in observed.items() if o in self._known.objects
        }
        rows = sorted(row for row, count in counts.items() if count > 0)
        columns = [self._known.places[iri] for iri in weights]
        p = posterior(
            self._mean[np.ix_(rows, columns)],
            np.ones(len(rows), dtype=bool),
            np.array(list(weights.values())),
            np.array([min(float(counts[row]), 1.0) for row in rows]),
        )
        return dict(zip(weights, map(float, p), strict=True))

    def _rows(self, iri: str) -> list[int]:
        if iri in self._known.objects:
            return [self._known.objects[iri]]
        rows = [n for o, n in self._known.objects.items() if iri in self._known.above.get(o, ())]
        if not rows or iri == v.OBJECT:
            self._catalogue.label(iri)
            raise UnknownCategoryError(f"{iri} is no kind of object; give the IRI of one")
        return rows

    def _column(self, iri: str) -> int:
        return self._known.places.get(iri, self._known.places[v.PLACE])

    def _total(self, row: int, column: int) -> float:
        return float(self._belief.alpha[row, column] + self._belief.beta[row, column])

    def _near(self, row: int, other: int) -> float:
        k = 1 / (1 / self._parameters.kappa + 1 / self._parameters.tau)
        informed = self._informed[[row, other]].any(axis=0)
        where = self._mean[other] * (informed if informed.any() else 1.0)
        together = float(where @ self._mean[row] / where.sum())
        with_it, without = self._rooms.near(row, other)
        stated, count = self._stated_near(row, other)
        total = k + STATEMENT_STRENGTH * count + with_it + without
        return (k * together + STATEMENT_STRENGTH * stated + with_it) / total

    def _stated_near(self, row: int, other: int) -> tuple[float, float]:
        above = self._known.above
        iris = list(self._known.objects)
        pairs = [
            self._known.near[a, b]
            for a in above.get(iris[row], (iris[row],))
            for b in above.get(iris[other], (iris[other],))
            if (a, b) in self._known.near
        ]
        return sum(p for p, _ in pairs), sum(n for _, n in pairs)

    def _reasons(self, row: int, column: int) -> Iterator[PlacementReason]:
        e, total = self._evidence, self._total(row, column)
        rooms, strength = float(e.rooms[row, column]), float(self._belief.strength[row, column])
        expected = float(self._belief.share[row, column])
        yield from self._prior_reasons(row, column, strength * expected / total)
        if rooms:
            text = f"{e.rooms_with[row, column]:g} of {rooms:g} rooms"
            source = "; ".join(self._known.sources)
            yield PlacementReason(source, text, strength * (1 - expected) / total)
        present, absent = e.building_with[row, column], e.building_without[row, column]
        if present + absent > 0:
            text = f"{present:.1f} rooms with, {absent:.1f} without"
            yield PlacementReason("this map", text, float(present + absent) / total)
        stated = self._stated_relations(row, column, "stated")
        for source, text in stated:
            share = STATEMENT_STRENGTH * float(e.statements[row, column]) / total / len(stated)
            yield PlacementReason(source, text, share)

    def _prior_reasons(self, row: int, column: int, share: float) -> Iterator[PlacementReason]:
        """Reasons for m0, with shares in proportion to the absolute log-odds of each term."""
        parts: list[tuple[str, str, float]] = []
        for name, term in log_odds_terms(self._evidence, self._parameters):
            moved = float(term[row, column])
            if name == BASE:
                parts.append((name, "how rare objects are at large", moved))
            elif name in (LISTED, CONCEPTNET):
                stated = self._stated_relations(
                    row, column, "listed" if name == LISTED else "weight"
                )
                parts += [(source, text, moved / len(stated)) for source, text in stated]
            else:
                parts.append((name, self._survey_text(name, row, column), moved))
        whole = sum(abs(moved) for *_, moved in parts) or 1.0
        for source, text, moved in parts:
            if moved:
                yield PlacementReason(source, text, share * abs(moved) / whole)

    def _survey_text(self, name: str, row: int, column: int) -> str:
        (survey,) = (survey for survey in self._evidence.surveys if survey.name == name)
        rooms, held = survey.rooms[row, column], survey.rooms_with[row, column]
        return f"{held:g} of {rooms:g} such rooms" if rooms else "its rate in all rooms"

    def _stated_relations(self, row: int, column: int, kind: str) -> list[tuple[str, str]]:
        """Source and text of the relations whose text begins with a kind."""
        found = self._known.stated_relations.get((row, column), ())
        return [(source, text) for source, text in found if text.startswith(kind)]
