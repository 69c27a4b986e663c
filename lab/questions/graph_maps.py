"""Maps of hereabouts to ask: the true one, written from the truth, and mapped ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from kg.maps.semantic_map import SemanticMap
from kg.model.records import (
    DepartedRecord,
    Evidence,
    MapUpdate,
    ObjectRecord,
    PlaceRecord,
    PlaceViews,
    RecordingRecord,
    Relation,
)
from kg.serving.opening import in_memory_map
from lab.questions.house_drives import SESSIONS
from lab.questions.question_file import read_json
from mapping.mapping_options import MappingOptions
from mapping.places.layout import load_layout
from mapping.recording_mapper import map_recording
from perception.inference.recorded_detections import open_detector
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions

THRESHOLD: Final = 0.2  # of detections, as `hereabouts map` has it
_BASE: Final = "https://example.org/house/"


@dataclass(frozen=True, slots=True)
class AskedMap:
    """A map to ask, and the moment after the first drive."""

    semantic_map: SemanticMap
    since: str


def mapped(house: Path, senses: str) -> AskedMap:
    """Both drives in a map in memory, by the recorded detections of one preset of the senses."""
    semantic_map, since = in_memory_map(base=_BASE), "#0"
    layout = load_layout(house / "places.json")
    for name in SESSIONS:
        since = f"#{semantic_map.sequence}"
        recording = open_recording(
            house / name, RecordingOptions(T_map_world=np.eye(4), check=False)
        )
        detector = open_detector(house / name / f"detections-{senses}.json", threshold=THRESHOLD)
        map_recording(
            recording,
            semantic_map,
            detector,
            options=MappingOptions(layout=layout, same_frame=True),
        )
    return AskedMap(semantic_map, since)


def true(
    before: Mapping[str, Any], now: Mapping[str, Any], floor_of: SemanticMap | None = None
) -> AskedMap:
    """The truth of both moments in a map in memory, on the floor that another map has seen."""
    semantic_map = in_memory_map(base=_BASE)
    for name in SESSIONS:
        drive = RecordingRecord(name, 1, "", np.eye(4))
        semantic_map.apply(MapUpdate(recording=drive))
    semantic_map.apply(_update(semantic_map, before))
    since = f"#{semantic_map.sequence}"
    semantic_map.apply(_update(semantic_map, now))
    if floor_of is not None:
        robot, doors = floor_of.robot(), floor_of.doors()
        semantic_map.apply(MapUpdate(floor=floor_of.floor(), robot=robot, doors=doors))
    return AskedMap(semantic_map, since)


def truths(house: Path) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
    """The plain maps of what was true after the first drive and after the last."""
    return read_json(house / "truth-before.json"), read_json(house / "truth.json")


def _update(semantic_map: SemanticMap, document: Mapping[str, Any]) -> MapUpdate:
    departed = tuple(_departed(semantic_map, one) for one in document.get("departed", ()))
    return MapUpdate(
        objects=tuple(
            _object(semantic_map, one, room)
            for room in document["rooms"]
            for one in room["objects"]
        ),
        places=tuple(_place(semantic_map, room) for room in document["rooms"]),
        departed=departed,
        removed=tuple(one.iri for one in departed),
    )


def _object(semantic_map: SemanticMap, one: Mapping[str, Any], room: Mapping[str, Any]) -> Any:
    base, seen = semantic_map.base, one["seen_in"]
    return ObjectRecord(
        iri=base + one["name"],
        category=semantic_map.catalogue.find(one["category"], "object").iri,
        p_map=np.array(one["position"]),
        confidence=3.0,
        existence=1.0,
        observations=3,
        first_seen=one["last_seen"],
        last_seen=one["last_seen"],
        place=base + room["name"],
        evidence=Evidence(
            *(seen["frame"], seen["recording"], one["last_seen"]),
            *(tuple(seen["box"]), 0.9, "truth"),
        ),
        extent=np.array(one["size"]),
        relations=tuple(
            Relation(relation["kind"], base + relation["target"], relation["probability"])
            for relation in one["relations"]
        ),
    )


def _departed(semantic_map: SemanticMap, one: Mapping[str, Any]) -> DepartedRecord:
    return DepartedRecord(
        iri=semantic_map.base + one["name"],
        category=semantic_map.catalogue.find(one["category"], "object").iri,
        p_map=np.array(one["position"]),
        peak=1.0,
        observations=3,
        first_seen=one["last_seen"],
        last_seen=one["last_seen"],
        found_gone=one["last_seen"] + 3600.0,
    )


def _place(semantic_map: SemanticMap, room: Mapping[str, Any]) -> PlaceRecord:
    (x0, y0), _, (x1, y1), _ = room["outline"][0]
    kind = semantic_map.catalogue.find(room["likely_category"], "place").iri
    share, last = room["viewed_share"], max((o["last_seen"] for o in room["objects"]), default=0.0)
    return PlaceRecord(
        semantic_map.base + room["name"],
        room["label"],
        *(x0, x1, y0, y1),
        views=9,
        beliefs={kind: 0.95},
        viewed=PlaceViews(share, share, last),
    )
