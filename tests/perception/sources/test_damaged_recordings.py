"""Damage at random places, by fixed seeds: a recording is read or refused in one line."""

import json
import random
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from kg.model.errors import RecordingError
from perception.frames import Frame
from perception.sources.bag_writer import write_bag
from perception.sources.recording import FolderRecording, open_recording
from perception.sources.recording_options import RecordingOptions
from perception.sources.recording_writer import RecordingWriter
from tests.perception.conftest import K

FRAMES = 2
DAMAGES = 40  # of each kind of recording
OPTIONS = RecordingOptions(check=False, T_map_world=np.eye(4))
HEAD = 4096  # the first and the last kilobytes hold the structure, the rest pixels


def rows(T: np.ndarray) -> str:
    return "\n".join(" ".join(map(str, row)) for row in T) + "\n"


def as_seven_scenes(source: FolderRecording, folder: Path) -> None:
    for frame in source.frames():
        name = folder / f"frame-{int(frame.id):06d}"
        cv2.imwrite(f"{name}.color.jpg", frame.rgb)
        cv2.imwrite(f"{name}.depthreg.png", millimetres(frame))
        Path(f"{name}.posecolor.txt").write_text(rows(frame.T_map_cam))
    np.savetxt(folder / "color-intrinsics.txt", K)


def as_numbered(source: FolderRecording, folder: Path) -> None:
    for part in ("color", "depth"):
        (folder / part).mkdir()
    for number, frame in enumerate(source.frames()):
        cv2.imwrite(str(folder / f"color/{number}.jpg"), frame.rgb)
        cv2.imwrite(str(folder / f"depth/{number}.png"), millimetres(frame))
    np.savetxt(folder / "K.txt", K)


def as_poses_in_rows(source: FolderRecording, folder: Path) -> None:
    as_numbered(source, folder)
    np.savetxt(folder / "poses.txt", [frame.T_map_cam.ravel() for frame in source.frames()])


def as_pose_files(source: FolderRecording, folder: Path) -> None:
    as_numbered(source, folder)
    (folder / "pose").mkdir()
    for number, frame in enumerate(source.frames()):
        (folder / f"pose/{number}.txt").write_text(rows(frame.T_map_cam))


def as_posed_images(source: FolderRecording, folder: Path) -> None:
    for number, frame in enumerate(source.frames()):
        cv2.imwrite(str(folder / f"{number:03d}.jpg"), frame.rgb)
        cv2.imwrite(str(folder / f"{number:03d}.png"), millimetres(frame))
        (folder / f"{number:03d}.txt").write_text(rows(frame.T_map_cam))
    np.savetxt(folder / "intrinsic.txt", K)


def as_bop(source: FolderRecording, folder: Path) -> None:
    as_numbered(source, folder)
    (folder / "color").rename(folder / "rgb")
    inverse = [np.linalg.inv(frame.T_map_cam) for frame in source.frames()]
    cards = {
        n: {
            "cam_K": K.ravel().tolist(),
            "cam_R_w2c": T[:3, :3].ravel().tolist(),
            "cam_t_w2c": (T[:3, 3] * 1000).tolist(),
        }
        for n, T in enumerate(inverse)
    }
    (folder / "scene_camera.json").write_text(json.dumps(cards))


def as_polycam(source: FolderRecording, folder: Path) -> None:
    for part in ("images", "depth", "cameras"):
        (folder / "keyframes" / part).mkdir(parents=True)
    for number, frame in enumerate(source.frames()):
        height, width = frame.depth.shape
        camera = {"fx": K[0, 0], "fy": K[1, 1], "cx": K[0, 2], "cy": K[1, 2]}
        T = frame.T_map_cam @ np.diag([1, -1, -1, 1])
        camera |= {f"t_{i}{j}": T[i, j] for i in range(3) for j in range(4)}
        camera |= {"width": width, "height": height}
        top = folder / "keyframes"
        (top / f"cameras/{number}.json").write_text(json.dumps(camera))
        cv2.imwrite(str(top / f"images/{number}.jpg"), frame.rgb)
        cv2.imwrite(str(top / f"depth/{number}.png"), millimetres(frame))


def as_trajectory_log(source: FolderRecording, folder: Path) -> None:
    as_numbered(source, folder)
    poses = (f"{n} {n} {n + 1}\n{rows(f.T_map_cam)}" for n, f in enumerate(source.frames()))
    (folder / "trajectory.log").write_text("".join(poses))


