"""Spatial extent of a map, and the check of coordinates that people and clients give against it.

People write millimetres where metres are meant, and points of another frame. A position farther
from everything the map knows than any robot or room of it can be is refused. One that is only odd
is taken, with a line that says so. A map that knows nothing yet has no extent to check against.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Final

from pyoxigraph import Literal, NamedNode, Quad

from kg.model import vocabulary as v
from kg.model.errors import HereaboutsError, InvalidFactError
from kg.rdf.literals import SIDES
from kg.rdf.quad_store import QuadStore

MAX_DISTANCE: Final = 100.0  # [m] from a map, or ...
MAX_SHARE: Final = 2.0  # ... times its diagonal, beyond which no position belongs to it
ODD_DISTANCE: Final = 10.0  # [m] from a map, beyond which a position is odd
MAX_SIDE: Final = 1000.0  # [m] of one place; larger ones are in millimetres
LARGE_SIDE: Final = 20.0  # [m] of one object, which may be in any map
ODD_SIDE: Final = 6.0  # [m] of one object, beyond which it is odd
_AT_ONCE: Final = 32  # coordinates of a predicate that are read at once
_AXES: Final = ((v.X, v.X_MIN, v.X_MAX), (v.Y, v.Y_MIN, v.Y_MAX), (v.Z,))
#: predicate -> which point of its subject it is of, and the axis
_PLACES_OF: Final = {
    v.X: ("position", 0),
    v.Y: ("position", 1),
    v.Z: ("position", 2),
    v.X_MIN: ("low", 0),
    v.Y_MIN: ("low", 1),
    v.X_MAX: ("high", 0),
    v.Y_MAX: ("high", 1),
}


@dataclass(frozen=True, slots=True)
class MapExtent:
    """The axis-aligned box of all that a map knows the position of [m]."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]

    @property
    def limit(self) -> float:
        """Greatest distance [m] of a position that may belong to the map."""
        return max(MAX_DISTANCE, MAX_SHARE * math.dist(self.low, self.high))

    def distance(self, point: Sequence[float]) -> float:
        """Distance [m] of a point, (2,) or (3,), from the box; 0 inside."""
        ends = zip(point, self.low, self.high, strict=False)
        # 0 first, since nan compares false: an axis that is not known does not count
        return math.hypot(*(max(0.0, low - x, x - high) for x, low, high in ends))

    def __str__(self) -> str:
        sides = zip("xy", self.low, self.high, strict=False)
        return ", ".join(f"{axis} {low:.1f} to {high:.1f}" for axis, low, high in sides) + " m"


def map_extent(engine: QuadStore) -> MapExtent | None:
    """The extent of objects, places, doors, floor and robot; None where the map has none of them.

    Asserted positions do not count, since a wrong one would vouch for the next.
    """
    extents = deque(_growing_extents(engine), maxlen=1)
    return extents[0] if extents else None


def _growing_extents(engine: QuadStore) -> Iterator[MapExtent]:
    """Extents of more and more of the map, the last one of all of it."""
    position = Literal("position")
    asserted = {
        of.object
        for quad in engine.quads_for_pattern(
            None, NamedNode(v.ASSERTED_PROPERTY), position, v.ASSERTIONS_GRAPH
        )
        for of in engine.quads_for_pattern(
            quad.subject, NamedNode(v.ASSERTED_OF), None, v.ASSERTIONS_GRAPH
        )
    }
    low, high = [math.inf] * 3, [-math.inf] * 3
    found = [
        (axis, engine.quads_for_pattern(None, NamedNode(predicate), None, v.MAP_GRAPH))
        for axis, predicates in enumerate(_AXES)
        for predicate in predicates
    ]
    more = True
    while more:
        more = False
        for axis, quads in found:
            for quad in islice(quads, _AT_ONCE):
                more = True
                if quad.subject not in asserted and isinstance(quad.object, Literal):
                    value = _number(quad.object.value)
                    low[axis], high[axis] = min(low[axis], value), max(high[axis], value)
        if low[0] <= high[0] and low[1] <= high[1]:
            z = (low[2], high[2]) if low[2] <= high[2] else (0.0, 0.0)
            yield MapExtent((low[0], low[1], z[0]), (high[0], high[1], z[1]))


def check_positions(
    engine: QuadStore,
    points: Iterable[Sequence[float]],
    what: str,
    error: type[HereaboutsError] = InvalidFactError,
) -> str:
    """A line about the oddest of `points`, (2,) or (3,) [m], or "" where none is odd.

    Raises `error` for a point so far from the map that it cannot belong to it; `what` names the
    points, as in "position of cup 2".
    """
    points = list(points)
    extent, distance = None, 0.0
    farthest: Sequence[float] = ()
    for extent in _growing_extents(engine) if points else ():
        farthest = max(points, key=extent.distance)
        distance = extent.distance(farthest)
        if distance <= ODD_DISTANCE:
            return ""  # the rest of a large map brings it no farther away
    if extent is None:
        return ""
    farthest = [number for number in farthest if not math.isnan(number)]
    shown = f"({', '.join(f'{number:g}' for number in farthest)})"
    far = f"{distance:,.0f}" if distance < 1e9 else f"{distance:g}"
    problem = f"the {what} {shown} is {far} m from all that the map knows ({extent})"
    if distance > extent.limit:
        metres = ", ".join(f"{number / 1000:g}" for number in farthest)
        raise error(
            f"{problem}: are these millimetres? metres in the map frame would work, as in "
            f"({metres})"
        )
    return problem


def check_sides(engine: QuadStore, boxes: Iterable[tuple[str, Iterable[float]]]) -> str:
    """A line about the longest side [m] of `boxes` (names and sides), or "" where it is usual.

    Raises InvalidFactError for an object larger than all that the map knows.
    """
    longest, name = max(((max(sides), name) for name, sides in boxes), default=(0.0, ""))
    extent = map_extent(engine) if longest > ODD_SIDE else None
    if extent is None:
        return ""
    problem = f"{name} has a side of {longest:,g} m"
    if longest > max(LARGE_SIDE, math.dist(extent.low, extent.high)):
        raise InvalidFactError(
            f"{problem}, more than all that the map knows ({extent}): are these millimetres? "
            f"metres would work, as in {longest / 1000:g}"
        )
    return f"{problem}; sides are in metres"


def check_written(engine: QuadStore, quads: Iterable[Quad]) -> tuple[str, str]:
    """Lines about the oddest position and side that quads of graph:map give, "" for none.

    Raises InvalidFactError as `check_positions` and `check_sides`. A place has two positions: the
    lower and the upper corner of its rectangle.
    """
    points: dict[tuple[object, str], list[float]] = {}
    boxes: list[tuple[str, list[float]]] = []
    for quad in quads:
        if quad.graph_name != v.MAP_GRAPH or not isinstance(quad.object, Literal):
            continue
        value = _number(quad.object.value)
        if where := _PLACES_OF.get(quad.predicate.value):
            kind, axis = where
            points.setdefault((quad.subject, kind), [math.nan] * 3)[axis] = value
        elif quad.predicate.value in SIDES and isinstance(quad.subject, NamedNode):
            boxes.append((quad.subject.value, [0.0 if math.isnan(value) else value]))
    return check_positions(engine, points.values(), "position"), check_sides(engine, boxes)


def _number(text: str) -> float:
    """A coordinate; nan, which no comparison takes, where the text is none."""
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan
