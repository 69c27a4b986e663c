"""Coordinate frames of maps: each map has its own, with a known transform to another one, or none.

The frame of a map is `<base>crs`, the reference system of its exported geometries, whether it is
stated (graph:dataset) or the map is older than that.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pyoxigraph import Literal, NamedNode, Quad

from kg.model import vocabulary as v
from kg.model.errors import InvalidFactError
from kg.rdf.literals import by_subject, first, iri_node, subject_quads
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


def placed_frame_quads(base: str, relative_to: str, T: ArrayLike) -> list[Quad]:
    """Facts of a map's frame whose coordinates `T` (4, 4) takes to the frame `relative_to`.

    Raises InvalidFactError for a transform that is not rigid or tilts the vertical, and for the
    map's own frame.
    """
    if relative_to == frame_iri(base):
        raise InvalidFactError(
            "a frame cannot be relative to itself; give the frame of another map"
        )
    matrix = checked_transform(T)
    facts: list[tuple[str, NamedNode | Literal]] = [
        (v.RELATIVE_TO, iri_node(relative_to, "a frame")),
        (v.TRANSFORM, Literal(" ".join(repr(float(n)) for n in matrix.flat))),
    ]
    return [*frame_quads(base), *subject_quads(frame_iri(base), facts, v.DATASET_GRAPH)]


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

    Raises InvalidFactError as `placed_frame_quads`.
    """
    new = placed_frame_quads(base, relative_to, T)
    old = [
        quad
        for node in (NamedNode(base), NamedNode(frame_iri(base)))
        for predicate in (v.COORDINATE_FRAME, v.RELATIVE_TO, v.TRANSFORM, v.RDFS_LABEL)
        for quad in engine.quads_for_pattern(node, NamedNode(predicate), None, v.DATASET_GRAPH)
    ]
    return [quad for quad in old if quad not in new], [quad for quad in new if quad not in old]
