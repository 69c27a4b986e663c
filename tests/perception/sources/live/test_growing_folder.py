"""Recordings that grow: a frame is given once both of its images are there."""

import threading
from pathlib import Path

import cv2
import numpy as np

from perception.sources.live.growing_folder import GrowingRecording
from perception.sources.recording import FolderRecording, open_recording
from perception.sources.recording_options import RecordingOptions
from tests.perception.conftest import K

OPTIONS = RecordingOptions(check=False, T_map_world=np.eye(4), estimate_poses=False)
FRAMES = 24


def write(folder: Path, number: int, *parts: str) -> None:
    images = {
        "rgb": np.full((60, 80, 3), 90, np.uint8),
        "depth": np.full((60, 80), 1000 + number, np.uint16),
    }
    for part in parts:
        (folder / part).mkdir(parents=True, exist_ok=True)
        if part == "pose":
            np.savetxt(folder / part / f"{number:03d}.txt", np.eye(4))
        else:
            cv2.imwrite(str(folder / part / f"{number:03d}.png"), images[part])


def test_a_frame_whose_depth_is_not_written_yet_is_waited_for(tmp_path: Path) -> None:
    for number in range(FRAMES):
        write(tmp_path, number, "rgb", "pose", *(["depth"] * (number < FRAMES - 1)))
    write(tmp_path, FRAMES, "rgb", "depth", "pose")
    (tmp_path / "depth" / f"{FRAMES:03d}.png").unlink()
    np.savetxt(tmp_path / "K.txt", K)

    def opened() -> FolderRecording:
        return open_recording(tmp_path, OPTIONS)

    late = threading.Timer(0.6, write, (tmp_path, FRAMES - 1, "depth"))
    last = threading.Timer(0.8, write, (tmp_path, FRAMES, "depth"))
    for timer in (late, last):
        timer.start()
    growing = GrowingRecording(opened(), opened, threading.Event(), limit=FRAMES)
    frames = list(growing.frames())
    assert [frame.id for frame in frames] == [f"{number:03d}" for number in range(FRAMES)]
    assert all(np.isfinite(frame.depth).any() for frame in frames)
