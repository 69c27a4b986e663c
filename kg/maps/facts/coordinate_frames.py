"""Coordinate frames of maps: each map has its own, with a known transform to another one, or none.

The frame of a map is `<base>crs`, the reference system of its exported geometries, whether it is
stated (graph:dataset) or the map is older than that.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pyoxigraph import Literal, NamedNode, Quad

from kg.model import vocabulary as v
from kg.model.areas import along_nearest_axes
from kg.model.errors import GraphError, InvalidFactError, QueryParameterError, did_you_mean
from kg.rdf.literals import (
    area_of_polygon,
    by_subject,
    cell_of,
    first,
    iri_node,
    polygon_text,
    subject_quads,
)
from kg.rdf.quad_store import QuadStore

#: end of the IRI of a map's frame
FRAME = "crs"
_TOLERANCE = 1e-4
#: predicates that tell frames and transforms; recordings have a transform too
_FRAME_FACTS = (v.COORDINATE_FRAME, v.RELATIVE_TO, v.TRANSFORM, v.DCT_TITLE)


@dataclass(frozen=True, slots=True, eq=False)
class MapFrame:
    """A map and the frame of its coordinates."""

    map: str  # IRI
    title: str
    iri: str  # of the frame


def frame_iri(base: str) -> str:
    """IRI of the frame of the map `base`, which WKT literals name too."""
    return base + FRAME


def frame_quads(base: str) -> list[Quad]:
    """Facts of a map's frame that has no known transform to others."""
    own = frame_iri(base)
    facts: list[tuple[str, NamedNode | Literal]] = [
        (v.RDF_TYPE.value, NamedNode(v.FRAME_CLASS)),
        (v.RDFS_LABEL, Literal("map frame")),
    ]
    states = Quad(NamedNode(base), NamedNode(v.COORDINATE_FRAME), NamedNode(own), v.DATASET_GRAPH)
    return [states, *subject_quads(own, facts, v.DATASET_GRAPH)]


def checked_transform(T: ArrayLike) -> NDArray[np.float64]:
    """`T` (4, 4) [m] if it is rigid and keeps the vertical; raises InvalidFactError otherwise."""
    matrix = np.asarray(T, np.float64)
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise InvalidFactError(f"a transform is (4, 4) and finite, got {matrix.shape}")
    turn, last = matrix[:3, :3], matrix[3]
    rigid = np.allclose(turn @ turn.T, np.eye(3), atol=_TOLERANCE) and np.linalg.det(turn) > 0
    if not rigid or not np.allclose(last, (0, 0, 0, 1), atol=_TOLERANCE):
        raise InvalidFactError("a transform between frames is rigid: a rotation and a shift")
    if not np.isclose(turn[2, 2], 1, atol=_TOLERANCE):
        raise InvalidFactError("a transform between frames of maps keeps the vertical")
    return matrix


def maps_in(engine: QuadStore) -> tuple[str, ...]:
    """IRIs of the maps in a store, sorted; one, unless maps were published or merged there."""
    kind = NamedNode(v.SEMANTIC_MAP)
    quads = engine.quads_for_pattern(None, v.RDF_TYPE, kind, v.DATASET_GRAPH)
    return tuple(sorted(q.subject.value for q in quads if isinstance(q.subject, NamedNode)))


def frames_in(engine: QuadStore) -> tuple[MapFrame, ...]:
    """The maps of a store with their frames, by IRI."""
    stated = by_subject(_frame_facts(engine))
    return tuple(
        MapFrame(
            base,
            min(stated.get(base, {}).get(v.DCT_TITLE, ()), default="map"),
            first(stated.get(base, {}), v.COORDINATE_FRAME, frame_iri(base)),
        )
        for base in maps_in(engine)
    )


def frame_of(engine: QuadStore, base: str) -> str:
    """IRI of the frame of the map `base`."""
    return next((f.iri for f in frames_in(engine) if f.map == base), frame_iri(base))


def transform_of(engine: QuadStore, frame: str) -> tuple[str, NDArray[np.float64]] | None:
    """The frame that `frame` is relative to, and the transform (4, 4) to it; None where unknown."""
    return next(((parent, T) for child, parent, T in _transforms(engine) if child == frame), None)


def ways_to(engine: QuadStore, base: str) -> dict[str, NDArray[np.float64]]:
    """T_base_map (4, 4) for each map of a store with a known way to the frame of the map `base`.

    A transform is followed in both directions, and through frames of maps that are elsewhere.
    """
    frames = {frame.map: frame.iri for frame in frames_in(engine)}
    home = frames.get(base, frame_iri(base))
    known = {home: np.eye(4)}
    todo, edges = [home], list(_transforms(engine))
    while todo:
        at = todo.pop()
        for child, parent, T_parent_child in edges:
            if parent == at and child not in known:
                known[child] = known[at] @ T_parent_child
                todo.append(child)
            elif child == at and parent not in known:
                known[parent] = known[at] @ np.linalg.inv(T_parent_child)
                todo.append(parent)
    return {one: known[frame] for one, frame in frames.items() if frame in known}


def _frame_facts(engine: QuadStore) -> Iterator[Quad]:
    for predicate in _FRAME_FACTS:
        yield from engine.quads_for_pattern(None, NamedNode(predicate), None, v.DATASET_GRAPH)


