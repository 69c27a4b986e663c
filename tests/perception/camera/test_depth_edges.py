"""Colour that shows another scene than depth has edges elsewhere."""

import logging
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks.odometry.faults import FAULTS
from benchmarks.odometry.houses import house_tour
from kg.model.errors import RecordingError
from perception.camera.depth_edges import ONE_SCENE, colour_fit
from perception.frames import Frame
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions
from perception.sources.recording_writer import RecordingWriter

Shared = Callable[[str], Path]
ROOMS = ("icl_livingroom", "hololens_lounge")


@pytest.fixture(scope="module")
def house() -> list[Frame]:
    return house_tour(5, 3.0, slice(None, None, 3))


def chosen(length: int) -> list[int]:
    return np.linspace(0, length - 1, 24).astype(int).tolist()


@pytest.fixture(scope="module", params=ROOMS)
def room(request, shared: Shared) -> list[Frame]:
    recording = open_recording(shared(f"data/rgbd/{request.param}"), RecordingOptions(check=False))
    return [next(recording.frames(n)) for n in chosen(len(recording))]


def fit(frames: list[Frame]) -> float | None:
    return colour_fit([(frames[n].rgb, frames[n].depth) for n in chosen(len(frames))])


def faulty(frames: list[Frame]) -> dict[str, float | None]:
    random = np.random.default_rng(1)
    return {
        name: fit(FAULTS[name](list(frames), random))
        for name in ("other_colour", "mirrored", "dirty_lens")
    }


def test_colour_of_a_house_fits_its_depth_and_other_colour_does_not(house):
    assert fit(house) > 1.7
    assert all(found < ONE_SCENE for found in faulty(house).values())


def test_colour_of_rooms_fits_their_depth_and_other_colour_does_not(room):
    assert fit(room) > 1.7
    assert all(found < ONE_SCENE for found in faulty(room).values())


def test_a_part_that_moves_with_the_camera_says_nothing(house):
    assert fit(FAULTS["gripper"](list(house), np.random.default_rng(1))) > 1.7


def test_black_images_say_nothing(room):
    assert fit(FAULTS["black"](room, np.random.default_rng(1))) > 1.7


def test_a_camera_that_stands_still_says_nothing(house):
    assert colour_fit([(house[0].rgb, house[0].depth)] * 24) is None


def test_images_of_different_sizes_say_nothing(house):
    small = [
        (cv2.resize(f.rgb, (160, 90)), cv2.resize(f.depth, (160, 90), interpolation=0))
        for f in house[::2]
    ]
    assert colour_fit([*small, *((f.rgb, f.depth) for f in house[::2])]) is None


def written(frames: list[Frame], folder: Path) -> Path:
    with RecordingWriter(folder, up=(0, 0, 1)) as writer:
        for frame in frames:
            writer.add(frame, frame.T_map_cam)
    return folder


def test_mirrored_colour_is_told_with_given_poses(house, tmp_path, caplog):
    folder = written(FAULTS["mirrored"](house, np.random.default_rng(1)), tmp_path / "house")
    with caplog.at_level(logging.WARNING):
        open_recording(folder)
    assert "colour does not show the scene that depth shows" in caplog.text


def test_mirrored_colour_is_refused_where_poses_are_estimated(tmp_path):
    frames = house_tour(1, 1.0, slice(24))
    folder = written(FAULTS["mirrored"](frames, np.random.default_rng(1)), tmp_path / "house")
    with pytest.raises(RecordingError, match=r"colour does not show the scene .* --no-check"):
        open_recording(folder, RecordingOptions(estimate_poses=True))
