"""Frames of several cameras of one robot: what is kept of one camera is not that of another."""

from dataclasses import replace

import numpy as np
import pytest

from kg.model.errors import FrameError
from kg.serving.opening import in_memory_map
from mapping.alignment.recording_fit import fitted
from mapping.frames.frame_checks import FrameChecks
from mapping.frames.projection import LEADS
from mapping.mapper import Mapper
from mapping.mapping_options import MappingOptions
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions
from tests.mapping.frames.test_frame_checks import misread
from tests.perception.box_room import room_frame, round_tour

BACK = np.diag([-1.0, 1.0, -1.0, 1.0])  # a camera turned by 180 degrees, to the first one


def test_wrong_poses_of_one_camera_are_found_beside_those_of_another():
    checks = FrameChecks()
    with pytest.raises(FrameError, match=r'frame front-\d+: .*CONVENTIONS\["opengl"\]'):
        for n, T in enumerate(round_tour()):
            rear = room_frame(T @ BACK, n)
            checks.check(replace(rear, camera="rear", id=f"rear-{n}"))
            front = misread(room_frame(T, n), "opengl")
            checks.check(replace(front, camera="front", id=f"front-{n}"))


def test_each_camera_looks_through_all_that_is_gone(make_frame, make_detections):
    """Their frames are taken by turns, and each frame looks through a part of the surface."""
    options = MappingOptions(occupancy=False, check_poses=False)
    there = np.full((49, 65), 2.0, np.float32)
    there[14:34, 20:44] = 1.0
    with in_memory_map() as semantic_map, Mapper(semantic_map, options) as mapper:
        for n in range(30):
            for camera, depth in (("front", there if n < 5 else 2.0), ("rear", 2.0)):
                frame = make_frame(depth, stamp=1000.0 + n, id=f"{camera}-{n}")
                T = frame.T_map_cam if camera == "front" else frame.T_map_cam @ BACK
                mapper.add(replace(frame, T_map_cam=T, camera=camera), make_detections())
        x = semantic_map.surface().points[:, 0]
        assert (x > 1.9).any() and (x < -1.9).any()
        assert not ((x > 0) & (x < 1.5)).any()


def test_the_robot_is_where_its_first_camera_is_or_the_next_while_that_is_silent(
    semantic_map, make_frame, make_detections
):
    mapper = Mapper(semantic_map)

    def heading(camera: str, stamp: float) -> float | None:
        frame = make_frame(stamp=stamp, id=f"{camera}-{stamp}")
        T = frame.T_map_cam if camera == "front" else frame.T_map_cam @ BACK
        written = mapper.add(replace(frame, T_map_cam=T, camera=camera), make_detections()).robot
        return None if written is None else abs(written.heading)

    assert heading("front", 1e9) == pytest.approx(0.0)
    assert heading("rear", 1e9 + 0.1) is None
    assert heading("rear", 1e9 + 1.1 * LEADS) == pytest.approx(np.pi)
    assert heading("front", 1e9 + 1.2 * LEADS) == pytest.approx(0.0)
    assert heading("rear", 1e9 + 1.3 * LEADS) is None


@pytest.mark.parametrize("off", [0.4, -0.1])
def test_another_camera_of_a_bag_stands_on_the_floor_of_the_first(
    shared, make_frame, make_detections, semantic_map, off
):
    first = open_recording(shared("data/rgbd/redkitchen"), RecordingOptions(check=False))
    assert first.gravity_aligned
    with Mapper(semantic_map, recording="front", T_map_world=first.T_map_world) as mapper:
        mapper.add(make_frame(), make_detections())
    higher, turned = np.eye(4), np.diag([-1.0, -1.0, 1.0, 1.0])
    higher[2, 3] = off  # as it estimates the floor by what it sees alone
    rear = replace(first, name="rear", T_map_world=higher @ first.T_map_world)
    placed, _ = fitted(rear, semantic_map, same_frame=True)
    assert np.allclose(placed.T_map_world, first.T_map_world)
    other = replace(rear, T_map_world=turned @ rear.T_map_world)
    assert fitted(other, semantic_map, same_frame=True)[0] is other
