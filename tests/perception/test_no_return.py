"""Depths that mean no return: what programs write where nothing was measured, and walls."""

import json
import logging

import cv2
import numpy as np
import pytest

from mapping.frames.pose_monitor import PoseMonitor
from perception.frames import Frame
from perception.no_return import FRAMES, ray_lengths, shared_values, without_constants
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions
from tests.perception.conftest import SIZE, K, room_depth

OUTER = (slice(0, 60), slice(90, 160))  # where nothing returns


def frame(depth, T) -> Frame:
    return Frame("f", np.zeros((*depth.shape, 3), np.uint8), depth, K, T, 0.0)


def with_holes(T, value, along_ray=False) -> np.ndarray:
    depth = room_depth(T, K, SIZE).astype(np.float32)
    rays = ray_lengths(depth.shape, (130.0, 130.0, 79.5, 59.5)) if along_ray else 1
    depth[OUTER] = (np.full(depth.shape, value) / rays)[OUTER]
    return np.minimum(depth, np.float32(value)) if value > 1 else depth


@pytest.mark.parametrize("along_ray", [False, True])
@pytest.mark.parametrize("value", [8.0, 10.0, 20.0, 65.535, 1000.0, 1e10, 3e38, 0.2, 0.001])
def test_a_constant_that_no_surface_has_is_no_return_in_every_frame(room_views, value, along_ray):
    if along_ray and not 1 < value < 1e6:
        return
    given = with_holes(room_views[0], value, along_ray)
    kept = frame(given, room_views[0]).depth
    assert np.isnan(kept[OUTER]).all()
    assert np.array_equal(np.delete(kept, np.s_[90:160], 1), np.delete(given, np.s_[90:160], 1))
    assert np.isfinite(given).all(), "the array that was given stays"


def test_rounding_and_two_constants_are_seen_and_surfaces_stay(room_views):
    T, rng = room_views[1], np.random.default_rng(0)
    depth = with_holes(T, 12.0)
    depth[OUTER] *= rng.uniform(1 - 3e-4, 1 + 3e-4, (60, 70)).astype(np.float32)
    depth[70:100, 0:60] = 300.0
    kept = without_constants(depth, K)
    assert np.isnan(kept[OUTER]).all() and np.isnan(kept[70:100, 0:60]).all()
    room = room_depth(T, K, SIZE).astype(np.float32)
    assert without_constants(room, K) is room
    far = room * np.float32(4)  # a hall
    assert without_constants(far, K) is far
    wall = np.full((120, 160), 3.0, np.float32)
    assert [one.measurable for one in shared_values(wall, K)] == [True]
    assert without_constants(wall, K) is wall


def test_a_value_that_a_wall_may_have_is_told_once_it_does_not_move_with_the_camera(
    room_views, caplog
):
    monitor, still = PoseMonitor("robot"), PoseMonitor("standing")
    for T in room_views[:FRAMES]:
        monitor.add(frame(with_holes(T, 3.0), T))
        still.add(frame(with_holes(room_views[0], 3.0), room_views[0]))
    assert "depth of 3 m" in monitor.problems["constant"]
    assert "robot: depth of 3 m" in caplog.text
    assert "constant" not in still.problems


@pytest.mark.parametrize(
    ("suffix", "value"), [("png", 10.0), ("png", 3.0), ("npy", 3.0), ("npy", 20.0), ("npy", 0.2)]
)
def test_the_floor_of_a_recording_with_a_far_plane_is_where_it_is(
    tmp_path, room_views, caplog, suffix, value
):
    for name in ("rgb", "depth", "pose"):
        (tmp_path / name).mkdir()
    (tmp_path / "intrinsics.json").write_text(
        json.dumps({"fx": 130, "fy": 130, "cx": 79.5, "cy": 59.5})
    )
    for i, T in enumerate(room_views):
        cv2.imwrite(str(tmp_path / f"rgb/{i}.png"), np.zeros((120, 160, 3), np.uint8))
        depth = with_holes(T, value)
        if suffix == "npy":
            np.save(tmp_path / f"depth/{i}.npy", depth)
        else:
            cv2.imwrite(str(tmp_path / f"depth/{i}.png"), np.rint(depth * 1000).astype(np.uint16))
        np.savetxt(tmp_path / f"pose/{i}.txt", T)
    with caplog.at_level(logging.WARNING):
        recording = open_recording(tmp_path, RecordingOptions(check=True))
    assert f"depth of {value:g} m" in caplog.text and caplog.text.count("no return") == 1
    assert abs(recording.T_map_world[2, 3]) < 0.03
    assert all(np.isnan(one.depth[OUTER]).all() for one in recording.frames())
