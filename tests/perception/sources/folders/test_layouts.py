"""Layouts of data sets, of programs and of Windows: the room written as they have it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from kg.model.errors import RecordingError
from perception.camera.poses import quaternion_from_pose
from perception.sources.recording import FolderRecording, open_recording
from perception.sources.recording_options import RecordingOptions
from tests.perception.conftest import SIZE, K

OPTIONS = RecordingOptions(T_map_world=np.eye(4), check=False)
CAMERA = np.eye(4)
CAMERA[:3, :3] = K


@pytest.fixture
def room(hololens) -> Path:
    """Images 8 to 13 of colour and depth [mm], without poses and without a camera."""
    folder = hololens()
    for name in ("poses.txt", "K.txt"):
        (folder / name).unlink()
    return folder


def rows(T: np.ndarray) -> str:
    return "\n".join(" ".join(f"{x:.9f}" for x in row) for row in T) + "\n"


def one_line(T: np.ndarray) -> str:
    return rows(T).replace("\n", " ").strip()


def tum_pose(stamp: float, T: np.ndarray) -> str:
    numbers = (*T[:3, 3], *quaternion_from_pose(T))
    return " ".join([f"{stamp:.6f}", *(f"{x:.9f}" for x in numbers)])


def check_poses(read: FolderRecording, views: list[np.ndarray]) -> None:
    for frame, T in zip(read.frames(), views, strict=True):
        np.testing.assert_allclose(frame.T_map_cam, T, atol=1e-6)
        np.testing.assert_allclose(frame.K, K)
        assert np.nanmedian(frame.depth) > 1.0, "metres"


def test_a_file_of_a_pose_for_each_image_as_scannet_has_it(room, room_views, caplog):
    shutil.move(room / "images", room / "color")
    (room / "pose").mkdir()
    (room / "intrinsic").mkdir()
    (room / "intrinsic/intrinsic_color.txt").write_text(rows(CAMERA))
    for number, T in enumerate(room_views, 8):
        lost = np.full((4, 4), -np.inf)
        (room / f"pose/{number}.txt").write_text(rows(lost if number == 10 else T))
    read = open_recording(room, OPTIONS)
    assert read.format == "pose-files"
    check_poses(read, [*room_views[:2], *room_views[3:]])
    assert "1 of 6 images have no pose" in caplog.text


@pytest.mark.parametrize("suffix", [".npy", ".tiff"])
def test_depth_may_be_floats_in_metres(room, room_views, write_json, suffix):
    (room / "poses").mkdir()
    write_json(room / "intrinsics.json", {"intrinsic_matrix": K.T.ravel().tolist()})
    for number, T in enumerate(room_views, 8):
        (room / f"poses/frame{number:04d}.txt").write_text(one_line(T))
        old = room / f"depth/{number}.png"
        z = cv2.imread(str(old), cv2.IMREAD_UNCHANGED).astype(np.float32) / 1000
        z[0, 0] = np.nan
        if suffix == ".npy":
            np.save(room / f"depth/{number}.npy", z)
        else:
            cv2.imwrite(str(room / f"depth/{number}.tiff"), z)
        old.unlink()
    read = open_recording(room, OPTIONS)
    check_poses(read, room_views)
    assert np.isnan(read.frame(0).depth[0, 0])


@pytest.mark.parametrize(
    "content",
    [
        b"\x93NUMPY\x01\x00v\x00" + b"{'descr': '<f4', 'fortran_order': False, 'shape': (9, 9)}",
        b"\x93NUMPY\x09\x00\x02\x00{}",
        b"\x93NUMPY",
    ],
)
def test_damaged_npy_is_said(room, room_views, write_json, content):
    (room / "poses").mkdir()
    write_json(room / "intrinsics.json", {"intrinsic_matrix": K.T.ravel().tolist()})
    for number, T in enumerate(room_views, 8):
        (room / f"poses/{number}.txt").write_text(one_line(T))
        (room / f"depth/{number}.png").unlink()
        (room / f"depth/{number}.npy").write_bytes(content)
    with pytest.raises(RecordingError, match=r"8\.npy"):
        open_recording(room, OPTIONS)


def test_pickles_in_npy_are_not_loaded(room, room_views, write_json):
    (room / "poses").mkdir()
    write_json(room / "intrinsics.json", {"intrinsic_matrix": K.T.ravel().tolist()})
    for number, T in enumerate(room_views, 8):
        (room / f"poses/{number}.txt").write_text(one_line(T))
        (room / f"depth/{number}.png").unlink()
        np.save(room / f"depth/{number}.npy", np.array([{}, []], object), allow_pickle=True)
    with pytest.raises(RecordingError, match=r"8\.npy is no NPY file of depth"):
        open_recording(room, OPTIONS)


def test_replica_has_images_of_both_in_one_folder_and_the_camera_beside(room, room_views):
    (room / "results").mkdir()
    for number in range(8, 14):
        z = cv2.imread(str(room / f"depth/{number}.png"), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(str(room / f"results/depth{number:06d}.png"), (z * 6.5535).astype(np.uint16))
        (room / f"images/{number}.png").rename(room / f"results/frame{number:06d}.png")
    shutil.rmtree(room / "images")
    shutil.rmtree(room / "depth")
    (room / "traj.txt").write_text("\n".join(map(one_line, room_views)))
    camera = {"w": SIZE[0], "h": SIZE[1], "fx": K[0, 0], "fy": K[1, 1], "cx": K[0, 2],
              "cy": K[1, 2], "scale": 6553.5}  # fmt: skip
    (room.parent / "cam_params.json").write_text(json.dumps({"camera": camera}))
    read = open_recording(room, OPTIONS)
    assert (read.format, read.depth_scale) == ("replica", 6553.5)
    check_poses(read, room_views)


@pytest.mark.parametrize("ratio", [1.0, 1.1])
def test_info_txt_has_the_cameras_of_bundle_fusion(room, room_views, ratio):
    for number, T in enumerate(room_views, 8):
        (room / f"images/{number}.png").rename(room / f"frame-{number:06d}.color.png")
        (room / f"depth/{number}.png").rename(room / f"frame-{number:06d}.depth.png")
        lost = np.full((4, 4), -np.inf)
        (room / f"frame-{number:06d}.pose.txt").write_text(rows(lost if number == 8 else T))
    deep = CAMERA.copy()
    deep[:2, :2] *= ratio
    (room / "info.txt").write_text(
        f"m_versionNumber = 4\nm_sensorName = StructureSensor\nm_colorWidth = {SIZE[0]}\n"
        f"m_colorHeight = {SIZE[1]}\nm_depthWidth = {SIZE[0]}\nm_depthHeight = {SIZE[1]}\n"
        "m_depthShift = 1000\n"
        f"m_calibrationColorIntrinsic = {one_line(CAMERA)}\n"
        f"m_calibrationDepthIntrinsic = {one_line(deep)}\n"
    )
    read = open_recording(room, OPTIONS)
    check_poses(read, room_views[1:])
    assert (read.listing.depth_camera is None) == (ratio == 1.0)


@pytest.mark.parametrize("line", ["m_depthShift = nan", "m_colorWidth =", "m_depthWidth = wide"])
def test_malformed_info_txt_is_said(room, room_views, line):
    for number, T in enumerate(room_views, 8):
        (room / f"images/{number}.png").rename(room / f"frame-{number:06d}.color.png")
        (room / f"depth/{number}.png").rename(room / f"frame-{number:06d}.depth.png")
        (room / f"frame-{number:06d}.pose.txt").write_text(rows(T))
    camera = one_line(CAMERA)
    lines = {"m_colorWidth": "160", "m_colorHeight": "120", "m_depthWidth": "160",
             "m_depthHeight": "120", "m_depthShift": "1000",
             "m_calibrationColorIntrinsic": camera,
             "m_calibrationDepthIntrinsic": camera}  # fmt: skip
    key, _, value = line.partition(" =")
    text = "\n".join(f"{k} = {v}" for k, v in (lines | {key: value}).items())
    (room / "info.txt").write_text(text)
    with pytest.raises(RecordingError, match=rf"info\.txt.*{key}"):
        open_recording(room, OPTIONS)


def tum(room: Path, views: list[np.ndarray], name: str = "{stamp}.png", line: str = "\n") -> Path:
    """The room with stamps as names, and its poses and camera; returns rgb/."""
    shutil.move(room / "images", room / "rgb")
    (room / "K.txt").write_text(rows(K))
    poses = []
    for number, T in enumerate(views, 8):
        stamp = 1.7e9 + number
        (room / f"rgb/{number}.png").rename(room / "rgb" / name.format(stamp=f"{stamp:.6f}"))
        (room / f"depth/{number}.png").rename(room / f"depth/{stamp:.6f}.png")
        poses.append(tum_pose(stamp, T))
    (room / "groundtruth.txt").write_text(line.join(poses), newline="")
    return room / "rgb"


TUM_OPTIONS = RecordingOptions(T_map_world=np.eye(4), check=False, depth_scale=1000)


def test_lists_of_windows_and_names_with_spaces(room, room_views):
    rgb = tum(room, room_views, "image {stamp}.png", "\r\n")
    for folder, name in ((rgb, "rgb"), (room / "depth", "depth")):
        files = sorted(folder.iterdir())
        lines = [f"{file.stem.split()[-1]} {name}/{file.name}" for file in files]
        text = "\ufeff# stamp file\r\n" + "\r\n".join(lines)
        (room / f"{name}.txt").write_text(text, encoding="utf-8", newline="")
    check_poses(open_recording(room, TUM_OPTIONS), room_views)


def test_depth_may_come_first_in_associations_as_in_icl_nuim(room, room_views):
    rgb = tum(room, room_views)
    (room / "groundtruth.txt").rename(room / "livingRoom0.gt.freiburg")
    lines = [f"{f.stem} depth/{f.name} {f.stem} rgb/{f.name}" for f in sorted(rgb.iterdir())]
    (room / "associations.txt").write_text("\n".join(lines))
    check_poses(open_recording(room, TUM_OPTIONS), room_views)


def test_poses_of_tum_without_lists_are_not_overlooked(room, room_views):
    tum(room, room_views)
    read = open_recording(room, TUM_OPTIONS)
    assert read.format == "tum"
    check_poses(read, room_views)


def test_poses_of_tum_beside_images_without_stamps_are_refused(room, room_views):
    tum(room, room_views)
    for number, file in enumerate(sorted((room / "rgb").iterdir())):
        file.rename(room / f"rgb/{number}.png")
    with pytest.raises(RecordingError, match="no stamps as names"):
        open_recording(room, TUM_OPTIONS)


def test_open3ds_intrinsic_json_is_found(room, room_views, write_json):
    write_json(room / "intrinsic.json", {"intrinsic_matrix": K.T.ravel().tolist()})
    (room / "poses.txt").write_text("\n".join(map(one_line, room_views)))
    check_poses(open_recording(room, OPTIONS), room_views)


def test_a_pose_may_take_four_lines(room, room_views):
    (room / "K.txt").write_text(rows(K))
    (room / "poses.txt").write_text("".join(map(rows, room_views)))
    check_poses(open_recording(room, OPTIONS), room_views)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("room.sens", "SensReader"),
        ("room.svo2", "ZED"),
        ("kinect.mkv", "azure_kinect_mkv_reader.py"),
        ("room.tar.gz", "unpack"),
        ("room.mp4", "no depth"),
        ("lowres_wide.traj", "ARKitScenes"),
    ],
)
def test_files_of_other_programs_are_named_with_the_way_to_convert_them(tmp_path, name, said):
    file = tmp_path / "recording" / name
    file.parent.mkdir()
    file.write_bytes(b"x" * 64)
    for path in (file, file.parent):
        with pytest.raises(RecordingError, match=said):
            open_recording(path)


def test_colour_without_depth_is_said(room):
    shutil.rmtree(room / "depth")
    with pytest.raises(RecordingError, match="has images/, but no depth/"):
        open_recording(room)
