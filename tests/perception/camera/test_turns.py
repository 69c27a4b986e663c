"""Cameras that are held on their side: told by how they turn, and turned upright with `up`."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from perception.camera.gravity_alignment import clear_turns, side_up, turned_image, turned_poses
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions

Poses = list[NDArray[np.float64]]


@pytest.fixture
def on_its_side(hololens: Callable[..., Path], room_views: Poses) -> Path:
    """The room as a camera that is held on its side records it, in a format without gravity."""
    folder = hololens()
    for path in (*folder.glob("images/*.png"), *folder.glob("depth/*.png")):
        cv2.imwrite(str(path), turned_image(cv2.imread(str(path), cv2.IMREAD_UNCHANGED), 3))
    np.savetxt(folder / "poses.txt", [turned_poses(T, 3).ravel() for T in room_views])
    K = np.loadtxt(folder / "K.txt")
    height = cv2.imread(str(folder / "images/8.png")).shape[1]
    turned = [[K[1, 1], 0, height - 1 - K[1, 2]], [0, K[0, 0], K[0, 2]], [0, 0, 1]]
    np.savetxt(folder / "K.txt", turned)
    return folder


def test_a_camera_on_its_side_is_told_by_the_axis_it_turns_about(room_views: Poses) -> None:
    assert side_up(room_views) is None
    for turns in (1, 3):
        up = side_up([turned_poses(T, turns) for T in room_views])
        assert up is not None and abs(up[2]) > 0.99
    assert side_up([turned_poses(room_views[0], 1)] * 6) is None  # it does not turn at all
    assert side_up([turned_poses(room_views[0], 1)]) is None


def test_images_that_do_not_agree_on_up_are_not_turned(room_views: Poses) -> None:
    up = np.array([0.0, 0, 1])
    assert clear_turns([turned_poses(T, 1) for T in room_views], up) == 3
    assert clear_turns([turned_poses(T, int(i > 1)) for i, T in enumerate(room_views)], up) == 0


def test_what_may_lie_on_its_side_is_told_with_what_would_work(on_its_side, caplog):
    open_recording(on_its_side, RecordingOptions(check=False))
    assert "held on its side" in caplog.text and "--up=" in caplog.text


def test_an_upright_camera_is_not_warned_of(hololens, caplog):
    open_recording(hololens())
    assert not caplog.text


def test_images_of_any_format_are_turned_upright_where_up_is_given(on_its_side, room_views, caplog):
    recording = open_recording(on_its_side, RecordingOptions(up="z", check=False))
    assert "turned by 90 degrees" in caplog.text and "held on" not in caplog.text
    frame = recording.frame(2)
    assert frame.rgb.shape[1] > frame.rgb.shape[0]
    np.testing.assert_allclose(
        recording.listing.entries[2].T_world_cam[:3, :3], room_views[2][:3, :3], atol=1e-5
    )
