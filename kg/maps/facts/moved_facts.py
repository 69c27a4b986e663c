"""Facts of a map with their coordinates in another frame, turned about the vertical and shifted.

Positions, headings, areas, extents and cells of the index move. Tiles of the floor are left out: a
turned grid fits no other one, and without tiles a planner assumes the areas of the places.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pyoxigraph import Literal, NamedNode, Quad

from kg.model import vocabulary as v
from kg.model.oriented_boxes import along_nearest_axes
from kg.rdf.grid_cells import cell_of
from kg.rdf.wkt import area_of_polygon, polygon_text

_BOUNDS: Final = (v.X_MIN, v.X_MAX, v.Y_MIN, v.Y_MAX)
#: predicates whose values depend on the frame
_FRAMED: Final = {
    *(v.X, v.Y, v.Z, v.HEADING, v.IN_CELL, v.OUTLINE, v.EXTENT_X, v.EXTENT_Y, v.YAW, v.GLIMPSES),
    *_BOUNDS,
}
_Values = dict[str, Literal | NamedNode]


def moved(quads: Iterable[Quad], T: NDArray[np.float64], crs: str) -> Iterator[Quad]:
    """The quads with `T` (4, 4) applied; `crs` is the IRI of the new frame."""
    framed: dict[tuple[object, object], _Values] = defaultdict(dict)
    tiles = set()
    rest = []
    for quad in quads:
        if quad.predicate == v.RDF_TYPE and quad.object == NamedNode(v.FLOOR_TILE):
            tiles.add(quad.subject)
        if quad.predicate.value in _FRAMED and isinstance(quad.object, Literal | NamedNode):
            framed[quad.subject, quad.graph_name][quad.predicate.value] = quad.object
        else:
            rest.append(quad)
    yield from (quad for quad in rest if quad.subject not in tiles)
    for (subject, graph), values in framed.items():
        if subject not in tiles:
            for predicate, value in _moved_values(values, T, crs).items():
                yield Quad(subject, NamedNode(predicate), value, graph)  # type: ignore[arg-type]


def _moved_values(values: _Values, T: NDArray[np.float64], crs: str) -> _Values:
    turn = math.atan2(T[1, 0], T[0, 0])
    new = dict(values)
    if all(name in values for name in _BOUNDS):
        return {**new, **_moved_area(values, T, crs)}
    if v.X in values and v.Y in values:
        x, y, z = (_number(values.get(name)) for name in (v.X, v.Y, v.Z))
        at = T[:3, :3] @ (x, y, z) + T[:3, 3]
        new |= {v.X: Literal(float(at[0])), v.Y: Literal(float(at[1]))}
        if v.Z in values:
            new[v.Z] = Literal(float(at[2]))
        if v.IN_CELL in values:
            new[v.IN_CELL] = NamedNode(cell_of(float(at[0]), float(at[1])))
    if v.HEADING in values:
        new[v.HEADING] = Literal(_angle(_number(values[v.HEADING]) + turn))
    if v.EXTENT_X in values and v.EXTENT_Y in values:
        new |= _moved_extent(values, turn)
    if v.GLIMPSES in values:
        new[v.GLIMPSES] = _moved_glimpses(values[v.GLIMPSES].value, T, turn)
    return new


def _moved_area(values: _Values, T: NDArray[np.float64], crs: str) -> _Values:
    """Bounds, centre and outline of a place; a turned rectangle gets an outline."""
    xmin, xmax, ymin, ymax = (_number(values[name]) for name in _BOUNDS)
    rings = [[(xmin, ymin), (xmax, ymin), (xmax, ymax), (xmin, ymax)]]
    stated = v.OUTLINE in values
    if stated:
        try:
            area = area_of_polygon(values[v.OUTLINE].value)
            rings = [list(ring) for ring in area.outline or rings]
        except ValueError:
            stated = False
    turned = [[_at(T, x, y) for x, y in ring] for ring in rings]
    (left, below), (right, above) = np.min(turned[0], axis=0), np.max(turned[0], axis=0)
    numbers = zip(_BOUNDS, (left, right, below, above), strict=True)
    new: _Values = {name: Literal(float(number)) for name, number in numbers}
    if v.X in values and v.Y in values:
        x, y = _at(T, _number(values[v.X]), _number(values[v.Y]))
        new |= {v.X: Literal(x), v.Y: Literal(y)}
    if stated or not np.isclose(np.abs(T[:2, :2]).max(), 1.0, atol=1e-6):
        outline = tuple(tuple(ring) for ring in turned)
        new[v.OUTLINE] = Literal(polygon_text(outline, crs), datatype=v.GEO_WKT_LITERAL)
    return new


def _moved_extent(values: _Values, turn: float) -> _Values:
    """Sides and yaw of the box in the new frame."""
    sides = _number(values[v.EXTENT_X]), _number(values[v.EXTENT_Y])
    x, y, yaw = along_nearest_axes(*sides, _number(values.get(v.YAW)) + turn)
    return {v.EXTENT_X: Literal(x), v.EXTENT_Y: Literal(y), v.YAW: Literal(yaw)}


def _moved_glimpses(text: str, T: NDArray[np.float64], turn: float) -> Literal:
    numbers = [float(n) for n in text.split()]
    poses = zip(numbers[::3], numbers[1::3], numbers[2::3], strict=False)
    moved_poses = ((*_at(T, x, y), _angle(heading + turn)) for x, y, heading in poses)
    return Literal(" ".join(f"{n:.6g}" for pose in moved_poses for n in pose))


def _at(T: NDArray[np.float64], x: float, y: float) -> tuple[float, float]:
    """(x, y) [m] in the new frame of a point on the floor."""
    at = T[:2, :2] @ (x, y) + T[:2, 3]
    return float(at[0]), float(at[1])


def _number(term: Literal | NamedNode | None) -> float:
    return 0.0 if term is None else float(term.value)


def _angle(radians: float) -> float:
    """The angle [rad] between -pi and pi."""
    return math.atan2(math.sin(radians), math.cos(radians))
