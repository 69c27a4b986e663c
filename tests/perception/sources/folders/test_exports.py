"""Folders as other programs leave them: what is read, and what is named."""

import json
from collections.abc import Callable

import cv2
import numpy as np
import pytest

from kg.model.errors import RecordingError
from perception.camera.intrinsics import load_intrinsics
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions
from tests.perception.conftest import SIZE, K, room_depth
from tests.perception.sources.folders.conftest import CAMERA, STAMPS, Room, line, named, rows, seven

OPTIONS = RecordingOptions(check=False)
BASE = np.array([[0.0, 0, 1, 0.2], [-1, 0, 0, 0], [0, -1, 0, 0.9], [0, 0, 0, 1]])
ORB = """%YAML:1.0
Camera.type: "PinHole"
Camera1.fx: 130.0
Camera1.fy: 130.0
Camera1.cx: 79.5
Camera1.cy: 59.5
Camera1.k1: 0.0
RGBD.DepthMapFactor: 1000.0
"""
ROS = """image_width: 160
image_height: 120
camera_matrix:
  rows: 3
  cols: 3
  data: [130, 0, 79.5, 0, 130, 59.5, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0, 0, 0, 0, 0]
"""


def rtabmap(room: Room, base: bool) -> None:
    room.images("rtabmap_rgb/{t}.jpg", "rtabmap_depth/{t}.png")
    mount = ", ".join(map(str, BASE[:3].ravel()))
    for s in STAMPS:
        text = ROS + f"local_transform:\n   rows: 3\n   cols: 4\n   data: [{mount}]\n"
        room.write(f"rtabmap_calib/{s:.6f}.yaml", text)
    poses = [T @ np.linalg.inv(BASE) if base else T for T in room.views]
    lines = [
        f"{s:.6f} {line([*seven(T), i])}"
        for i, (s, T) in enumerate(zip(STAMPS, poses, strict=True))
    ]
    name = "rtabmap_poses.txt" if base else "rtabmap_camera_poses.txt"
    room.write(name, "#timestamp x y z qx qy qz qw id\n" + "".join(lines))


def bop(room: Room) -> None:
    room.images("rgb/{n:06d}.png", "depth/{n:06d}.png")
    cards = {}
    for i, view in enumerate(room.views):
        T = np.linalg.inv(view)
        cards[str(i)] = {"cam_K": K.ravel().tolist(), "depth_scale": 1.0,
                         "cam_R_w2c": T[:3, :3].ravel().tolist(),
                         "cam_t_w2c": (T[:3, 3] * 1000).tolist()}  # fmt: skip
    room.write("scene_camera.json", json.dumps(cards))


def posed(room: Room) -> None:
    whole = np.eye(4)
    whole[:3, :3] = K
    room.images("{n:05d}.jpg", "{n:05d}.png").poses("{n:05d}.txt")
    room.write("intrinsic.txt", rows(whole))


def seven_scenes(room: Room) -> Room:
    room.images("frame-{n:06d}.color.png", "frame-{n:06d}.depth.png")
    return room.poses("frame-{n:06d}.pose.txt")


def match3d(room: Room) -> None:
    room.write("camera-intrinsics.txt", rows(K))
    room.folder /= "seq-01"
    seven_scenes(room)


def numbered(name: str, numbers) -> None:
    def write(room: Room) -> None:
        room.images("color/{n}.png", "depth/{n}.png").camera()
        room.write(name, "".join(line(numbers(T)) for T in room.views))

    return write


def listed(unit: str, factor: float):
    def write(room: Room) -> None:
        names = f"rgb/{{{unit}}}.png", f"depth/{{{unit}}}.png"
        room.images(*names).camera().write("groundtruth.txt", "".join(room.tum(factor)))
        stamps = [f"{s * factor:.0f}" if factor > 1 else f"{s:.6f}" for s in STAMPS]
        for name, pattern in zip(("rgb", "depth"), names, strict=True):
            lines = [f"{stamp} {named(pattern, i)}\n" for i, stamp in enumerate(stamps)]
            room.write(f"{name}.txt", "".join(lines))

    return write


def in_utf16(room: Room) -> None:
    listed("t", 1)(room)
    for path in room.folder.glob("*.txt"):
        path.write_text(path.read_text(), encoding="utf-16")


def of_apple(room: Room) -> None:
    numbered("poses.txt", np.ravel)(room)
    for path in list(room.folder.rglob("*.png")):
        path.with_name(f"._{path.name}").write_bytes(b"\x00\x05\x16\x07" + bytes(150))


def by_yaml(text: str):
    def write(room: Room) -> None:
        numbered("poses.txt", np.ravel)(room)
        (room.folder / "intrinsics.json").unlink()
        room.write("camera.yaml", text).write("other.yaml", "a: 1\n")

    return write


