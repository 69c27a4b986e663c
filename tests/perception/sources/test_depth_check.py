"""Wrong depth scales and conventions of poses are noticed, with what would work."""

import logging
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from kg.model.errors import RecordingError
from perception.camera.poses import (
    BODY_FROM_CAMERA,
    CONVENTIONS,
    motion,
    pose_from_quaternion,
    quaternion_from_pose,
)
from perception.frames import Frame
from perception.no_return import ray_lengths
from perception.sources.bags.camera_mounts import pose_of_origin
from perception.sources.depth_check import depth_findings
from perception.sources.listing import Streams
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions
from perception.sources.recording_writer import RecordingWriter, pose_line
from tests.perception.box_room import room_frame, round_tour

#: by convention, right poses as they would be given
MISREAD = {
    "world-to-camera": CONVENTIONS["world-to-camera"],
    "opengl": CONVENTIONS["opengl"],
    "ros": lambda T: T @ np.linalg.inv(BODY_FROM_CAMERA),
}


def write(folder: Path, as_written=lambda T: T, change=lambda frame: frame, count=40) -> Path:
    with RecordingWriter(folder, up=(0, 0, 1)) as writer:
        for number, T in enumerate(round_tour()[:count]):
            writer.add(change(room_frame(T, number)), as_written(T))
    return folder


def along_the_ray(frame: Frame) -> Frame:
    K, (rows, columns) = frame.K, frame.depth.shape
    lengths = ray_lengths((rows, columns), (K[0, 0], K[1, 1], K[0, 2], K[1, 2]))
    return replace(frame, depth=frame.depth * lengths)


def mirrored(frame: Frame) -> Frame:
    return replace(frame, rgb=frame.rgb[:, ::-1].copy(), depth=frame.depth[:, ::-1].copy())


def w_first(T: np.ndarray) -> np.ndarray:
    x, y, z, w = quaternion_from_pose(T)
    return pose_from_quaternion(T[:3, 3], np.array([w, x, y, z]), "pose")


def in_millimetres(T: np.ndarray) -> np.ndarray:
    return np.block([[T[:3, :3], 1000 * T[:3, 3:]], [T[3:]]])


def of_base(T: np.ndarray) -> np.ndarray:
    return T @ np.linalg.inv(pose_of_origin((0.2, 0.0, 0.9), (0, 0.3, 0)) @ BODY_FROM_CAMERA)


#: by the two causes that are named: the poses as written, a frame as written, and what would work
TWO_CAUSES = {
    "in millimetres and colour and depth are mirrored": (in_millimetres, mirrored, "metres and bo"),
    "convention world-to-camera and depth is the length of the ray": (
        MISREAD["world-to-camera"], along_the_ray, "--pose-convention world-to-camera and depth"),
    "quaternions are w x y z and poses are by the convention world-to-camera": (
        lambda T: w_first(np.linalg.inv(T)), lambda frame: frame, "x y z w and --pose-convention"),
    "poses are by the convention opengl and it is 0.": (
        MISREAD["opengl"], lambda frame: replace(frame, depth=frame.depth * 3), "--depth-scale"),
    "depth is the length of the ray and colour and depth are mirrored": (
        lambda T: T, lambda frame: mirrored(along_the_ray(frame)), "flipped left to right"),
}  # fmt: skip

#: by the cause that is named: the poses as written, a frame as written, and what would work
CAUSES = {
    "depth is the length of the ray": (lambda T: T, along_the_ray, "depth along the optical axis"),
    "colour and depth are mirrored": (lambda T: T, mirrored, "both flipped left to right"),
    "quaternions are w x y z": (w_first, lambda frame: frame, "x y z w would work"),
    "poses are in millimetres": (in_millimetres, lambda frame: frame, "metres would work"),
    "of what carries it": (of_base, lambda frame: frame, "--camera-in body="),
    "these are poses of what": (
        lambda T: np.linalg.inv(MISREAD["opengl"](T)),
        lambda frame: frame,
        "--pose-convention world-to-camera with --camera-in body=0,0,0,0,1.571,1.571 for",
    ),
}


def test_a_minority_of_wrong_depth_is_told_by_name(tmp_path, caplog):
    def every_fifth(frame: Frame) -> Frame:
        factor = 4 if int(frame.id[-6:]) % 5 == 3 else 1
        return replace(frame, depth=frame.depth * np.float32(factor))

    recording = open_recording(write(tmp_path / "room", change=every_fifth))
    assert len(recording) == 40
    said = next(text for text in caplog.messages if "contradicts the frames before" in text)
    named = [int(word[-6:]) for word in said.replace(",", " ").replace(";", " ").split()
             if word.startswith("frame-")]  # fmt: skip
    assert named and all(number % 5 == 3 for number in named)


@pytest.mark.parametrize("causes", TWO_CAUSES)
def test_two_causes_at_once_are_named(tmp_path, causes):
    as_written, change, remedy = TWO_CAUSES[causes]
    folder = write(tmp_path / "room", as_written, change, count=24)
    with pytest.raises(RecordingError, match=f"{causes}.*{remedy}.*would work together"):
        open_recording(folder)


def test_disparity_is_named_with_the_baseline_and_the_option_works(tmp_path):
    focal = room_frame(round_tour()[0], 0).K[0, 0]
    pixels = lambda f: replace(f, depth=(focal * 0.11 / f.depth).astype(np.float32))  # noqa: E731
    with pytest.raises(RecordingError, match="it is disparity; --disparity") as refused:
        open_recording(write(tmp_path / "room", change=pixels))
    about = float(re.search(r"--disparity ([\d.]+)", str(refused.value))[1])
    assert about == pytest.approx(0.11, rel=0.15)
    mended = open_recording(tmp_path / "room", RecordingOptions(disparity=0.11))
    true = room_frame(round_tour()[5], 5).depth
    assert np.nanmedian(np.abs(mended.frame(5).depth / true - 1)) < 0.01


