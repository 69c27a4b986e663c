"""What a mapper or a robot saw, told as JSON and read again."""

import json
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from kg.model.errors import InvalidFactError
from kg.model.records import (
    DepartedRecord,
    DoorRecord,
    Evidence,
    FloorTile,
    LookRecord,
    MapUpdate,
    ObjectRecord,
    ObstacleRecord,
    PlaceRecord,
    RecordingRecord,
    RobotRecord,
    SearchRecord,
)
from kg.serving.client.update_codec import update_from_json, update_to_json

HERE = "https://w3id.org/hereabouts#"
BASE = "https://example.org/map/"
CELLS = (np.arange(16, dtype=np.uint8) % 4).reshape(4, 4)
SEEN = Evidence("frame-1", "kitchen", 1e9 + 0.1, (1, 2, 3.25, 4), 0.83, "net")
FULL = MapUpdate(
    objects=(
        ObjectRecord(
            f"{BASE}object/1",
            f"{HERE}Cup",
            np.array([0.1, -2.0, 1 / 3]),
            *(2.4, 0.8, 3, 1e9, 1e9 + 60, f"{BASE}place/1", SEEN),
        ),
        ObjectRecord(f"{BASE}object/2", f"{HERE}Cup", np.zeros(3), 1.0, 0.5, 1, 0.0, 0.0),
    ),
    removed=(f"{BASE}object/3",),
    places=(
        PlaceRecord(
            *(f"{BASE}place/1", "ki\u00e4chen \U0001f34c", 0.0, 1.0, 0.0, 2.5, 7),
            {f"{HERE}Kitchen": 0.8},
            {f"{HERE}Kitchen": 0.7},
            (f"{BASE}object/1",),
            (((0.0, 0.0), (1.0, 0.5), (0.5, 2.5)),),
            True,
            (f"{BASE}place/2",),
        ),
    ),
    robot=RobotRecord(np.array([1.0, 2.0, 3.0]), -3.1, 1e9),
    recording=RecordingRecord("kitchen", 4, "frame-4", np.eye(4) * 1.1, "rooms"),
    search=SearchRecord(
        f"{BASE}search/1", ("cup",), (f"{HERE}Cup",), "given up", 1.0, 2.0, 3.5, 0.25, (BASE,)
    ),
    looks=(
        LookRecord(
            *(f"{BASE}search/1/look/1", f"{BASE}search/1", 1, 1e9, (1.0, 2.0), 0.5, 1.5),
            (f"{HERE}Cup",),
            (f"{BASE}object/1",),
            ((1.0, 2.0, 3.0),),
        ),
    ),
    obstacles=(
        ObstacleRecord(f"{BASE}search/1/obstacle/1", f"{BASE}search/1", 1, 1e9, (0.0, 1.0), "door"),
    ),
    floor=(FloorTile(0, -1, 2, 0.05, 0.05, CELLS, 1e9),),
    departed=(
        DepartedRecord(
            BASE + "object/3",
            "https://w3id.org/hereabouts#Cup",
            np.array([1.0, 2.0, 0.5]),
            0.9,
            3,
            1.0,
            2.0,
            3.0,
        ),
    ),
    doors=(DoorRecord(f"{BASE}door/1-2", 1.0, 2.0, 0.9, (f"{BASE}place/1", f"{BASE}place/2")),),
)


def plain(value: Any) -> Any:
    """Records as nested plain values, arrays as lists with what they are made of."""
    if isinstance(value, np.ndarray):
        return value.dtype.name, value.tolist()
    if isinstance(value, tuple):
        return tuple(map(plain, value))
    if hasattr(value, "__dataclass_fields__"):
        return type(value), {f.name: plain(getattr(value, f.name)) for f in fields(value)}
    return value


@pytest.mark.parametrize("update", [FULL, MapUpdate()], ids=["full", "empty"])
def test_an_update_is_the_same_when_it_arrives(update: MapUpdate) -> None:
    assert all(getattr(FULL, f.name) for f in fields(FULL)), "nothing is left untried"
    told = json.loads(json.dumps(update_to_json(update)))
    assert plain(update_from_json(told)) == plain(update)


def changed(told: Any, path: tuple[object, ...], value: object) -> Any:
    """`told` with one member replaced; of an Ellipsis, left out."""
    copy = json.loads(json.dumps(told))
    at = copy
    for step in path[:-1]:
        at = at[step]
    if value is ...:
        del at[path[-1]]
    else:
        at[path[-1]] = value
    return copy


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        (("objects",), {}, "update.objects must be a list"),
        (("objects", 0), 3, "must be an object of iri"),
        (("objects", 0, "iri"), ..., "must be an object of iri"),
        (("objects", 0, "more"), 1, "must be an object of iri"),
        (("objects", 0, "iri"), 7, "update.objects[0].iri must be a text"),
        (("objects", 0, "iri"), "\ud800", "must be Unicode"),
        (("objects", 0, "p_map"), [1, 2], "must be a list of 3 numbers"),
        (("objects", 0, "p_map"), [1, 2, "3"], "p_map must be a number"),
        (("objects", 0, "confidence"), True, "must be a number"),
        (("objects", 0, "confidence"), 10**400, "fits a double"),
        (("objects", 0, "observations"), 1.5, "must be a whole number"),
        (("objects", 0, "observations"), 1 << 60, "must be a whole number"),
        (("objects", 0, "evidence"), [], "must be an object of frame"),
        (("places", 0, "beliefs"), [], "must be an object"),
        (("places", 0, "beliefs", "x"), None, "must be a number"),
        (("search", "state"), "lost", "must be running or stopped or found or given up"),
        (("robot",), "here", "must be an object of p_map"),
        (("floor", 0, "cells"), "AAAA", "cells in the encoding of here:floorCells"),
        (("floor", 0, "cells"), None, "must be a text"),
        (("removed", 0), None, "update.removed[0] must be a text"),
    ],
)
def test_what_is_no_update_is_refused_by_the_member_at_fault(path, value, said):
    told = changed(update_to_json(FULL), path, value)
    with pytest.raises(InvalidFactError) as refused:
        update_from_json(told)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)
