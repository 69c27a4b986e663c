"""Views of a store with several maps: those with a known way between their frames, in one frame.

Coordinates of maps without a common frame must not be compared, so a view leaves such maps out.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray
from pyoxigraph import NamedNode, Quad

from kg.maps.facts.coordinate_frames import MapFrame, frame_iri, frames_in, maps_in, ways_to
from kg.maps.facts.moved_facts import moved
from kg.model import vocabulary as v
from kg.model.errors import GraphError, QueryParameterError, did_you_mean
from kg.rdf.quad_store import QuadStore

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
    frames = frames_in(engine) if len(maps_in(engine)) > 1 else ()
    if frames:
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
    for one, facts in of_map.items():
        if one in ways:
            quads.extend(in_frame(facts, ways[one], one, base))
        elif rest:
            quads.extend(facts)
    return quads


def in_frame(quads: Iterable[Quad], T: NDArray[np.float64], own: str, base: str) -> Iterator[Quad]:
    """Facts of the map `own` by `T` (4, 4) in the frame of `base`, and stated to be in it."""
    if np.array_equal(T, np.eye(4)):
        yield from quads
        return
    states = NamedNode(v.COORDINATE_FRAME)
    kept = (quad for quad in quads if quad.predicate != states)
    yield from moved(kept, T, frame_iri(base))
    yield Quad(NamedNode(own), states, NamedNode(frame_iri(base)), v.DATASET_GRAPH)


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
