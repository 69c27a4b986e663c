"""Images of a room are recognised in views that were kept of it, and of no other room."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from perception.camera.poses import motion
from perception.frames import Frame
from perception.odometry.features import FeatureDetector
from perception.odometry.recognition import (
    Doubt,
    KeyView,
    Recogniser,
    Recognition,
    decoded,
    encoded,
    view_of,
)
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions

MOVED = np.array([[0.0, -1, 0, 2], [1, 0, 0, -3], [0, 0, 1, 0.1], [0, 0, 0, 1]])  # another world


@pytest.fixture(scope="module")
def frames(shared: Callable[[str], Path]) -> Callable[[str, slice], list[Frame]]:
    """Callable: name of a recording, and a slice -> its frames."""

    def read(name: str, some: slice) -> list[Frame]:
        recording = open_recording(shared(f"data/rgbd/{name}"), RecordingOptions(check=False))
        return [recording.frame(n) for n in range(len(recording))[some]]

    return read


def kept(frames: Iterable[Frame]) -> list[KeyView]:
    detector = FeatureDetector()
    return [view_of(frame, detector)[0] for frame in frames]


def result(views: Sequence[KeyView], frames: Iterable[Frame]) -> Recognition | Doubt:
    recogniser, detector = Recogniser(views), FeatureDetector()
    for frame in frames:
        recogniser.look(*view_of(frame, detector))
    return recogniser.result()


def test_a_room_is_recognised_and_its_world_placed(frames):
    views = kept(frames("icl_livingroom", slice(0, None, 8)))
    moved = [
        replace(f, T_map_cam=MOVED @ f.T_map_cam) for f in frames("icl_livingroom", slice(4, 40, 6))
    ]
    found = result([decoded(encoded(view), view.pose) for view in views], moved)
    assert isinstance(found, Recognition)
    for frame in moved:
        far, turned = motion(np.linalg.inv(MOVED) @ frame.T_map_cam, found.T @ frame.T_map_cam)
        assert far < 0.05
        assert turned < np.deg2rad(1)
    assert found.error < 0.1


def test_another_room_is_not_recognised(frames):
    rooms = {
        "redkitchen": frames("redkitchen", slice(0, None, 30)),
        "icl_livingroom": frames("icl_livingroom", slice(0, None, 10)),
        "hololens_lounge": frames("hololens_lounge", slice(0, None, 20)),
    }
    for one, views in [(name, kept(room)) for name, room in rooms.items()]:
        for other in rooms.keys() - {one}:
            found = result(views, rooms[other])
            assert isinstance(found, Doubt), (one, other)
            assert "it was not recognised there" in found.reason


def test_of_two_rooms_that_look_alike_neither_is_taken(frames):
    room = frames("icl_livingroom", slice(0, None, 8))
    views = kept(room)
    views += [replace(view, pose=MOVED @ view.pose) for view in views]
    found = result(views, frames("icl_livingroom", slice(4, 40, 6)))
    assert isinstance(found, Doubt)
    assert "looks like two places there" in found.reason


def test_a_room_of_another_shape_with_the_same_pictures_is_not_taken(frames):
    """Two thirds of the depth differ, though all colours are the same."""

    def other(frame: Frame) -> Frame:
        depth = frame.depth.copy()
        third = depth.shape[1] // 3
        depth[:, :third] *= 1.6
        depth[:, -third:] *= 0.7
        return replace(frame, depth=depth)

    room = frames("redkitchen", slice(0, 120, 12))
    found = result(kept(room), [other(frame) for frame in room])
    assert isinstance(found, Doubt)


def test_people_leave_no_features(frames):
    (frame,) = frames("redkitchen", slice(0, 1))
    box = np.array([[100.0, 50, 400, 470]], np.float32)
    view, _ = view_of(frame, FeatureDetector(), without=box)
    x, y = view.features.pixels.T
    assert len(x) > 40
    assert not ((x > 103) & (x < 397) & (y > 53) & (y < 467)).any()


def test_a_view_is_small_and_damage_is_an_error(frames):
    (view,) = kept(frames("redkitchen", slice(0, 1)))
    data = encoded(view)
    assert len(data) < 20_000
    again = decoded(data, view.pose)
    np.testing.assert_allclose(again.features.points, view.features.points, atol=1e-3)
    np.testing.assert_array_equal(again.features.descriptors, view.features.descriptors)
    np.testing.assert_allclose(
        again.features.samples.depth, view.features.samples.depth, atol=1e-3, equal_nan=True
    )
    for wrong in (data[:20], data[:200], data[:-30], b"\xff" * len(data), b""):
        with pytest.raises(ValueError, match=r"."):
            decoded(wrong, view.pose)
