"""Facts of the robot's last pose and of the recordings that were applied to the map."""

from __future__ import annotations

import re
from typing import Final
from urllib.parse import quote, unquote

import numpy as np
from pyoxigraph import Literal, NamedNode, Quad

from kg.model import vocabulary as v
from kg.model.errors import InvalidFactError
from kg.model.records import RecordingRecord, RobotRecord
from kg.rdf.literals import (
    AXES,
    axes_of,
    axis_literals,
    first,
    known_iri,
    number_literal,
    properties_of,
    stamp_of,
    subject_quads,
    text_of,
    time_literal,
)
from kg.rdf.quad_store import QuadStore

_SEARCH_NAME: Final = re.compile(r"search/\d+")


def robot_quads(record: RobotRecord, base: str) -> list[Quad]:
    """Facts of the robot; raises InvalidFactError where its pose is not finite."""
    return subject_quads(
        base + "robot",
        [
            (v.RDF_TYPE.value, known_iri(v.ROBOT)),
            *axis_literals(AXES, record.p_map, "robot: position"),
            (v.HEADING, number_literal(record.heading, "robot: heading")),
            (v.LAST_SEEN, time_literal(record.stamp, "robot: stamp")),
        ],
    )


def robot_in(store: QuadStore, base: str) -> RobotRecord | None:
    """Last pose of the robot, if there is one."""
    properties = properties_of(store, base + "robot", v.MAP_GRAPH)
    if v.X not in properties:
        return None
    heading = float(first(properties, v.HEADING, "0"))
    return RobotRecord(axes_of(properties, AXES), heading, stamp_of(properties, v.LAST_SEEN))


def recording_iri(name: str, base: str) -> str:
    """IRI of the recording `name` in the map `base`; the name "search/1" is a search."""
    if _SEARCH_NAME.fullmatch(name):
        return base + name
    return f"{base}recording/{quote(name, safe='')}"


def recording_name(iri: str, base: str) -> str:
    """Name of the recording, or search, `iri`."""
    return unquote(iri.removeprefix(base).removeprefix("recording/"))


def recording_quads(record: RecordingRecord, base: str) -> list[Quad]:
    """Facts of a recording, its transform at full precision; raises InvalidFactError."""
    transform = np.asarray(record.T_map_world, dtype=np.float64)
    if transform.shape != (4, 4) or not np.isfinite(transform).all():
        raise InvalidFactError(f"recording {record.name}: transform must be (4, 4) and finite")
    if record.frames_applied < 0:
        raise InvalidFactError(
            f"recording {record.name}: frames applied must be 0 or more, "
            f"got {record.frames_applied}"
        )
    facts: list[tuple[str, NamedNode | Literal]] = [
        (v.RDF_TYPE.value, known_iri(v.RECORDING)),
        (v.RDFS_LABEL, Literal(record.name)),
        (v.FRAMES_APPLIED, Literal(record.frames_applied)),
        (v.LAST_FRAME, Literal(record.last_frame)),
        (v.TRANSFORM, Literal(" ".join(repr(float(n)) for n in transform.flat))),
    ]
    if record.scene_model:
        facts.append((v.SCENE_MODEL, Literal(record.scene_model)))
    if record.pose_estimate:
        facts.append((v.POSE_ESTIMATE, Literal(record.pose_estimate)))
    facts += ((v.DETECTS, known_iri(category)) for category in record.detects)
    return subject_quads(recording_iri(record.name, base), facts, v.DATASET_GRAPH)


def recordings_in(store: QuadStore, base: str) -> tuple[RecordingRecord, ...]:
    """All recordings applied to the map, by name."""
    quads = store.quads_for_pattern(None, v.RDF_TYPE, NamedNode(v.RECORDING), v.DATASET_GRAPH)
    found = (_recording(store, text_of(quad.subject), base) for quad in quads)
    return tuple(sorted(found, key=lambda record: record.name))


def _recording(store: QuadStore, iri: str, base: str) -> RecordingRecord:
    properties = properties_of(store, iri, v.DATASET_GRAPH)
    numbers = [float(n) for n in first(properties, v.TRANSFORM, "").split()]
    return RecordingRecord(
        name=first(properties, v.RDFS_LABEL, recording_name(iri, base)),
        frames_applied=int(first(properties, v.FRAMES_APPLIED, "0")),
        last_frame=first(properties, v.LAST_FRAME, ""),
        T_map_world=np.array(numbers).reshape(4, 4) if len(numbers) == 16 else np.eye(4),
        scene_model=first(properties, v.SCENE_MODEL, ""),
        pose_estimate=first(properties, v.POSE_ESTIMATE, ""),
        detects=tuple(sorted(properties.get(v.DETECTS, ()))),
    )
