"""Object filters: by category, by place, near a point or near another object.

The most selective index (cells, place, category) gives the candidates, and each is checked against
all criteria. So the cost depends on the number of candidates, not on the size of the map.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from pyoxigraph import NamedNode

from kg.maps.facts.objects_and_places import RecordCodec
from kg.model import vocabulary as v
from kg.model.errors import QueryParameterError
from kg.model.records import ObjectRecord, PlaceRecord, likeliest
from kg.rdf.literals import cells_of_disc
from kg.rdf.quad_store import QuadStore


@dataclass(frozen=True, slots=True)
class Disc:
    """A disc over the floor, map frame."""

    x: float  # [m]
    y: float  # [m]
    radius: float  # [m]

    def distance(self, record: ObjectRecord) -> float:
        """Distance of an object from the centre, over the floor [m]."""
        return math.hypot(record.p_map[0] - self.x, record.p_map[1] - self.y)


@dataclass(frozen=True, slots=True)
class ObjectFilter:
    """Criteria that objects must meet; None stands for any value."""

    categories: frozenset[str] | None = None
    place: str | None = None
    disc: Disc | None = None
    other_than: str | None = None

    @property
    def everything(self) -> bool:
        """Whether there is no criterion, so that all objects match."""
        return self.categories is None and self.place is None and self.disc is None

    def candidates(self, engine: QuadStore) -> set[str]:
        """IRIs of a superset of the matches; needs at least one criterion."""
        found = set()
        for predicate, value in self._lookups(engine):
            for quad in engine.quads_for_pattern(
                None, NamedNode(predicate), NamedNode(value), v.MAP_GRAPH
            ):
                if isinstance(quad.subject, NamedNode):
                    found.add(quad.subject.value)
        return found - {self.other_than or ""}

    def admits(self, record: ObjectRecord) -> bool:
        """Whether an object meets all criteria."""
        return (
            (
                record.category != v.UNNAMED_THING
                if self.categories is None
                else record.category in self.categories
            )
            and (self.place is None or record.place == self.place)
            and (self.disc is None or self.disc.distance(record) <= self.disc.radius)
        )

    def _lookups(self, engine: QuadStore) -> Iterator[tuple[str, str]]:
        cells = cells_of_disc(self.disc.x, self.disc.y, self.disc.radius) if self.disc else None
        if cells is not None:
            yield from ((v.IN_CELL, cell) for cell in cells)
        elif self.place is not None:
            yield v.IN_PLACE, self.place
        else:
            classes = self.categories
            if classes is None:  # objects have the types of their categories alone
                classes = subcategories(engine, v.OBJECT)
            yield from ((v.RDF_TYPE.value, category) for category in classes)


def select_objects(
    engine: QuadStore,
    facts: RecordCodec,
    category: str | None,
    place: str | None,
    near: tuple[float, float] | str | None,
    radius: float,
) -> tuple[ObjectRecord, ...]:
    """Objects that match, nearest first where `near` is given, else oldest first.

    `category` and `place` are IRIs. Raises QueryParameterError for an invalid `near`.
    """
    chosen = ObjectFilter(
        categories=None if category is None else subcategories(engine, category),
        place=place,
        disc=None if near is None else _disc(engine, facts, near, radius),
        other_than=near if isinstance(near, str) else None,
    )
    if chosen.everything:
        return facts.objects(engine)
    found = filter(chosen.admits, facts.some_objects(engine, chosen.candidates(engine)))
    return tuple(sorted(found, key=chosen.disc.distance) if chosen.disc else found)


def _disc(
    engine: QuadStore, facts: RecordCodec, near: tuple[float, float] | str, radius: float
) -> Disc:
    if isinstance(near, str):
        found = facts.some_objects(engine, [near])
        if not found:
            raise QueryParameterError(f"near: no object {near!r} in this map")
        near = float(found[0].p_map[0]), float(found[0].p_map[1])
    x, y = near
    if not (math.isfinite(x) and math.isfinite(y) and 0 <= radius < math.inf):
        raise QueryParameterError(
            f"near must be finite (x, y) with a radius of 0 m or more, got {near}, {radius}"
        )
    return Disc(x, y, radius)


def subcategories(engine: QuadStore, category: str) -> frozenset[str]:
    """IRIs of a category and of all its subcategories."""
    isa, above = NamedNode(v.IS_A), NamedNode(category)
    quads = engine.quads_for_pattern(None, isa, above, v.COMMONSENSE_GRAPH)
    found = {q.subject.value for q in quads if isinstance(q.subject, NamedNode)}
    return frozenset(found | {category})


def is_believed(place: PlaceRecord, kinds: frozenset[str] | None, min_belief: float | None) -> bool:
    """Whether a place's most probable category is in `kinds` (None: any).

    With `min_belief`: whether any category in `kinds` has at least that probability.
    """
    if min_belief is not None:
        held = [b for kind, b in place.beliefs.items() if kinds is None or kind in kinds]
        return any(belief >= min_belief for belief in held)
    top = likeliest(place.beliefs)
    return top is not None and (kinds is None or top in kinds)
