"""Damage at random places, by fixed seeds: a recording is read or refused in one line."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from kg.model.errors import RecordingError
from perception.sources.bag_writer import write_bag
from perception.sources.recording import FolderRecording, open_recording
from perception.sources.recording_options import RecordingOptions
from perception.sources.recording_writer import RecordingWriter
from tests.perception.conftest import K

FRAMES = 2
DAMAGES = 40  # of each kind of recording
HEAD = 4096  # the first and the last kilobytes hold the structure, the rest pixels


@pytest.fixture
def source(hololens: Callable[..., Path]) -> FolderRecording:
    """The room's first frames."""
    whole = open_recording(hololens(), RecordingOptions(check=False))
    return replace(whole, listing=replace(whole.listing, entries=whole.listing.entries[:FRAMES]))


def write_hololens(source: FolderRecording, folder: Path) -> Path:
    for part in ("images", "depth"):
        (folder / part).mkdir(parents=True)
    for frame in source.frames():
        _save_images(frame, folder / "images" / f"{frame.id}.png", folder / "depth")
    np.savetxt(folder / "poses.txt", [frame.T_map_cam.ravel() for frame in source.frames()])
    np.savetxt(folder / "K.txt", K)
    return folder


def write_seven_scenes(source: FolderRecording, folder: Path) -> Path:
    folder.mkdir()
    for frame in source.frames():
        name = f"frame-{int(frame.id):06d}"
        cv2.imwrite(str(folder / f"{name}.color.jpg"), frame.rgb)
        cv2.imwrite(str(folder / f"{name}.depthreg.png"), _millimetres(frame))
        np.savetxt(folder / f"{name}.posecolor.txt", frame.T_map_cam)
    np.savetxt(folder / "color-intrinsics.txt", K)
    return folder


def write_trajectory_log(source: FolderRecording, folder: Path) -> Path:
    for part in ("color", "depth"):
        (folder / part).mkdir(parents=True)
    log = ""
    for index, frame in enumerate(source.frames()):
        _save_images(frame, folder / "color" / f"{index}.jpg", folder / "depth", str(index))
        rows = "\n".join(" ".join(map(str, row)) for row in frame.T_map_cam)
        log += f"{index} {index} {index + 1}\n{rows}\n"
    (folder / "trajectory.log").write_text(log)
    np.savetxt(folder / "K.txt", K)
    return folder


def write_tum(source: FolderRecording, folder: Path) -> Path:
    with RecordingWriter(folder) as writer:
        for frame in source.frames():
            writer.add(frame)
    return folder


def write_ros1_bag(source: FolderRecording, path: Path) -> Path:
    return _write_bag(source, path.with_suffix(".bag"))


def write_ros2_bag(source: FolderRecording, path: Path) -> Path:
    return _write_bag(source, path)


def write_mcap(source: FolderRecording, path: Path) -> Path:
    return _write_bag(source, path.with_suffix(".mcap"))


def _write_bag(source: FolderRecording, path: Path) -> Path:
    pytest.importorskip("rosbags")
    assert sum(1 for _ in write_bag(source, path)) == FRAMES
    return path


def _save_images(frame, colour: Path, depth: Path, name: str | None = None) -> None:
    cv2.imwrite(str(colour), frame.rgb)
    cv2.imwrite(str(depth / f"{name or frame.id}.png"), _millimetres(frame))


def _millimetres(frame) -> np.ndarray:
    return np.nan_to_num(frame.depth * 1000).round().astype(np.uint16)


def damaged(whole: bytes, dice: random.Random) -> bytes:
    """Bytes with the end cut off, or some of them changed."""
    data = bytearray(whole)
    if dice.random() < 0.25:
        del data[dice.randrange(len(data)) :]
        return bytes(data)
    for _ in range(dice.choice((1, 8, 64))):
        at = dice.randrange(min(dice.choice((64, HEAD, len(data))), len(data)))
        at = at if dice.random() < 0.5 else len(data) - 1 - at
        data[at] = dice.choice((0, 1, 127, 255, dice.randrange(256)))
    return bytes(data)


WRITERS = (
    write_hololens,
    write_seven_scenes,
    write_trajectory_log,
    write_tum,
    write_ros1_bag,
    write_ros2_bag,
    write_mcap,
)


@pytest.mark.parametrize("write", WRITERS, ids=lambda write: write.__name__[6:])
def test_damaged_recordings_are_read_or_refused_in_one_line(
    source: FolderRecording, tmp_path: Path, write: Callable[[FolderRecording, Path], Path]
) -> None:
    path = write(source, tmp_path / "written")
    assert (
        len(
            list(
                open_recording(path, RecordingOptions(check=False, T_map_world=np.eye(4))).frames()
            )
        )
        == FRAMES
    )
    files = [path] if path.is_file() else sorted(p for p in path.rglob("*") if p.is_file())
    refused = 0
    for seed in range(DAMAGES):
        dice = random.Random(seed)
        file = dice.choice(files)
        whole = file.read_bytes()
        file.write_bytes(damaged(whole, dice))
        try:
            list(
                open_recording(path, RecordingOptions(check=False, T_map_world=np.eye(4))).frames()
            )
        except RecordingError as error:
            assert "\n" not in str(error)
            assert str(path) in str(error) or path.name in str(error)
            refused += 1
        file.write_bytes(whole)
    assert DAMAGES // 4 < refused <= DAMAGES
