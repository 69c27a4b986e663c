"""Recordings that are damaged, incomplete or nonsense are refused in one helpful line."""

import functools
import os
import struct
import zlib

import cv2
import numpy as np
import pytest

from kg.model.errors import RecordingError
from perception.camera.intrinsics import load_intrinsics
from perception.sources.folders.image_files import read_colour
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions


def refusal(path, *, opened: bool = False, **options) -> str:
    """The one line with which opening (or, unless `opened`, reading) the recording is refused."""
    options.setdefault("T_map_world", np.eye(4))
    with pytest.raises(RecordingError) as caught:
        recording = open_recording(path, RecordingOptions(**options))
        list([] if opened else recording.frames())
    assert "\n" not in str(caught.value)
    return str(caught.value)


refusal_at_opening = functools.partial(refusal, opened=True)


def test_folders_that_are_no_recording(tmp_path):
    assert "does not exist" in refusal_at_opening(tmp_path / "nowhere")
    assert "is empty" in refusal_at_opening(tmp_path)
    (tmp_path / "holiday.txt").write_text("sun")
    assert "no recording of a known format" in refusal_at_opening(tmp_path / "holiday.txt")
    message = refusal_at_opening(tmp_path)
    for name in ("7scenes", "tum", "trajectory-log", "hololens", "groundtruth.txt", "poses.txt"):
        assert name in message


def test_a_recording_one_folder_deeper_is_pointed_at(hololens):
    folder = hololens()
    (folder.parent / "colours").mkdir()
    (folder.parent / "colours" / "rgb.txt").write_text("255 250 250 snow")  # no list of images
    assert f"open {folder}" in refusal_at_opening(folder.parent)
    for name in ("a.mcap", "b.mcap"):
        (folder.parent / name).write_bytes(b"\x89MCAP0\r\n")
    assert "holds 3 recordings, a.mcap, b.mcap, " in refusal_at_opening(folder.parent)


def test_unknown_format_lists_the_known_ones(hololens):
    message = refusal_at_opening(hololens(), format="tumm")
    assert "did you mean tum?" in message
    assert "trajectory-log" in message


@pytest.mark.parametrize("format_", ["7scenes", "tum", "trajectory-log"])
def test_a_folder_of_another_format_is_refused(hololens, format_):
    assert "room" in refusal_at_opening(hololens(), format=format_)


@pytest.mark.parametrize(
    ("suffixes", "missing", "said"),
    [
        ((".depthreg.png", ".posecolor.txt"), "000768.depthreg.png", "frame-000768.depthreg.png"),
        ((".depth.png", ".pose.txt"), "000240.depth.png", "frame-000240.depth.png"),
    ],
)
def test_what_one_frame_lacks_is_named(few_frames, suffixes, missing, said):
    folder = few_frames(".color.jpg", *suffixes)
    (folder / f"frame-{missing}").unlink()
    assert said in refusal_at_opening(folder)


def test_poses_that_are_missing_are_told(hololens):
    folder = hololens()
    rows = (folder / "poses.txt").read_text().splitlines()
    (folder / "poses.txt").write_text("\n".join(rows[:-1]))
    assert "6 colour images, 6 depth images and 5 poses" in refusal_at_opening(folder)
    (folder / "images" / "9.png").unlink()
    (folder / "depth" / "11.png").unlink()
    assert "5 colour images, 5 depth images and 5 poses" in refusal_at_opening(folder)
    (folder / "poses.txt").unlink()
    assert "poses.txt is missing" in refusal_at_opening(folder, format="hololens")


def test_an_image_without_pose_in_the_log_is_named(shared, tmp_path):
    source = shared("data/rgbd/icl_livingroom")
    for name in ("image", "depth", "intrinsics.json"):
        (tmp_path / name).symlink_to(source / name)
    log = (source / "trajectory.log").read_text().splitlines()
    (tmp_path / "trajectory.log").write_text("\n".join(log[:5] + log[10:]))
    assert "no pose for image 3" in refusal_at_opening(tmp_path)
    (tmp_path / "trajectory.log").write_text("\n".join(log[:8]))
    assert "four rows" in refusal_at_opening(tmp_path)