def csv(room: Room) -> None:
    listed("t", 1)(room)
    (room.folder / "groundtruth.txt").unlink()
    lines = [row.strip().replace(" ", ",") + ",0,0,0\n" for row in room.tum(1e9, w_first=True)]
    room.write("groundtruth.csv", "timestamp,x,y,z,qw,qx,qy,qz,vx,vy,vz\n" + "".join(lines))


def of_pose(pattern: str, write) -> Callable[[Room], object]:
    """Numbered images, and a file of the pose of each."""
    return lambda room: (
        room.images("rgb/{n}.png", "depth/{n}.png").poses(pattern, write=write).camera()
    )


def named_columns(room: Room) -> None:
    listed("t", 1)(room)
    text = (room.folder / "groundtruth.txt").read_text().replace(" ", ";").replace(".", ",")
    (room.folder / "groundtruth.txt").unlink()
    names = "time [s];pos_x [m];pos_y [m];pos_z [m];rot_x;rot_y;rot_z;rot_w\n"
    room.write("groundtruth.csv", names + text)


def lists_of_windows(room: Room) -> None:
    listed("t", 1)(room)
    for name, lost in (("rgb", "C:\\data\\rgb\\"), ("depth", "")):
        text = (room.folder / f"{name}.txt").read_text()
        room.write(f"{name}.txt", text.replace(f"{name}/", lost))


def depth_of(kind: str) -> Callable[[Room], object]:
    """Depth in NPY of whole millimetres, or of floats, by numpy's name of the type."""

    def write(room: Room) -> None:
        of_pose("pose/{n}.txt", rows)(room)
        for path in list((room.folder / "depth").iterdir()):
            depth = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
            depth = depth / 1000 if "f" in kind else depth
            np.save(path.with_suffix(".npy"), depth.astype(kind))
            path.with_suffix(".npy").rename(path.with_suffix(".NPY"))
            path.unlink()

    return write


def renamed(room: Room, folder: str, names: Callable[[int], str]) -> None:
    for path in sorted((room.folder / folder).iterdir()):
        path.rename(path.with_name(names(int(path.stem)) + path.suffix))


def arkit_scenes(room: Room) -> None:
    room.images("lowres_wide/{n}.png", "lowres_depth/{n}.png")
    for folder in ("lowres_wide", "lowres_depth"):
        renamed(room, folder, lambda n: f"42445173_{6845 + n / 30:.5f}")
    for n in range(6):
        room.write(f"lowres_wide_intrinsics/42445173_{n}.pincam", "160 120 130 130 79.5 59.5\n")
    lines = []
    for n, T in enumerate(map(np.linalg.inv, room.views)):
        turn = cv2.Rodrigues(T[:3, :3])[0].ravel()
        lines.append(line([6845 + round(n / 30, 5), *turn, *T[:3, 3]]))
    room.write("lowres_wide.traj", "".join(lines))


def sun3d(room: Room) -> None:
    room.images("image/{n}.png", "depth/{n}.png").write("intrinsics.txt", rows(K))
    for folder, late in (("image", 0), ("depth", 4000)):
        renamed(room, folder, lambda n, late=late: f"{n + 1:07d}-{n * 33333 + late:012d}")
    for path in (room.folder / "depth").iterdir():
        depth = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(str(path), (depth << np.uint16(3)) | (depth >> np.uint16(13)))
    room.write("extrinsics/20130512.txt", rows(np.eye(4)[:3]) * 6)
    room.write("extrinsics/20140808.txt", "".join(rows(T[:3]) for T in room.views))


def redwood(room: Room) -> None:
    room.images("image/{n}.png", "depth/{n}.png").camera()
    for folder, late in (("image", 0), ("depth", 4000)):
        renamed(room, folder, lambda n, late=late: f"{n:07d}-{n * 33333 + late:012d}")
    log = [f"{n} {n} {n + 1}\n" + rows(T) for n, T in enumerate(room.views)]
    room.write("trajectory.log", "".join(log))


def by_info(info: str, suffix: str = ".png") -> Callable[[Room], object]:
    """BundleFusion's names, and its info.txt by another name."""

    def write(room: Room) -> None:
        seven_scenes(room)
        for path in list(room.folder.glob("*.depth.png")):
            depth = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
            path.unlink()
            cv2.imwrite(str(path.with_suffix(suffix)), depth)
        whole = np.eye(4)
        whole[:3, :3] = K
        sizes = "".join(
            f"m_{one}Width = 160\nm_{one}Height = 120\n"
            f"m_calibration{one.title()}Intrinsic = {line(whole)}"
            for one in ("color", "depth")
        )
        room.write(info, sizes + "m_depthShift = 1000\n")

    return write


