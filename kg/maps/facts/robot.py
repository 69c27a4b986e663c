"""Facts of the robot: its last pose, the recordings that were applied, and its searches."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Final, cast, get_args
from urllib.parse import quote, unquote

import numpy as np
from pyoxigraph import Literal, NamedNode, Quad

from kg.model import vocabulary as v
from kg.model.errors import InvalidFactError
from kg.model.records import (
    LookRecord,
    ObstacleRecord,
    RecordingRecord,
    RobotRecord,
    SearchRecord,
    SearchState,
)
from kg.rdf.literals import (
    AXES,
    Properties,
    axes_of,
    axis_literals,
    first,
    iri_node,
    iri_order,
    known_iri,
    number_literal,
    properties_of,
    seconds,
    stamp_of,
    subject_quads,
    text_of,
    time_literal,
)
from kg.rdf.quad_store import QuadStore
from kg.store.transactional import TransactionalStore

_PART = NamedNode(v.PART_OF_SEARCH)
_STATES: Final[tuple[str, ...]] = get_args(SearchState)

_Fact = tuple[str, NamedNode | Literal]


class SearchRecords:
    """The searches that robots made on the map in `store`, with their looks and obstacles."""

    def __init__(self, store: TransactionalStore) -> None:
        self._store = store

    def all(self) -> tuple[SearchRecord, ...]:
        """All searches, oldest first."""
        engine = self._store.engine
        quads = engine.quads_for_pattern(None, v.RDF_TYPE, NamedNode(v.SEARCH), v.MAP_GRAPH)
        iris = sorted((text_of(quad.subject) for quad in quads), key=iri_order)
        return tuple(_search(iri, properties_of(engine, iri, v.MAP_GRAPH)) for iri in iris)

    def looks(self, search: str) -> tuple[LookRecord, ...]:
        """The looks of the search with IRI `search`, in their order."""
        return tuple(
            _look(part, found) for part, found in _parts(self._store.engine, search, v.LOOK)
        )

    def obstacles(self, search: str) -> tuple[ObstacleRecord, ...]:
        """The obstacles that the search with IRI `search` met, in order."""
        parts = _parts(self._store.engine, search, v.OBSTACLE)
        return tuple(
            ObstacleRecord(*part, reason=first(found, v.REASON, "")) for part, found in parts
        )


def facts_of_search(record: SearchRecord) -> list[Quad]:
    """Facts of a search; raises InvalidFactError for what is not finite or out of range."""
    return subject_quads(record.iri, _of_search(record))


def facts_of_look(record: LookRecord) -> list[Quad]:
    """Facts of a look; raises as `facts_of_search`."""
    return subject_quads(record.iri, _of_look(record))


def facts_of_obstacle(record: ObstacleRecord) -> list[Quad]:
    """Facts of an obstacle; raises as `facts_of_search`."""
    return subject_quads(record.iri, _of_obstacle(record))


def _of_search(record: SearchRecord) -> Iterator[_Fact]:
    what = f"search {record.iri}"
    if record.state not in _STATES:
        raise InvalidFactError(
            f"{what}: state must be one of {', '.join(_STATES)}, got {record.state}"
        )
    if not record.words or not record.categories:
        raise InvalidFactError(f"{what}: needs the words and categories that are searched for")
    if not 0 <= record.left <= 1:
        raise InvalidFactError(f"{what}: probability left must lie in 0..1, got {record.left}")
    yield v.RDF_TYPE.value, NamedNode(v.SEARCH)
    yield v.RDFS_LABEL, Literal(f"search for {' and '.join(record.words)}")
    yield v.SEARCH_STATE, Literal(record.state)
    yield (
        v.SEARCH_SECONDS,
        number_literal(record.seconds, f"{what}: seconds", digits=1, minimum=0.0, maximum=math.inf),
    )
    yield v.PROBABILITY_LEFT, number_literal(record.left, f"{what}: probability left", digits=4)
    yield v.PROV_STARTED_AT, time_literal(record.started, what)
    if record.ended is not None:
        yield v.PROV_ENDED_AT, time_literal(record.ended, what)
    yield from ((v.SEARCH_WORDS, Literal(words)) for words in record.words)
    yield from ((v.SEARCHED_FOR, iri_node(iri, what)) for iri in record.categories)
    yield from ((v.FOUND, iri_node(iri, what)) for iri in record.found)


def _of_look(record: LookRecord) -> Iterator[_Fact]:
    what = f"look {record.iri}"
    yield v.RDF_TYPE.value, NamedNode(v.LOOK)
    yield from _part(record, what)
    yield v.HEADING, number_literal(record.heading, f"{what}: heading", digits=4)
    yield v.EXTENT, number_literal(record.extent, f"{what}: extent", digits=4)
    yield from ((v.SEARCHED_FOR, iri_node(iri, what)) for iri in record.categories)
    yield from ((v.FOUND, iri_node(iri, what)) for iri in record.found)
    if record.glimpses:
        numbers = [n for glimpse in record.glimpses for n in glimpse]
        if not all(map(math.isfinite, numbers)):
            raise InvalidFactError(f"{what}: glimpses must be finite numbers")
        yield v.GLIMPSES, Literal(" ".join(f"{n:.2f}" for n in numbers))


def _of_obstacle(record: ObstacleRecord) -> Iterator[_Fact]:
    what = f"obstacle {record.iri}"
    yield v.RDF_TYPE.value, NamedNode(v.OBSTACLE)
    yield from _part(record, what)
    yield v.REASON, Literal(record.reason)


def _part(record: LookRecord | ObstacleRecord, what: str) -> Iterator[_Fact]:
    yield v.PART_OF_SEARCH, iri_node(record.search, what)
    yield v.NUMBER, Literal(record.number)
    yield v.SOSA_RESULT_TIME, time_literal(record.stamp, what)
    for axis, value in zip((v.X, v.Y), record.position, strict=True):
        yield axis, number_literal(value, f"{what}: position", digits=2)


def _search(iri: str, properties: Properties) -> SearchRecord:
    ended = properties.get(v.PROV_ENDED_AT)
    state = first(properties, v.SEARCH_STATE, "running")
    return SearchRecord(
        iri=iri,
        words=tuple(sorted(properties.get(v.SEARCH_WORDS, ()))),
        categories=tuple(sorted(properties.get(v.SEARCHED_FOR, ()))),
        state=cast(SearchState, state if state in _STATES else "running"),
        started=stamp_of(properties, v.PROV_STARTED_AT),
        ended=seconds(min(ended)) if ended else None,
        seconds=float(first(properties, v.SEARCH_SECONDS, "0")),
        left=float(first(properties, v.PROBABILITY_LEFT, "1")),
        found=tuple(sorted(properties.get(v.FOUND, ()))),
    )


#: IRI, IRI of the search, number, time [s] and position (x, y) [m]
_Part = tuple[str, str, int, float, tuple[float, float]]


def _parts(engine: QuadStore, search: str, kind: str) -> list[tuple[_Part, Properties]]:
    """Looks and obstacles of a search share these facts; their properties, by number."""
    found = []
    for quad in engine.quads_for_pattern(None, _PART, NamedNode(search), v.MAP_GRAPH):
        iri = text_of(quad.subject)
        properties = properties_of(engine, iri, v.MAP_GRAPH)
        if kind in properties.get(v.RDF_TYPE.value, ()):
            number = int(first(properties, v.NUMBER, "0"))
            position = float(first(properties, v.X, "0")), float(first(properties, v.Y, "0"))
            stamp = stamp_of(properties, v.SOSA_RESULT_TIME)
            found.append(((iri, search, number, stamp, position), properties))
    return sorted(found, key=lambda one: one[0][2])


def _look(part: _Part, properties: Properties) -> LookRecord:
    numbers = [float(n) for n in first(properties, v.GLIMPSES, "").split()]
    return LookRecord(
        *part,
        heading=float(first(properties, v.HEADING, "0")),
        extent=float(first(properties, v.EXTENT, "0")),
        categories=tuple(sorted(properties.get(v.SEARCHED_FOR, ()))),
        found=tuple(sorted(properties.get(v.FOUND, ()))),
        glimpses=tuple(zip(numbers[::3], numbers[1::3], numbers[2::3], strict=True)),
    )


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