@pytest.mark.parametrize(
    ("spoil", "complaint"),
    [
        (lambda T: T.__setitem__(slice(3), T[:3] * 1.1), "not rigid"),
        (lambda T: T.__setitem__((0, 3), 1e308), "from the origin"),
        (lambda T: T.__setitem__((slice(3), 0), -T[:3, 0]), "determinant -1"),
        (lambda T: T.__setitem__(3, [0, 0, 0, 2]), "last row"),
        (lambda T: T.__setitem__(slice(None), 0), "last row"),
    ],
)
def test_poses_that_are_no_rigid_motion(hololens, spoil, complaint):
    folder = hololens()
    rows = np.loadtxt(folder / "poses.txt")
    spoil(rows[2].reshape(4, 4))
    np.savetxt(folder / "poses.txt", rows)
    message = refusal_at_opening(folder)
    assert complaint in message
    assert "poses.txt, line 3" in message


@pytest.mark.parametrize("lost", [np.nan, -np.inf])
def test_frames_whose_poses_were_lost_are_skipped(hololens, lost, caplog):
    folder = hololens()
    count = len(open_recording(folder))
    poses = np.loadtxt(folder / "poses.txt")
    poses[2] = lost
    np.savetxt(folder / "poses.txt", poses)
    assert len(open_recording(folder)) == count - 1
    assert f"1 of {count} images have no pose" in caplog.text
    with_file = RecordingOptions(poses=folder / "poses.txt", T_map_world=np.eye(4), check=False)
    assert len(open_recording(folder, with_file)) == count - 1
    np.savetxt(folder / "poses.txt", np.full_like(poses, lost))
    assert "no frame has a pose" in refusal_at_opening(folder)
    assert "no finite pose" in refusal_at_opening(folder, poses=folder / "poses.txt")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"one two three", "'one' is not a number"),
        (b"1 2 3", "16 numbers"),
        (b"\xff\xfe\x00", "not a text file"),
    ],
)
def test_poses_that_are_no_numbers(hololens, content, said):
    folder = hololens()
    (folder / "poses.txt").write_bytes(content)
    assert said in refusal_at_opening(folder)


def damaged_inside(path) -> None:
    data = bytearray(path.read_bytes())
    data[20:60] = bytes(40)
    path.write_bytes(data)


def pipe(path) -> None:
    path.unlink()
    os.mkfifo(path)


def image(shape, value=0, kind=np.uint16):
    return lambda path: cv2.imwrite(str(path), np.full(shape, value, kind))


@pytest.mark.parametrize(
    ("name", "spoil", "said"),
    [
        *(
            (f"{kind}/11.png", spoil, said)
            for kind in ("images", "depth")
            for spoil, said in (
                (lambda path: path.write_bytes(path.read_bytes()[:99]), "11.png is truncated"),
                (lambda path: path.write_bytes(b""), "neither PNG nor JPEG"),
                (damaged_inside, "11.png"),
                (pipe, "11.png: it is no regular file"),
            )
        ),
        ("depth/8.png", image((120, 160, 3), kind=np.uint8), "one 16-bit channel"),
        ("depth/8.png", image((120, 120), 1000), "not registered"),
        ("images/8.png", lambda path: path.rename(path.with_stem("first")), "first.png"),
        ("images/8.png", lambda path: path.rename(path.with_stem("²")), "²"),
    ],
)
def test_images_that_are_none_are_found_before_anything_is_mapped(hololens, name, spoil, said):
    folder = hololens()
    spoil(folder / name)
    assert said in refusal_at_opening(folder)


def test_a_truncated_jpeg_is_found(few_frames):
    folder = few_frames(".color.jpg", ".depthreg.png", ".posecolor.txt")
    path = folder / "frame-000912.color.jpg"
    whole = path.read_bytes()
    path.unlink()
    path.write_bytes(whole[:9000])
    assert "frame-000912.color.jpg is truncated after 9000 bytes" in refusal_at_opening(folder)


def test_images_of_changing_size(hololens):
    folder = hololens()
    cv2.imwrite(str(folder / "images" / "10.png"), np.zeros((240, 320, 3), np.uint8))
    assert "10.png is 320x240, other images 160x120" in refusal(folder)


def test_missing_intrinsics(hololens):
    folder = hololens()
    (folder / "K.txt").unlink()
    assert "has no intrinsics: a file intrinsics.json in it" in refusal_at_opening(folder)


