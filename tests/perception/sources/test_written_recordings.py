"""What the real recordings do not have: lens distortion, other sizes, other files."""

import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from perception.camera.intrinsics import intrinsics_from_matrix, load_intrinsics
from perception.camera.poses import quaternion_from_pose
from perception.frames import Frame
from perception.sources.recording import FolderRecording, open_recording
from perception.sources.recording_options import RecordingOptions
from tests.perception.conftest import K


def opened(folder: Path, **options: Any) -> FolderRecording:
    return open_recording(folder, RecordingOptions(T_map_world=np.eye(4), **options))


def first_frame(folder: Path, **options: Any) -> Frame:
    return next(opened(folder, **options).frames())


def points(frame: Frame) -> np.ndarray:
    """(n, 3) [m] in the map."""
    v, u = np.nonzero(np.isfinite(frame.depth))
    p = np.linalg.inv(frame.K) @ np.stack([u, v, np.ones_like(u)]) * frame.depth[v, u]
    return (frame.T_map_cam[:3, :3] @ p + frame.T_map_cam[:3, 3:]).T


def on_walls(p: np.ndarray) -> np.ndarray:
    """(n,) distance [m] of each point to the nearest surface of the written room."""
    planes = [(0, -2.0), (0, 2.0), (1, -1.5), (1, 2.5), (2, 0.0), (2, 2.4)]
    return np.min([np.abs(p[:, axis] - at) for axis, at in planes], axis=0)


def test_hololens_frames_come_in_number_order_with_their_poses(hololens):
    frames = list(opened(hololens()).frames())
    assert [frame.id for frame in frames] == ["8", "9", "10", "11", "12", "13"]
    assert [int(frame.rgb[0, 0, 0]) for frame in frames] == [10, 11, 12, 13, 14, 15]
    assert all(on_walls(points(frame)).max() < 0.01 for frame in frames)


def test_depth_of_half_the_size_is_brought_to_the_colour_image(hololens):
    frame = first_frame(hololens(depth_step=2))
    assert frame.depth.shape == frame.rgb.shape[:2]
    assert np.median(on_walls(points(frame))) < 0.02


def test_intrinsics_of_a_larger_image_are_scaled_to_the_images(hololens, write_json):
    folder = hololens()
    (folder / "K.txt").unlink()
    card = {"width": 320, "height": 240, "fx": 260, "fy": 260, "cx": 159.5, "cy": 119.5}
    write_json(folder / "intrinsics.json", card)
    frame = first_frame(folder)
    np.testing.assert_allclose(frame.K, K, atol=1e-9)
    assert on_walls(points(frame)).max() < 0.01


def test_open3d_intrinsics_and_colour_folder_are_read(hololens, write_json, room_views):
    folder = hololens()
    (folder / "images").rename(folder / "color")
    (folder / "poses.txt").unlink()
    (folder / "K.txt").unlink()
    column_major = [130.0, 0, 0, 0, 130.0, 0, 79.5, 59.5, 1]
    card = {"width": 160, "height": 120, "intrinsic_matrix": column_major}
    write_json(folder / "camera_intrinsic.json", card)
    rows = ["\n".join(" ".join(map(str, row)) for row in T) for T in room_views]
    log = "".join(f"{i} {i} {i + 1}\n{row}\n" for i, row in enumerate(rows))
    (folder / "trajectory.log").write_text(log)
    recording = opened(folder)
    assert recording.format == "trajectory-log"
    assert all(on_walls(points(frame)).max() < 0.01 for frame in recording.frames())


def test_given_intrinsics_and_depth_scale_win_over_the_folder(hololens):
    folder = hololens()
    np.savetxt(folder / "K.txt", K * [[2], [2], [1]])
    frame = first_frame(folder, intrinsics=intrinsics_from_matrix(K, "test"), depth_scale=500)
    np.testing.assert_allclose(frame.K, K)
    z = cv2.imread(str(folder / "depth" / "8.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_allclose(frame.depth, z / 500, rtol=1e-6)


def test_saturated_and_zero_depth_are_no_return(hololens):
    folder = hololens()
    path = str(folder / "depth" / "8.png")
    z = cv2.imread(path, cv2.IMREAD_UNCHANGED)
    z[3, 4], z[5, 6] = 0, 65535
    cv2.imwrite(path, z)
    depth = first_frame(folder).depth
    assert np.isnan(depth[3, 4])
    assert np.isnan(depth[5, 6])
    assert np.isfinite(depth).sum() == depth.size - 2


def brown_conrady(rays: np.ndarray) -> tuple[np.ndarray, dict]:
    """Pixels (n, 2) of rays (n, 3) by radial and tangential distortion, and its card."""
    dist = [0.2, -0.3, 0.002, -0.001, 0.1]
    seen, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), K, np.array(dist))
    return seen[:, 0], {"dist": dist}


def kannala_brandt(rays: np.ndarray) -> tuple[np.ndarray, dict]:
    """Pixels (n, 2) of rays (n, 3) by the angle to the axis (PAMI 2006, equation 6)."""
    dist = [0.05, -0.02, 0.01, -0.003]
    radius = np.linalg.norm(rays[:, :2], axis=1)
    angle = np.arctan(radius)
    bent = angle * (1 + sum(k * angle ** (2 * i + 2) for i, k in enumerate(dist)))
    seen = rays[:, :2] * (bent / radius)[:, None] * 130.0 + K[:2, 2]
    return seen, {"dist": dist, "distortion_model": "equidistant"}