def kimera(room: Room) -> None:
    room.images("rgb/{t}.png", "depth/{t}.png").camera()
    lines = [row.strip().replace(" ", ",") + "\n" for row in room.tum(1e9, w_first=True)]
    room.write("traj_vio.csv", "#timestamp,x,y,z,qw,qx,qy,qz\n" + "".join(lines))


def eth3d(room: Room) -> None:
    listed("t", 1)(room)
    (room.folder / "intrinsics.json").unlink()
    room.write("calibration.txt", "130 130 79.5 59.5 1000\n")


READ = {
    "ARKitScenes": arkit_scenes,
    "SUN3D": sun3d,
    "Redwood": redwood,
    "3RScan": by_info("_info.txt", ".pgm"),
    "12-Scenes": by_info("../info.txt"),
    "Semantic-NeRF": numbered("traj_w_c.txt", np.ravel),
    "Kimera": kimera,
    "ETH3D": eth3d,
    "a stamp before poses": numbered("poses.txt", lambda T: [1_700_000_000.5, *seven(T)]),
    "a number before poses": numbered("poses.txt", lambda T: [3, *T.ravel()]),
    "pose files as numpy prints them": of_pose("pose/{n}.TXT", lambda T: f"{T[:3]!s}\n"),
    "pose files with decimal commas": of_pose("pose/{n}.csv", lambda T: rows(T).replace(".", ",")),
    "names of columns, semicolons, commas": named_columns,
    "lists of Windows, and without a folder": lists_of_windows,
    "seconds and nanoseconds as names": lambda room: (
        room.images("rgb/{ros}.png", "depth/{ros}.png").poses("pose/{ros}.txt").camera()
    ),
    "depth in NPY, int32": depth_of("<i4"),
    "depth in NPY, big-endian": depth_of(">u2"),
    "depth in NPY, half floats": depth_of("<f2"),
    "RTAB-Map": lambda room: rtabmap(room, base=False),
    "RTAB-Map, poses of the base": lambda room: rtabmap(room, base=True),
    "BOP": bop,
    "posed images": posed,
    "3DMatch": match3d,
    "poses of 7 numbers": numbered("poses.txt", seven),
    "poses of 12 numbers": numbered("poses.txt", lambda T: T[:3].ravel()),
    "pose.txt": numbered("pose.txt", seven),
    "nanoseconds": listed("ns", 1e9),
    "milliseconds": listed("ms", 1e3),
    "microseconds in lists": listed("t", 1e6),
    "UTF-16": in_utf16,
    "AppleDouble": of_apple,
    "ORB-SLAM's YAML": by_yaml(ORB),
    "ROS' YAML": by_yaml(ROS),
    "EuRoC's CSV": csv,
}


@pytest.mark.parametrize("layout", READ)
def test_folders_of_other_programs_are_read_as_they_are(room, layout):
    READ[layout](room)
    recording = open_recording(room.folder, OPTIONS)
    assert len(recording) == 6
    for i, T in enumerate(room.views):
        frame, entry = recording.frame(i), recording.listing.entries[i]
        np.testing.assert_allclose(entry.T_world_cam, T, atol=1e-5)
        np.testing.assert_allclose(frame.depth, room_depth(T, K, SIZE), atol=2e-3)
        assert abs(int(frame.rgb[0, 0, 0]) - i) <= 1
        np.testing.assert_allclose(frame.K, K, atol=0.01)
    steps = np.diff([e.stamp for e in recording.listing.entries])
    np.testing.assert_allclose(steps, 0.1 if recording.start_time == 0 else 1 / 30, atol=1e-5)


LENS = (-0.07, 0.02, 0.0005, -0.0005)
CARDS = {
    "k1 in JSON": ("a.json", json.dumps({**CAMERA, **dict(zip(("k1", "k2", "p1", "p2"), LENS,
                                                             strict=True))})),
    "coeffs and ppx": ("a.json", json.dumps({"fx": 130, "fy": 130, "ppx": 79.5, "ppy": 59.5,
                                             "coeffs": LENS})),
    "a group, ROS' matrix": ("a.json", json.dumps({"color": {
        "K": K.tolist(), "distortion_coefficients": {"rows": 1, "cols": 4, "data": LENS}}})),
    "Kalibr": ("a.yaml", "cam0:\n  distortion_coeffs: [" + ", ".join(map(str, LENS)) + "]\n"
               "  distortion_model: radtan\n  intrinsics: [130, 130, 79.5, 59.5]\n"),
    "SplaTAM": ("a.yaml", "camera_params:\n  fx: 130\n  fy: 130 # px\n  cx: 79.5\n  cy: 59.5\n"
                f"  distortion: {list(LENS)}\n"),
    "a message of ROS 2": ("a.yaml", "---\nd:\n" + "".join(f"- {x}\n" for x in LENS) + "k:\n"
                           + "".join(f"- {x}\n" for x in K.ravel())),
}  # fmt: skip