@pytest.mark.parametrize(
    ("card", "complaint"),
    [
        ({"fx": 0, "fy": 130, "cx": 80, "cy": 60}, "must be positive"),
        ({"fx": -130, "fy": 130, "cx": 80, "cy": 60}, "must be positive"),
        ({"fx": 130, "fy": 130, "cx": 319.5, "cy": 60}, "principal point"),
        ({"fx": 130, "fy": 130, "cx": 80, "cy": 60, "width": 640, "height": 360}, "aspect"),
        ({"fx": 130, "fy": 130, "cx": 80}, "expected JSON"),
        ({"fx": "wide", "fy": 130, "cx": 80, "cy": 60}, "expected JSON"),
        ({"fx": 130, "fy": 130, "cx": 80, "cy": 60, "width": 0, "height": 0}, "size"),
        ({"fx": 130, "fy": 130, "cx": 80, "cy": 60, "dist": [1, 2]}, "4, 5 or 8"),
        ({"fx": 130, "fy": 130, "cx": 80, "cy": 60, "depth_scale": 0}, "depth scale"),
        ({"fx": 0.8, "fy": 1.1, "cx": 0.5, "cy": 0.5}, "field of view"),
        ([1, 2, 3], "expected JSON"),
    ],
)
def test_intrinsics_that_make_no_sense(hololens, write_json, card, complaint):
    folder = hololens()
    (folder / "K.txt").unlink()
    write_json(folder / "intrinsics.json", card)
    assert complaint in refusal_at_opening(folder)


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"depth_scale": -1000}, "depth scale"),
        ({"T_map_world": np.eye(3)}, "given T_map_world"),
        ({"T_map_world": 2 * np.eye(4)}, "given T_map_world"),
        ({"T_map_world": None, "up": "w"}, "up is one of"),
        ({"T_map_world": None, "up": (0, 0, 0)}, "up is one of"),
    ],
)
def test_options_that_make_no_sense(hololens, options, complaint):
    assert complaint in refusal_at_opening(hololens(), **options)


@pytest.mark.parametrize(
    ("poses", "said"),
    [
        (None, "groundtruth.txt or groundtruth_at_rgb.txt is missing"),
        ("# nothing\n", "holds no poses"),
        ("500 0 0 0 0 0 0 1\n", "none of the 250 images has a pose"),
        ("0 0 0 0 0 0 0 0\n", "length 1"),
        ("0 0 0 0 0 0 0\n", "line 1: expected stamp tx"),
        ("0 0 0 0 0 0 0 1\n", "cannot read image"),  # ../redkitchen is not there
    ],
)
def test_tum_lists_that_do_not_fit(shared, tmp_path, poses, said):
    folder = tmp_path / "a"
    folder.mkdir()
    for path in shared("data/rgbd/redkitchen_tum").iterdir():
        (folder / path.name).symlink_to(path)
    (folder / "groundtruth.txt").unlink()
    if poses is not None:
        (folder / "groundtruth.txt").write_text(poses)
    assert said in refusal_at_opening(folder, estimate_poses=None if poses else False)


@pytest.mark.parametrize("first", [1, 1000])
def test_depth_may_count_from_another_number_than_colour(hololens, first):
    folder = hololens()
    for path in sorted((folder / "depth").iterdir(), key=lambda p: -int(p.stem)):
        path.rename(path.with_stem(str(int(path.stem) + first)))
    assert len(open_recording(folder, RecordingOptions(T_map_world=np.eye(4)))) == 6


@pytest.mark.parametrize("side", [60_000, 12_000])  # OpenCV itself refuses the first alone
def test_a_header_that_names_a_huge_image_is_an_error(tmp_path, side):
    header = struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0)
    image = tmp_path / "huge.png"
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(b"\0" * 99)), (b"IEND", b""))
    image.write_bytes(
        b"\x89PNG\r\n\x1a\n"
        + b"".join(
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
            for kind, data in chunks
        )
    )
    with pytest.raises(RecordingError, match="too large a size"):
        read_colour(image)


def test_deeply_nested_json_is_an_error(tmp_path):
    deep = tmp_path / "deep.json"
    deep.write_text("[" * 200_000 + "]" * 200_000)
    with pytest.raises(RecordingError, match="expected JSON"):
        load_intrinsics(deep)
