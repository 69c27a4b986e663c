"""Frames and notes whose numbers alone say what the map must hold after them.

Frame k rewrites every object, leaves one out and brings another back; note k rewrites what people
said of five things. So the graph after frame k and note j is known without having followed them.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from pyoxigraph import Quad, RdfFormat, parse

from kg.export.serialization import export_text
from kg.history.storage.log import BACKGROUND
from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.records import (
    Evidence,
    MapUpdate,
    ObjectRecord,
    PlaceRecord,
    RecordingRecord,
    RobotRecord,
)
from kg.serving.opening import in_memory_map

BASE = "https://example.org/killed/"
OBJECTS = 12
NOTES = 5
_KINDS = tuple(v.HERE + name for name in ("Chair", "Cup", "Book"))
_VOLATILE = (v.SEQUENCE, v.DCT_CREATED, v.DCT_TITLE)


def frame_update(number: int) -> MapUpdate:
    """Frame `number`, counted from 0."""
    absent = number % OBJECTS
    objects = tuple(_object(k, number) for k in range(OBJECTS) if k != absent)
    beliefs = {v.HERE + "Kitchen": 0.75, v.HERE + "Office": 0.25}
    place = PlaceRecord(f"{BASE}place/1", "place 1", 0.0, 20.0, 0.0, 9.0, number + 1, beliefs)
    return MapUpdate(
        objects=objects,
        removed=(_iri(absent),),
        places=(place,),
        robot=RobotRecord(np.array([number % 97, 0.0, 1.2]), 0.5, 1e9 + number),
        recording=RecordingRecord("run", number + 1, f"frame-{number:06d}", np.eye(4), "rooms6"),
    )


def note_update(number: int) -> str:
    """Note `number`, counted from 1, as a SPARQL update."""
    things = " ".join(f"<{BASE}note/{k}>" for k in range(1, NOTES + 1))
    comment = f"<{v.RDFS_COMMENT}>"
    return (
        f"DELETE {{ ?thing {comment} ?old }} INSERT {{ ?thing {comment} {number} }} "
        f"WHERE {{ VALUES ?thing {{ {things} }} OPTIONAL {{ ?thing {comment} ?old }} }}"
    )


def expected(frames: int, notes: int) -> set[Quad]:
    """Expected contents of graph:map and graph:dataset after so many writes of each kind."""
    with _twin(frames, notes) as twin:
        return facts(twin)


def expected_export(frames: int) -> set[Quad]:
    """Expected contents of an export after so many frames."""
    with _twin(frames, 0) as twin:
        return set(parse(export_text(twin, "trig"), format=RdfFormat.TRIG))


@contextmanager
def _twin(frames: int, notes: int) -> Iterator[SemanticMap]:
    with in_memory_map(base=BASE) as twin:
        for number in range(max(0, frames - 2), frames):  # the one before holds what is removed
            twin.apply(frame_update(number))
        if notes:
            twin.update(note_update(notes))
        yield twin


def facts(semantic_map: SemanticMap) -> set[Quad]:
    """Quads of the map, without its ontology, its counter and its time of creation."""
    return {
        quad
        for quad in semantic_map.engine
        if quad.graph_name not in (*BACKGROUND, v.INFERRED_GRAPH)
        and quad.predicate.value not in _VOLATILE
    }


def _iri(number: int) -> str:
    return f"{BASE}object/{number + 1}"


def _object(number: int, frame: int) -> ObjectRecord:
    return ObjectRecord(
        iri=_iri(number),
        category=_KINDS[number % len(_KINDS)],
        p_map=np.array([number + frame % 89 / 100, frame % 7, 0.5]),
        confidence=1.0 + frame % 150 / 100,
        existence=0.5,
        observations=frame + 1,
        first_seen=1e9,
        last_seen=1e9 + frame,
        place=f"{BASE}place/1",
        evidence=Evidence(
            f"frame-{frame:06d}", "run", 1e9 + frame, (1.0, 2.0, 3.0 + frame % 50, 4.0), 0.5, "net"
        ),
    )
