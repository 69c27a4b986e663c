"""Standing a world upright: against gravity as measured, hand-made transforms, and known tilts."""

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from kg.model.errors import RecordingError
from perception.camera.gravity_alignment import (
    flat_patches,
    gravity_aligned_transform,
    level_transform,
    parse_up,
    read_gravity,
)
from perception.frames import Frame
from perception.sources.recording import FolderRecording, open_recording
from perception.sources.recording_options import RecordingOptions

IDENTITY = np.eye(4)
UNCHECKED = RecordingOptions(check=False)


def degrees(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip(a @ b, -1, 1))))


def surface_points(recording) -> np.ndarray:
    """(n, 3) [m] points of flat surfaces in the recording's own world."""
    T_world_map = np.linalg.inv(recording.T_map_world)
    found = []
    for i in range(0, len(recording), len(recording) // 5):
        frame = next(recording.frames(i))
        T = T_world_map @ frame.T_map_cam
        found.append(flat_patches(frame.depth, frame.K)[0] @ T[:3, :3].T + T[:3, 3])
    return np.concatenate(found)


def hand_made(shared, name: str) -> np.ndarray:
    building = json.loads(shared("data/rgbd/composite_building.json").read_text())
    return np.array(building["sequences"][name]["T_map_world"])


def test_gravity_file_points_down_as_the_hand_made_truth_says(shared):
    folder = shared("data/rgbd/redkitchen")
    truth = json.loads((folder / "objects_gt.json").read_text())["up"]
    assert degrees(read_gravity(folder), np.array(truth) / np.linalg.norm(truth)) < 1


def test_up_found_from_the_kitchens_surfaces_agrees_with_gravity(shared):
    recording = open_recording(shared("data/rgbd/redkitchen_tum"), UNCHECKED)
    gravity = read_gravity(shared("data/rgbd/redkitchen"))
    assert degrees(recording.T_map_world[2, :3], gravity) < 3


@dataclass
class Behind:
    """A recording whose depth shows a far surface where it has none."""

    recording: FolderRecording
    far: Callable[[np.ndarray], np.ndarray]  # pixels (n, 2) -> depth [m]

    def __getattr__(self, name: str) -> object:
        return getattr(self.recording, name)

    def __len__(self) -> int:
        return len(self.recording)

    def frames(self, start: int = 0) -> Iterator[Frame]:
        for frame in self.recording.frames(start):
            nothing = np.isnan(frame.depth)
            depth = frame.depth.copy()
            depth[nothing] = self.far(np.argwhere(nothing))
            yield replace(frame, depth=depth)


@pytest.mark.parametrize(
    "far",
    [
        lambda at: 12 + np.random.default_rng(0).normal(0, 0.03, len(at)),
        lambda at: 20 + at[:, 1] / 50,
        lambda at: 25 + 7 * ((at // 40).sum(axis=1) % 3),
    ],
)
def test_far_surfaces_that_are_none_move_no_floor(shared, far):
    recording = open_recording(shared("data/rgbd/redkitchen_tum"), UNCHECKED)
    placed = recording.placed(IDENTITY)
    T = gravity_aligned_transform(Behind(placed, far))
    np.testing.assert_allclose(T, gravity_aligned_transform(placed), atol=1e-6)


@pytest.mark.parametrize("name", ["redkitchen", "icl_livingroom"])
def test_heights_agree_with_the_hand_made_transform(shared, name):
    recording = open_recording(shared(f"data/rgbd/{name}"), UNCHECKED)
    truth = hand_made(shared, name)
    assert degrees(recording.T_map_world[2, :3], truth[2, :3]) < 3
    p = surface_points(recording)
    ours, theirs = (p @ T[2, :3] + T[2, 3] for T in (recording.T_map_world, truth))
    assert np.abs(ours - theirs).max() < 0.1


def test_a_given_transform_is_used_as_it_is(shared):
    truth = hand_made(shared, "icl_livingroom")
    options = RecordingOptions(T_map_world=truth, check=False)
    recording = open_recording(shared("data/rgbd/icl_livingroom"), options)
    np.testing.assert_array_equal(recording.T_map_world, truth)


def test_given_up_wins_over_the_gravity_file(shared):
    recording = open_recording(
        shared("data/rgbd/redkitchen"), RecordingOptions(up="-y", check=False)
    )
    np.testing.assert_allclose(recording.T_map_world[2, :3], [0, -1, 0], atol=1e-12)


@settings(
    max_examples=8,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(rotation=st.tuples(*[st.floats(-3, 3)] * 3), shift=st.tuples(*[st.floats(-5, 5)] * 3))
def test_a_tilted_room_is_stood_up_whatever_its_world(tilted, rotation, shift):
    T_world_room = IDENTITY.copy()
    T_world_room[:3, :3] = cv2.Rodrigues(np.array(rotation))[0]
    T_world_room[:3, 3] = shift
    T_map_room = tilted(T_world_room) @ T_world_room
    assert degrees(T_map_room[2, :3], np.array([0, 0, 1.0])) < 1
    assert abs(T_map_room[2, 3]) < 0.03, "the floor is at z = 0"


@pytest.fixture
def tilted(hololens):
    """Callable: the transform found for the written room in another world."""
    folder = hololens()
    upright = open_recording(folder, RecordingOptions(T_map_world=IDENTITY))

    def find(T_world_room: np.ndarray) -> np.ndarray:
        rows = [T_world_room @ entry.T_world_cam for entry in upright.listing.entries]
        np.savetxt(folder / "poses.txt", [T.ravel() for T in rows])
        return gravity_aligned_transform(
            open_recording(folder, RecordingOptions(T_map_world=IDENTITY))
        )

    return find


@given(up=st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1))
def test_standing_is_rigid_and_turns_up_onto_z(up):
    unit = np.array(up) / np.linalg.norm(up)
    T = level_transform(unit, 0.7)
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-9)
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1)
    np.testing.assert_allclose(T[:3, :3] @ unit, [0, 0, 1], atol=1e-9)
    assert (T @ [*(0.7 * unit), 1])[2] == pytest.approx(0)


def test_a_world_that_is_upright_keeps_its_heading():
    np.testing.assert_allclose(level_transform(np.array([0, 0, 1.0]), 0.0), IDENTITY)


@pytest.mark.parametrize(
    ("text", "vector"),
    [
        ("y", (0, 1, 0)),
        ("-y", (0, -1, 0)),
        ("+z", (0, 0, 1)),
        ("Z", (0, 0, 1)),
        ("0,-2,0", (0, -1, 0)),
        ([0, 0, 3], (0, 0, 1)),
    ],
)
def test_up_can_be_said_in_several_ways(text, vector):
    np.testing.assert_allclose(parse_up(text), vector)


def test_a_recording_that_sees_nothing_flat_says_so(hololens):
    folder = hololens()
    noise = np.random.default_rng(1)
    for path in (folder / "depth").iterdir():
        cv2.imwrite(str(path), noise.integers(500, 9000, (120, 160)).astype(np.uint16))
    with pytest.raises(RecordingError, match="no flat surface"):
        open_recording(folder)


def test_a_damaged_gravity_file_is_refused(hololens):
    folder = hololens()
    (folder / "gravity-direction.txt").write_text("0 0\n")
    with pytest.raises(RecordingError, match="three numbers of a direction"):
        open_recording(folder)