@pytest.mark.parametrize("model", [brown_conrady, kannala_brandt])
def test_lens_distortion_is_undone_in_colour_and_depth(hololens, write_json, model):
    folder = hololens()
    (folder / "K.txt").unlink()
    pinhole = np.array([[30.0, 25], [130, 30], [80, 60], [40, 95], [120, 90]])  # [px]
    rays = np.c_[(pinhole - K[:2, 2]) / 130.0, np.ones(len(pinhole))]
    seen, card = model(rays)
    write_json(folder / "intrinsics.json", {"fx": 130, "fy": 130, "cx": 79.5, "cy": 59.5, **card})
    image = np.zeros((120, 160, 3), np.uint8)
    depth = np.full((120, 160), 2000, np.uint16)
    for x, y in seen:
        cv2.circle(image, (round(x * 16), round(y * 16)), 48, (255, 255, 255), -1, shift=4)
        cv2.circle(depth, (round(x), round(y)), 3, 1500, -1)
    cv2.imwrite(str(folder / "images" / "8.png"), image)
    cv2.imwrite(str(folder / "depth" / "8.png"), depth)
    frame = first_frame(folder)
    for x, y in pinhole:
        column, row = int(x), int(y)
        patch = frame.rgb[row - 8 : row + 9, column - 8 : column + 9, 0].astype(float)
        dy, dx = np.mgrid[-8:9, -8:9]
        offset = np.array([(patch * dx).sum(), (patch * dy).sum()]) / patch.sum()
        assert np.abs(offset).max() < 0.6
        assert frame.depth[row, column] == pytest.approx(1.5)
    left = set(frame.depth[np.isfinite(frame.depth)].tolist())
    assert left <= {1.5, 2.0}, "depth is never averaged across an edge"


@pytest.fixture
def tum_folder(hololens, room_views):
    """The room as TUM lists, with depth 8 ms after colour and poses every 40 ms."""
    folder = hololens()
    shutil.move(folder / "images", folder / "rgb")
    (folder / "poses.txt").unlink()
    stamps = [1e9 + 0.08 * i for i in range(6)]
    for name, shift in (("rgb", 0.0), ("depth", 0.008)):
        lines = [f"{t + shift:.6f} {name}/{8 + i}.png" for i, t in enumerate(stamps)]
        (folder / f"{name}.txt").write_text("# stamp file\n" + "\n".join(lines))
    rows = [
        (t, *T[:3, 3], *quaternion_from_pose(T)) for t, T in zip(stamps, room_views, strict=True)
    ]
    np.savetxt(folder / "groundtruth.txt", rows, "%.9f")
    return folder


def test_tum_lists_are_associated_by_nearest_stamp(tum_folder):
    frames = list(opened(tum_folder, depth_scale=1000).frames())
    assert [frame.id for frame in frames] == ["8", "9", "10", "11", "12", "13"]
    assert frames[0].stamp == pytest.approx(1e9), "stamps since 1970 stay as they are"
    assert all(on_walls(points(frame)).max() < 0.01 for frame in frames)


def test_tum_poses_are_interpolated_between_neighbours(tum_folder):
    lines = (tum_folder / "rgb.txt").read_text().splitlines()
    lines[1] = f"{1e9 + 0.02:.6f} rgb/8.png"
    (tum_folder / "rgb.txt").write_text("\n".join(lines))
    frame = first_frame(tum_folder)
    assert frame.T_map_cam[:3, 3] == pytest.approx([-0.45, 0, 1.4], abs=1e-6)


def test_tum_images_outside_the_trajectory_are_skipped_and_said_so(tum_folder, caplog):
    poses = (tum_folder / "groundtruth.txt").read_text().splitlines()
    (tum_folder / "groundtruth.txt").write_text("\n".join(poses[2:]))
    recording = opened(tum_folder)
    assert [frame.id for frame in recording.frames()] == ["10", "11", "12", "13"]
    assert "2 of 6 images have no pose" in caplog.text


def test_tum_depth_has_5000_units_a_metre_unless_said_otherwise(tum_folder):
    z = cv2.imread(str(tum_folder / "depth" / "8.png"), cv2.IMREAD_UNCHANGED)
    frame = first_frame(tum_folder)
    np.testing.assert_allclose(frame.depth, z / 5000, rtol=1e-6)


@pytest.mark.parametrize("name", ["rgbd_dataset_freiburg3_office", "fr3-desk", "tum_fr3_rpy"])
def test_benchmark_cameras_are_known_by_name(tum_folder, name):
    folder = tum_folder.rename(tum_folder.parent / name)
    (folder / "K.txt").unlink()
    frame = first_frame(folder)
    assert frame.K[0, 0] == pytest.approx(535.4 / 4)


def test_intrinsics_text_forms(tmp_path):
    path = tmp_path / "intrinsics.txt"
    path.write_text("# fx fy cx cy factor width height\n528.4 528.4 317.0 238.6 1000 640 480\n")
    camera = load_intrinsics(path)
    assert (camera.fx, camera.cy, camera.depth_scale, camera.width) == (528.4, 238.6, 1000, 640)
    path.write_text("528.4 0 317.0\n0 528.4 238.6\n0 0 1\n")
    np.testing.assert_allclose(load_intrinsics(path).K, camera.K)