def as_tum(source: FolderRecording, folder: Path) -> None:
    with RecordingWriter(folder) as writer:
        for frame in source.frames():
            writer.add(frame)


def as_bag(suffix: str) -> Callable[[FolderRecording, Path], None]:
    def write(source: FolderRecording, folder: Path) -> None:
        pytest.importorskip("rosbags")
        assert sum(1 for _ in write_bag(source, folder / f"bag{suffix}")) == FRAMES

    return write


def millimetres(frame: Frame) -> np.ndarray:
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


FORMATS = {
    "hololens": as_poses_in_rows,
    "seven_scenes": as_seven_scenes,
    "trajectory_log": as_trajectory_log,
    "tum": as_tum,
    "ros1_bag": as_bag(".bag"),
    "ros2_bag": as_bag(""),
    "mcap": as_bag(".mcap"),
}


@pytest.mark.parametrize("kind", FORMATS)
def test_damaged_recordings_are_read_or_refused_in_one_line(hololens, tmp_path, kind):
    whole = open_recording(hololens(), OPTIONS)
    entries = whole.listing.entries[:FRAMES]
    folder = tmp_path / "written"
    folder.mkdir()
    FORMATS[kind](replace(whole, listing=replace(whole.listing, entries=entries)), folder)
    path = next(folder.glob("bag*"), folder)
    assert len(list(open_recording(path, OPTIONS).frames())) == FRAMES
    files = sorted(p for p in folder.rglob("*") if p.is_file())
    refused = 0
    for seed in range(DAMAGES):
        dice = random.Random(seed)
        file = dice.choice(files)
        content = file.read_bytes()
        file.write_bytes(damaged(content, dice))
        try:
            list(open_recording(path, OPTIONS).frames())
        except RecordingError as error:
            assert "\n" not in str(error)
            assert str(path) in str(error) or path.name in str(error)
            refused += 1
        file.write_bytes(content)
    assert DAMAGES // 4 < refused <= DAMAGES


def cut(image: Path) -> None:
    image.write_bytes(image.read_bytes()[:-20])


def shrink(image: Path) -> None:
    cv2.imwrite(str(image), cv2.imread(str(image), cv2.IMREAD_UNCHANGED)[::2, ::2])


def empty(image: Path) -> None:
    image.write_bytes(b"")


FOLDERS = {
    kind: FORMATS[kind] for kind in ("hololens", "seven_scenes", "trajectory_log", "tum")
} | {
    "bop": as_bop,
    "polycam": as_polycam,
    "pose_files": as_pose_files,
    "posed_images": as_posed_images,
}


@pytest.mark.parametrize("kind", FOLDERS)
def test_frames_with_damaged_images_show_nothing_where_they_are_few(
    hololens: Callable[..., Path], tmp_path: Path, kind: str, caplog: pytest.LogCaptureFixture
) -> None:
    whole = open_recording(hololens(), OPTIONS)
    folder = tmp_path / "written"
    folder.mkdir()
    entries = tuple(
        replace(whole.listing.entries[n % FRAMES], id=str(n), stamp=float(n)) for n in range(50)
    )
    FOLDERS[kind](replace(whole, listing=replace(whole.listing, entries=entries)), folder)
    images = sorted(p for p in folder.rglob("*.*") if p.suffix in (".jpg", ".png"))
    colour = [path for path in images if cv2.imread(str(path), cv2.IMREAD_UNCHANGED).ndim == 3]
    depth = [path for path in images if path not in colour]
    damaged_ones = {colour[0]: cut, colour[9]: shrink, colour[14]: empty}
    damaged_ones |= {colour[19]: Path.unlink, depth[24]: Path.unlink}
    for image, damage in damaged_ones.items():
        damage(image)
    frames = list(open_recording(folder, OPTIONS).frames())
    assert len(frames) == len(entries)
    dark = [n for n, frame in enumerate(frames) if not frame.rgb.any()]
    assert len(dark) == len(damaged_ones)
    assert not any(np.isfinite(frames[n].depth).any() for n in dark)
    assert caplog.text.count("the frame is left out") == 3
    assert caplog.text.count("more frames are left out") == 1
    depth[34].unlink()  # more than a tenth
    with pytest.raises(RecordingError, match="6 of 50 frames are damaged or incomplete"):
        list(open_recording(folder, OPTIONS).frames())
