"""A flat of three rooms, for the tests of finding things."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.records import MapUpdate, ObjectRecord, PlaceRecord, RobotRecord
from kg.serving.opening import create_map


def thing(semantic_map, label, x, y, place, seen=0.0):
    return ObjectRecord(
        iri=semantic_map.new_object_iri(),
        category=semantic_map.catalogue.find(label, "object").iri,
        p_map=np.array([x, y, 0.8]),
        confidence=2.0,
        existence=0.9,
        observations=4,
        first_seen=seen,
        last_seen=seen,
        place=None if place is None else semantic_map.place_iri(place),
    )


def fill(semantic_map: SemanticMap, robot_at: float = 0.0) -> SemanticMap:
    """A kitchen and a bedroom side by side, and a third room nobody has seen; a banana, a cup."""
    kind = {name: semantic_map.catalogue.find(name, "place").iri for name in ("kitchen", "bedroom")}
    iri = semantic_map.place_iri
    semantic_map.apply(
        MapUpdate(
            objects=(
                thing(semantic_map, "banana", 1.0, 3.0, 1),
                thing(semantic_map, "cup", 3.0, 1.0, 1),
                thing(semantic_map, "bed", 7.0, 2.0, 2),
            ),
            places=(
                PlaceRecord(iri(1), "place 1", 0, 4, 0, 4, 9, {kind["kitchen"]: 0.9}),
                PlaceRecord(iri(2), "place 2", 4, 8, 0, 4, 9, {kind["bedroom"]: 0.9}),
                PlaceRecord(iri(3), "place 3", 8, 12, 0, 4),
            ),
            robot=RobotRecord(np.array([6.0, 1.0, 1.0]), 0.0, robot_at),
        )
    )
    return semantic_map


def with_unnamed(flat: SemanticMap) -> SemanticMap:
    """The flat, with two things without a name in the kitchen and one in the third room."""
    fill(flat)
    for x, place in ((1.5, 1), (2.5, 1), (10.0, 3)):
        one = replace(thing(flat, "cup", x, 2.0, place), category=v.UNNAMED_THING, existence=0.4)
        flat.apply(MapUpdate((one,)))
    return flat


def flat_map(path: Path) -> Path:
    """The flat as a map in a new folder, which comes back."""
    with create_map(path, title="flat") as semantic_map:
        fill(semantic_map)
    return path
