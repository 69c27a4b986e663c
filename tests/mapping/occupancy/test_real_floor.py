"""The floor of real depth: walls where walls are, and a table where the table is."""

from __future__ import annotations

import json

import numpy as np

from kg.model.records import FREE, LOW, TALL, MapUpdate
from kg.serving.opening import in_memory_map
from mapping.alignment.recording_fit import load_transform
from mapping.occupancy.mapped_floor import MappedFloor, mapped_floor
from mapping.occupancy.occupancy_map import OccupancyMap
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions


def floor_of(shared, sequence: str, every: int) -> tuple[MappedFloor, np.ndarray]:
    """The floor of every so manieth frame, and the recording's T_map_world."""
    T = load_transform(shared("data/rgbd/composite_building.json"), sequence)
    recording = open_recording(shared(f"data/rgbd/{sequence}"), RecordingOptions(T_map_world=T))
    with in_memory_map() as semantic_map:
        book = OccupancyMap(semantic_map)
        for index in range(0, len(recording), every):
            book.add(next(iter(recording.frames(index))))
        semantic_map.apply(MapUpdate(floor=book.take_rest()))
        floor = mapped_floor(semantic_map.floor())
    assert floor is not None
    return floor, T


def spots(floor: MappedFloor, *states: int) -> np.ndarray:
    """(n, 2) [m] the cells with one of these states."""
    at = np.argwhere(np.isin(floor.states, states))
    return floor.origin + (at + 0.5) * floor.resolution


def away(points: np.ndarray, p_map: np.ndarray) -> float:
    """[m] from `p_map` to the nearest of the points."""
    return float(np.linalg.norm(points - p_map[:2], axis=1).min())


def test_the_real_kitchen_has_its_walls_table_and_chairs(shared):
    floor, T = floor_of(shared, "redkitchen", 5)
    truth = json.loads(shared("data/rgbd/redkitchen/objects_gt.json").read_text())["objects"]
    wall, furniture = spots(floor, TALL), spots(floor, LOW)
    for name, known in truth.items():
        p_map = T @ np.append(known["position"], 1)
        if known["cls"] in ("chair", "dining table", "cup"):
            assert away(furniture, p_map) < 0.1, name
        if known["cls"] == "tv":  # they hang on the walls
            assert away(wall, p_map) < 0.25, name
    along = [x for x in np.arange(-3.0, 2.0, 0.05) if (abs(wall[:, 0] - x) < 0.03).any()]
    back = np.array([wall[abs(wall[:, 0] - x) < 0.03, 1].min() for x in along])
    assert len(along) > 80  # nearly all of its five metres
    assert (abs(back - np.median(back)) < 0.11).mean() > 0.95  # as straight as two cells
    assert spots(floor, FREE)[:, 1].min() > np.median(back)
    assert len(spots(floor, FREE)) * floor.resolution**2 > 1.5  # [m^2]


def test_the_living_room_ends_at_a_slanted_wall(shared):
    floor, _ = floor_of(shared, "icl_livingroom", 3)
    wall, free = spots(floor, TALL), spots(floor, FREE)
    rng, best, line = np.random.default_rng(0), 0, (wall[0], np.zeros(2))
    for _ in range(300):  # the line that most of the wall lies on
        a, b = wall[rng.integers(len(wall), size=2)]
        if (length := float(np.linalg.norm(b - a))) < 1:
            continue
        normal = np.array([a[1] - b[1], b[0] - a[0]]) / length
        if (count := int((abs((wall - a) @ normal) < floor.resolution).sum())) > best:
            best, line = count, (a, normal)
    assert best > 0.5 * len(wall)
    side = (free - line[0]) @ line[1]
    assert min((side > 0.1).sum(), (side < -0.1).sum()) == 0  # nothing behind it
    assert len(free) * floor.resolution**2 > 2.0  # [m^2]
