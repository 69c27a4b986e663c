"""Which objects are meant: of a category, in a place, near a point or near another object.

The narrowest index is asked first (cells, place, category), then each candidate is held to all of
it; so a selection costs what it finds, not what the map holds.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from pyoxigraph import NamedNode

from kg import vocabulary as v
from kg.cells import cells_of_disc
from kg.engine import Engine
from kg.errors import QueryParameterError
from kg.facts import Facts
from kg.records import ObjectRecord, PlaceRecord

_MAP = NamedNode(v.MAP_GRAPH)
_COMMONSENSE = NamedNode(v.COMMONSENSE_GRAPH)


@dataclass(frozen=True, slots=True)
class Disc:
    """A disc over the floor, map frame."""

    x: float  # [m]
    y: float  # [m]
    radius: float  # [m]

    def distance(self, record: ObjectRecord) -> float:
        """How far an object is from the middle, over the floor [m]."""
        return math.hypot(record.p_map[0] - self.x, record.p_map[1] - self.y)


@dataclass(frozen=True, slots=True)
class Selection:
    """What objects must be to be meant; None leaves a matter open."""

    categories: frozenset[str] | None = None
    place: str | None = None
    disc: Disc | None = None
    other_than: str | None = None

    @property
    def everything(self) -> bool:
        """Whether all objects are meant."""
        return self.categories is None and self.place is None and self.disc is None

    def candidates(self, engine: Engine) -> set[str]:
        """IRIs among which all that is meant is found; needs a selection that narrows."""
        found = set()
        for predicate, value in self._lookups():
            for quad in engine.quads_for_pattern(
                None, NamedNode(predicate), NamedNode(value), _MAP
            ):
                if isinstance(quad.subject, NamedNode):
                    found.add(quad.subject.value)
        return found - {self.other_than or ""}

    def admits(self, record: ObjectRecord) -> bool:
        """Whether an object is meant."""
        return (
            (self.categories is None or record.category in self.categories)
            and (self.place is None or record.place == self.place)
            and (self.disc is None or self.disc.distance(record) <= self.disc.radius)
        )

    def _lookups(self) -> Iterator[tuple[str, str]]:
        cells = cells_of_disc(self.disc.x, self.disc.y, self.disc.radius) if self.disc else None
        if cells is not None:
            yield from ((v.IN_CELL, cell) for cell in cells)
        elif self.place is not None:
            yield v.IN_PLACE, self.place
        else:
            classes = self.categories if self.categories is not None else {v.OBJECT}
            yield from ((v.RDF_TYPE, category) for category in classes)


def select_objects(
    engine: Engine,
    facts: Facts,
    category: str | None,
    place: str | None,
    near: tuple[float, float] | str | None,
    radius: float,
) -> tuple[ObjectRecord, ...]:
    """The objects meant, the nearest first where `near` says of what, else oldest first.

    `category` and `place` are IRIs. Raises QueryParameterError for a `near` that makes no sense.
    """
    chosen = Selection(
        categories=None if category is None else subcategories(engine, category),
        place=place,
        disc=None if near is None else _disc(engine, facts, near, radius),
        other_than=near if isinstance(near, str) else None,
    )
    if chosen.everything:
        return facts.objects(engine)
    found = filter(chosen.admits, facts.some_objects(engine, chosen.candidates(engine)))
    return tuple(sorted(found, key=chosen.disc.distance) if chosen.disc else found)


def _disc(engine: Engine, facts: Facts, near: tuple[float, float] | str, radius: float) -> Disc:
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


def subcategories(engine: Engine, category: str) -> frozenset[str]:
    """IRIs of a category and of all below it."""
    isa, above = NamedNode(v.IS_A), NamedNode(category)
    quads = engine.quads_for_pattern(None, isa, above, _COMMONSENSE)
    found = {q.subject.value for q in quads if isinstance(q.subject, NamedNode)}
    return frozenset(found | {category})


def is_believed(place: PlaceRecord, kinds: frozenset[str] | None, min_belief: float | None) -> bool:
    """Whether a place is most likely one of `kinds`, or one of them by at least `min_belief`."""
    if min_belief is not None:
        held = [b for kind, b in place.beliefs.items() if kinds is None or kind in kinds]
        return any(belief >= min_belief for belief in held)
    if not place.beliefs:
        return False
    top = max(place.beliefs, key=lambda category: (place.beliefs[category], category))
    return kinds is None or top in kinds