@pytest.mark.parametrize("card", CARDS)
def test_a_lens_is_read_by_the_names_that_programs_have(tmp_path, card):
    name, text = CARDS[card]
    (tmp_path / name).write_bytes(b"\xef\xbb\xbf" + text.encode())
    camera = load_intrinsics(tmp_path / name)
    np.testing.assert_allclose(camera.K, K)
    assert camera.dist[:4] == LENS and not camera.fisheye


def test_all_four_numbers_of_a_fisheye_are_read(tmp_path):
    lens = "Camera.type: KannalaBrandt8\n" + "".join(f"Camera1.k{i}: 0.{i}\n" for i in range(1, 5))
    (tmp_path / "a.yaml").write_text(ORB.replace("Camera1.k1: 0.0\n", lens).replace(
        'Camera.type: "PinHole"\n', ""))  # fmt: skip
    camera = load_intrinsics(tmp_path / "a.yaml")
    assert camera.fisheye and camera.dist == (0.1, 0.2, 0.3, 0.4)


def test_a_file_of_two_cameras_is_refused(tmp_path):
    both = {"left": CAMERA, "right": {**CAMERA, "fx": 140}}
    (tmp_path / "a.json").write_text(json.dumps(both))
    with pytest.raises(RecordingError, match=r"several cameras; a file of colour's alone"):
        load_intrinsics(tmp_path / "a.json")


def test_a_camera_one_folder_above_is_read_and_told(room, caplog):
    numbered("poses.txt", seven)(room)
    (room.folder / "intrinsics.json").rename(room.folder.parent / "intrinsics.json")
    np.testing.assert_allclose(open_recording(room.folder, OPTIONS).frame(0).K, K, atol=0.01)
    assert "intrinsics.json, one folder above" in caplog.text


def test_poses_of_key_frames_are_read_and_told(room, caplog):
    listed("t", 1)(room)
    (room.folder / "groundtruth.txt").unlink()
    keys = room.folder.parent / "keys.txt"
    keys.write_text("".join(room.tum()[::3]))
    recording = open_recording(room.folder, RecordingOptions(check=False, poses=keys))
    assert [e.stamp for e in recording.listing.entries] == STAMPS[::3]
    assert "poses of 2 of 6 frames, as of key frames" in caplog.text


def test_depth_may_be_said_to_be_registered(room):
    seven_scenes(room).write("mine.json", json.dumps(CAMERA))
    camera = load_intrinsics(room.folder / "mine.json")
    options = RecordingOptions(check=False, intrinsics=camera, registered=True)
    frame = open_recording(room.folder, options).frame(1)
    np.testing.assert_allclose(frame.depth, room_depth(room.views[1], K, SIZE), atol=2e-3)


@pytest.mark.parametrize("name", ["depth/0.png", "poses.txt", "intrinsics.json"])
def test_pointers_of_git_lfs_are_named(room, name):
    numbered("poses.txt", seven)(room)
    room.write(name, "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 61234\n")
    with pytest.raises(RecordingError, match=r"is a Git LFS pointer, .* `git lfs pull`"):
        open_recording(room.folder, OPTIONS)


def test_depth_that_is_disparity_is_read_with_the_baseline(room):
    of_pose("pose/{n}.txt", rows)(room)
    for path in (room.folder / "depth").iterdir():
        depth = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) / 1000
        cv2.imwrite(str(path), np.rint(130 * 0.12 / depth * 256).astype(np.uint16))
    options = RecordingOptions(check=False, disparity=0.12, depth_scale=256)
    for frame, T in zip(open_recording(room.folder, options).frames(), room.views, strict=True):
        np.testing.assert_allclose(frame.depth, room_depth(T, K, SIZE), rtol=0.01)


@pytest.mark.parametrize(
    ("name", "advice"),
    [("matterport_color_images/a.jpg", "pose/"), ("mav0/cam0/data/1.png", "stereo matching"),
     ("images.h5", "NPY"), ("frame_00000.json", "3D Scanner App"), ("cameras.bin", "transforms")],
)  # fmt: skip
def test_folders_that_are_not_read_name_the_conversion(room, name, advice):
    room.write(name, b"1")
    with pytest.raises(RecordingError, match=advice):
        open_recording(room.folder, OPTIONS)