@pytest.mark.parametrize("cause", CAUSES)
def test_the_cause_is_named_and_what_would_work_works(tmp_path, cause):
    as_written, change, remedy = CAUSES[cause]
    folder = write(tmp_path / "room", as_written, change)
    with pytest.raises(RecordingError, match=f"{cause}.*{remedy}") as refused:
        open_recording(folder)
    words = str(refused.value).split()
    if "--camera-in" in words:
        mount = words[words.index("--camera-in") + 1]
        turned = "world-to-camera" if "--pose-convention" in words else "camera-to-world"
        options = RecordingOptions(pose_convention=turned, streams=Streams(camera_in=mount))
        read = [entry.T_world_cam for entry in open_recording(folder, options).listing.entries]
        for ours, theirs in zip(read, round_tour(), strict=True):
            assert np.abs(ours - theirs)[:2, 3].max() < 0.1  # its height does not show
            assert motion(ours, theirs)[1] < 0.03


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    return write(tmp_path_factory.mktemp("check") / "room")


def test_a_sound_recording_is_opened_without_a_word(room, caplog):
    with caplog.at_level(logging.WARNING):
        assert len(open_recording(room)) == 40
    assert not caplog.records


@pytest.mark.parametrize("scale", [1000.0, 25000.0])
def test_a_wrong_depth_scale_is_refused_with_the_right_one(room, scale):
    with pytest.raises(RecordingError, match=f"--depth-scale 5000 would work instead of {scale:g}"):
        open_recording(room, RecordingOptions(depth_scale=scale))
    assert (
        open_recording(room, RecordingOptions(depth_scale=scale, check=False)).depth_scale == scale
    )


@pytest.mark.parametrize(("times", "right"), [(100, "500000"), (1000, "5000000")])
def test_depth_far_too_large_is_refused_with_its_unit(tmp_path, times, right):
    larger = lambda f: replace(f, depth=f.depth * np.float32(times))  # noqa: E731
    frames = [larger(room_frame(T, n)) for n, T in enumerate(round_tour())]
    found = depth_findings("room", [f.T_map_cam for f in frames], "camera-to-world", 5000,
                           frames.__getitem__)  # fmt: skip
    assert f"--depth-scale {right} would work" in str(found.error)


@pytest.mark.parametrize(("scale", "told"), [(1000.0, True), (50000.0, True), (5000.0, False)])
def test_a_run_too_short_to_compare_tells_an_unusual_depth(tmp_path, scale, told, caplog):
    folder = write(tmp_path / "room", count=3)
    with caplog.at_level(logging.WARNING):
        open_recording(folder, RecordingOptions(depth_scale=scale, up="z"))
    assert (f"m by {scale:g} units a metre; --depth-scale gives another" in caplog.text) == told


@pytest.mark.parametrize("convention", MISREAD)
def test_another_convention_of_poses_is_refused_and_named(tmp_path, room, convention):
    folder = write(tmp_path / "room", MISREAD[convention])
    with pytest.raises(RecordingError, match=f"--pose-convention {convention} would work"):
        open_recording(folder)
    read = open_recording(folder, RecordingOptions(pose_convention=convention))
    assert np.allclose(read.frame(7).T_map_cam, open_recording(room).frame(7).T_map_cam, atol=1e-2)


def test_unknown_conventions_are_refused(room):
    with pytest.raises(RecordingError, match=r"known are .*; did you mean opengl\?"):
        open_recording(room, RecordingOptions(pose_convention="open-gl"))


def test_poses_by_file_replace_the_recordings_own(room, tmp_path):
    moved = [T.copy() for T in round_tour()]
    for T in moved:
        T[0, 3] += 0.5
    poses = tmp_path / "poses.txt"
    lines = [pose_line(1e9 + n, T) for n, T in enumerate(moved)]
    poses.write_text("\n".join(lines) + "\n")
    read = open_recording(room, RecordingOptions(poses=poses))
    assert np.allclose(read.listing.entries[3].T_world_cam, moved[3], atol=1e-6)
    poses.write_text("\n".join(lines[:-5]) + "\n")
    with pytest.raises(RecordingError, match="a pose for 35 of 40 frames"):
        open_recording(room, RecordingOptions(poses=poses))


def test_depth_that_is_not_registered_is_warned_of(shared, tmp_path, caplog):
    kitchen = shared("data/rgbd/redkitchen")
    for n in range(0, 1000, 16):
        stem = f"frame-{n:06d}"
        shutil.copy(kitchen / f"{stem}.color.jpg", tmp_path)
        shutil.copy(kitchen / f"{stem}.depth.png", tmp_path / f"{stem}.depthreg.png")
        shutil.copy(kitchen / f"{stem}.depth.png", tmp_path)
        shutil.copy(kitchen / f"{stem}.posecolor.txt", tmp_path)
        shutil.copy(kitchen / f"{stem}.posecolor.txt", tmp_path / f"{stem}.pose.txt")
    for name in ("color-intrinsics.txt", "camera-intrinsics.txt", "gravity-direction.txt"):
        shutil.copy(kitchen / name, tmp_path)
    with caplog.at_level(logging.WARNING):
        open_recording(tmp_path)
    (record,) = caplog.records
    assert "not registered to colour" in record.message