def _transforms(engine: QuadStore) -> Iterator[tuple[str, str, NDArray[np.float64]]]:
    """Frame, the frame it is relative to, and the transform; faulty ones are left out."""
    stated = by_subject(_frame_facts(engine))
    for iri in sorted(stated):
        parents, texts = stated[iri].get(v.RELATIVE_TO, ()), stated[iri].get(v.TRANSFORM, ())
        if len(parents) == len(texts) == 1:
            try:
                numbers = [float(n) for n in texts[0].split()]
                yield iri, parents[0], checked_transform(np.array(numbers).reshape(4, 4))
            except (ValueError, InvalidFactError):
                continue


def changed_frame(
    engine: QuadStore, base: str, relative_to: str, T: ArrayLike
) -> tuple[list[Quad], list[Quad]]:
    """Quads to delete and to insert so that `T` (4, 4) takes the map `base` to `relative_to`.

    Raises InvalidFactError for a transform that is not rigid or tilts the vertical, and for the
    map's own frame.
    """
    if relative_to == frame_iri(base):
        raise InvalidFactError(
            "a frame cannot be relative to itself; give the frame of another map"
        )
    facts: list[tuple[str, NamedNode | Literal]] = [
        (v.RELATIVE_TO, iri_node(relative_to, "a frame")),
        (v.TRANSFORM, Literal(" ".join(repr(float(n)) for n in checked_transform(T).flat))),
    ]
    new = [*frame_quads(base), *subject_quads(frame_iri(base), facts, v.DATASET_GRAPH)]
    old = [
        quad
        for node in (NamedNode(base), NamedNode(frame_iri(base)))
        for predicate in (v.COORDINATE_FRAME, v.RELATIVE_TO, v.TRANSFORM, v.RDFS_LABEL)
        for quad in engine.quads_for_pattern(node, NamedNode(predicate), None, v.DATASET_GRAPH)
    ]
    return [quad for quad in old if quad not in new], [quad for quad in new if quad not in old]


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


#: graphs of facts that belong to one map
_OF_MAPS = (v.MAP_GRAPH, v.ASSERTIONS_GRAPH, v.DATASET_GRAPH)
_SHARED = (v.ONTOLOGY_GRAPH, v.COMMONSENSE_GRAPH)


def chosen_map(engine: QuadStore, name: str) -> str:
    """IRI of the map with that title or IRI; raises QueryParameterError, which lists them."""
    frames = frames_in(engine)
    found = [frame.map for frame in frames if name in (frame.title, frame.map)]
    if len(found) == 1:
        return found[0]
    names = [frame.title for frame in frames]
    fault = f"{len(found)} maps are called" if found else "no map is called"
    shown = ", ".join(f"{frame.title} ({frame.map})" for frame in frames)
    raise QueryParameterError(f"{fault} {name!r}; there are: {shown}{did_you_mean(name, names)}")


def apart_from(engine: QuadStore, base: str) -> tuple[MapFrame, ...]:
    """The maps of a store without a known way to the frame of the map `base`."""
    ways = ways_to(engine, base)
    return tuple(frame for frame in frames_in(engine) if frame.map not in ways)


def check_one_map(engine: QuadStore, where: str) -> None:
    """Raises GraphError where a store has several maps, which only a query or a plan can choose."""
    frames = frames_in(engine)
    if len(frames) > 1:
        titles = ", ".join(frame.title for frame in frames)
        raise GraphError(
            f"{where} holds {len(frames)} maps ({titles}), each with its own frame; this needs one "
            "map: give its own folder or its `hereabouts serve`"
        )


def is_one_frame(engine: QuadStore, base: str) -> bool:
    """Whether all coordinates of a store are in the frame of the map `base`."""
    ways = ways_to(engine, base)
    return len(ways) == len(frames_in(engine)) and all(
        np.array_equal(T, np.eye(4)) for T in ways.values()
    )


def quads_in_one_frame(engine: QuadStore, base: str, *, rest: bool = False) -> list[Quad]:
    """Quads of the maps with a known way to the frame of `base`, moved to it, and the ontology.

    With `rest` the facts of the other maps are there too, in their own frames.
    """
    ways = ways_to(engine, base)
    of_map = _by_map(engine, [frame.map for frame in frames_in(engine)], base)
    quads = [
        quad for graph in _SHARED for quad in engine.quads_for_pattern(None, None, None, graph)
    ]
    states, home = NamedNode(v.COORDINATE_FRAME), frame_iri(base)
    for one, facts in of_map.items():
        if one in ways and not np.array_equal(ways[one], np.eye(4)):
            kept = (quad for quad in facts if quad.predicate != states)
            quads.extend(moved(kept, ways[one], home))
            quads.append(Quad(NamedNode(one), states, NamedNode(home), v.DATASET_GRAPH))
        elif one in ways or rest:
            quads.extend(facts)
    return quads


def _by_map(engine: QuadStore, maps: list[str], base: str) -> dict[str, list[Quad]]:
    """Facts by map: those under its IRI, and those published as its parts; else of `base`."""
    parts = {
        quad.object: quad.subject.value
        for quad in engine.quads_for_pattern(
            None, NamedNode(v.DCT_HAS_PART), None, v.PUBLISHED_GRAPH
        )
        if isinstance(quad.subject, NamedNode)
    }
    found: dict[str, list[Quad]] = {one: [] for one in maps}
    known: dict[object, str] = {}
    for graph in _OF_MAPS:
        for quad in engine.quads_for_pattern(None, None, None, graph):
            subject = quad.subject
            if subject not in known:
                iri = getattr(subject, "value", "")
                own = (one for one in maps if iri.startswith(one))
                known[subject] = parts.get(subject) or next(own, base)
            found.setdefault(known[subject], []).append(quad)
    return found
