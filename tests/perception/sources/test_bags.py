"""Bags and MCAP files are read to the bits that were written; damaged ones are refused."""

import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from kg.model.errors import RecordingError
from perception.sources.bag_writer import write_bag
from perception.sources.listing import Streams
from perception.sources.recording import FolderRecording, open_recording
from perception.sources.recording_options import RecordingOptions, Selection
from perception.sources.ros.message_maker import whole_millimetres
from tests.perception.conftest import SIZE, K, room_depth

pytest.importorskip("rosbags")
from perception.sources.bags.bag_file import BagFile
from tests.perception.sources.robot_bags import (
    BEGIN,
    VIEWS,
    Bag,
    View,
    mapped,
    raw_image,
    recorded,
    rgbd_image,
    robot_bag,
)
from tests.perception.sources.ros.test_image_messages import rvl

UNCHECKED = RecordingOptions(check=False)


@pytest.fixture
def source(hololens: Callable[..., Path]) -> FolderRecording:
    return open_recording(hololens(), RecordingOptions(check=False, start_time=float(BEGIN)))


def written(recording: FolderRecording, path: Path) -> Path:
    assert sum(1 for _ in write_bag(recording, path)) == len(recording)
    return path


@pytest.mark.parametrize("name", ["room.bag", "room.mcap", "room-2"])
def test_what_was_written_is_read(source: FolderRecording, tmp_path: Path, name: str) -> None:
    path = written(source, tmp_path / name)
    read = open_recording(path, RecordingOptions(check=False, start_time=float(BEGIN)))
    assert read.name == Path(name).stem
    assert np.array_equal(read.T_map_world, source.T_map_world)
    for ours, theirs in zip(read.frames(), source.frames(), strict=True):
        assert (ours.id, ours.stamp) == (theirs.id, theirs.stamp)
        for array in ("rgb", "depth", "K", "T_map_cam"):
            np.testing.assert_array_equal(getattr(ours, array), getattr(theirs, array))
    np.testing.assert_array_equal(read.frame(4).rgb, source.frame(4).rgb)  # and in any order
    np.testing.assert_array_equal(read.frame(1).depth, source.frame(1).depth)
    assert [p.name for p in tmp_path.iterdir() if p.name.startswith(".")] == []
    again = open_recording(written(read, tmp_path / "again.mcap"), UNCHECKED)
    assert [e.id for e in again.listing.entries] == [e.id for e in source.listing.entries]
    np.testing.assert_array_equal(again.frame(3).depth, source.frame(3).depth)


def test_nothing_is_overwritten_and_nothing_half_written_stays(source, tmp_path):
    path = tmp_path / "room.mcap"
    frames = write_bag(source, path)
    next(frames)
    assert not path.exists()
    frames.close()
    assert [p.name for p in tmp_path.iterdir()] == ["room"]
    path.write_text("mine")
    with pytest.raises(RecordingError, match="exists already"):
        next(write_bag(source, path))
    assert path.read_text() == "mine"
    with pytest.raises(RecordingError, match="there is no folder"):
        next(write_bag(source, tmp_path / "nowhere" / "room.mcap"))


def test_depth_is_millimetres_only_where_that_gives_it_back() -> None:
    raw = np.array([[0, 1, 7001], [65534, 250, 3]], np.uint16)
    depth = raw.astype(np.float32) / np.float32(1000)
    depth[raw == 0] = np.nan
    assert np.array_equal(whole_millimetres(depth), raw)
    for other in (np.float32(1.00004), np.float32(65.535), np.float32(200), np.float32(-1)):
        changed = depth.copy()
        changed[1, 1] = other
        assert whole_millimetres(changed) is None


def test_selected_frames(source: FolderRecording, tmp_path: Path) -> None:
    path = written(source, tmp_path / "room.mcap")

    def ids(**options: Any) -> list[str]:
        read = open_recording(path, RecordingOptions(check=False, selection=Selection(**options)))
        return [frame.id for frame in read.frames()]

    whole = [entry.id for entry in source.listing.entries]
    assert ids() == whole
    assert ids(every=2) == whole[::2]
    assert ids(every=2, limit=2) == whole[:4:2]
    assert ids(start=0.03, stop=0.11) == whole[1:4]


@pytest.mark.parametrize(
    ("name", "options"),
    [("robot.bag", {"ros1": True}), ("mcap-folder", {}), ("sqlite-folder", {"mcap": False})],
)
def test_a_robots_bag_is_read_by_guessed_topics(tmp_path, name, options):
    read = open_recording(robot_bag(tmp_path / name, **options))
    assert read.format == "bag"
    for frame, (i, stamp, T, rgb, mm) in zip(read.frames(), VIEWS, strict=True):
        assert frame.id == f"{BEGIN}.{i}00000000"
        assert frame.stamp == pytest.approx(stamp, abs=1e-6)
        assert np.array_equal(frame.rgb, rgb)
        assert np.array_equal(np.nan_to_num(frame.depth * 1000).round(), mm)
        # z is up already; the floor was found where it is
        assert np.allclose(frame.T_map_cam, T, atol=0.03)


def test_a_folder_without_metadata_and_a_plain_file(tmp_path: Path) -> None:
    folder = robot_bag(tmp_path / "robot")
    (folder / "metadata.yaml").unlink()
    for path in (folder, folder / "robot.mcap"):
        assert len(open_recording(path, UNCHECKED)) == 6


@pytest.mark.parametrize(
    ("skip", "pose"),
    [(("tf", "static"), "/vslam/pose"), (("tf",), None)],
    ids=["of the topic that is named", "of odometry, where tf lacks it"],
)
def test_poses_come_from_topics(tmp_path: Path, skip: tuple[str, ...], pose: str | None) -> None:
    path = robot_bag(tmp_path / "robot", skip=skip)
    options = RecordingOptions(check=False, streams=Streams(pose=pose), up="z")
    assert np.allclose(open_recording(path, options).frame(3).T_map_cam, VIEWS[3].T, atol=0.03)


def test_given_topics_and_frames_are_taken(tmp_path: Path) -> None:
    path = robot_bag(tmp_path / "robot")
    grey = RecordingOptions(check=False, streams=Streams(colour="/cam/ir/image_raw"))
    assert np.array_equal(open_recording(path, grey).frame(2).rgb, VIEWS[2].rgb)
    for streams, said in (
        (Streams(colour="/cam/rgb/image"), "'/cam/rgb/image' is no topic .* did you mean /cam/"),
        (Streams(map_frame="mop"), "no transforms of frame 'mop'"),
        (Streams(tolerance=0.001), r"lie within 0\.001 s.* 0.005 s apart: --tolerance 0.01 would"),
    ):
        with pytest.raises(RecordingError, match=said):
            open_recording(path, RecordingOptions(streams=streams))


def test_stamps_that_fall_behind_are_told_and_no_tolerance_is_advised(tmp_path, caplog):
    def add(made: Bag, view: View) -> None:
        made.images(view)
        made.tf("/tf", view.stamp, "map", "lens", view.T)
        late = view.stamp + 0.05 * view.number
        made.image("/late/depth/image_raw", late, view.depth, "16UC1", "lens")

    streams = Streams(depth="/late/depth/image_raw", tolerance=0.001)
    options = RecordingOptions(check=False, streams=streams, up="z")
    open_recording(recorded(tmp_path / "robot", add), options)
    assert "one falls behind by 0.25 s, so stamps of one clock" in caplog.text
    assert "--tolerance" not in caplog.text


@pytest.mark.parametrize(
    ("skip", "said"),
    [
        (("info",), "no CameraInfo of /cam/rgb/image_raw; --intrinsics FILE would work"),
        (("depth",), "has no depth images; image topics are: /cam/ir"),
        (("static", "pose"), "poses of base, odom, but none reach the camera .* --camera-in base="),
    ],
)
def test_what_a_bag_lacks_is_said(tmp_path: Path, skip: tuple[str, ...], said: str) -> None:
    path = robot_bag(tmp_path / "robot", skip=skip)
    with pytest.raises(RecordingError, match=said):
        open_recording(path, RecordingOptions(streams=Streams(map_frame="map")))


@pytest.mark.parametrize("beside", [0.05, 0.0], ids=["beside", "at the same place"])
def test_depth_of_another_lens_is_projected(tmp_path, caplog, beside):
    T_colour_depth, wide = np.eye(4), K.copy()
    T_colour_depth[0, 3] = beside  # [m] the depth camera sits to the right of the colour camera
    wide[0, 0] = wide[1, 1] = 100.0
    frame = "depth" if beside else "colour"

    def add(made: Bag, view: View) -> None:
        if beside and not view.number:
            made.tf("/tf_static", view.stamp, "colour", "depth", T_colour_depth)
        made.tf("/tf", view.stamp, "map", "colour", view.T)
        made.camera("/c/color/camera_info", view.stamp, "colour")
        made.camera("/c/depth/camera_info", view.stamp, frame, focal=100.0)
        made.image("/c/color/image_raw", view.stamp, view.rgb, "rgb8", "colour")
        depth = room_depth(view.T @ T_colour_depth, wide, SIZE).astype(np.float32)
        made.image("/c/depth/image_raw", view.stamp, depth, "32FC1", frame)

    read = open_recording(recorded(tmp_path / "apart", add), UNCHECKED)
    assert read.listing.depth_camera is not None
    for seen, view in zip(read.frames(), VIEWS, strict=True):
        off = np.abs(seen.depth - room_depth(view.T, K, SIZE))
        assert np.isfinite(off).mean() > 0.8
        assert np.nanmedian(off) < 0.01
    told = "another field of view than colour by its own CameraInfo" in caplog.text
    assert told == (beside == 0)


def test_compressed_images(tmp_path: Path) -> None:
    def add(made: Bag, view: View) -> None:
        made.tf("/tf", view.stamp, "map", "lens", view.T)
        made.camera("/cam/rgb/camera_info", view.stamp, "lens")
        jpeg = cv2.imencode(".jpg", view.rgb[:, :, ::-1])[1].tobytes()
        made.compressed("/cam/rgb/image_raw/compressed", view.stamp, jpeg, "rgb8; jpeg", "lens")
        png = struct.pack("<iff", 0, 0, 0) + cv2.imencode(".png", view.depth)[1].tobytes()
        topic = "/cam/depth_registered/image_raw/compressedDepth"
        made.compressed(topic, view.stamp, png, "16UC1; compressedDepth png", "lens")

    frame = open_recording(recorded(tmp_path / "small", add), UNCHECKED).frame(2)
    assert np.abs(frame.rgb.astype(int) - VIEWS[2].rgb).max() <= 3
    assert np.array_equal(np.nan_to_num(frame.depth * 1000).round(), VIEWS[2].depth)


def _stored(image: np.ndarray, form: str) -> dict[str, Any]:
    """Fields of a CompressedImage as RTAB-Map fills them."""
    if form == "rvl":
        return {"format": form, "data": np.frombuffer(b"DEPTHRVL" + rvl(image), np.uint8)}
    if form == "floats":
        image = (image / np.float32(1000)).astype(np.float32).view(np.uint8)
        image, form = image.reshape(*image.shape[:-1], -1, 4), "png"
    return {"format": form, "data": cv2.imencode(f".{form}", image)[1].ravel()}


@pytest.mark.parametrize("ros1", [True, False], ids=["ROS 1", "ROS 2"])
@pytest.mark.parametrize("form", ["raw", "png", "rvl", "floats"])
def test_rtabmaps_images_in_one_message(tmp_path: Path, form: str, ros1: bool) -> None:
    def add(made: Bag, view: View) -> None:
        images = {"rgb": raw_image(view.rgb, "rgb8"), "depth": raw_image(view.depth, "16UC1")}
        if form != "raw":
            images = {"rgb_compressed": _stored(view.rgb[:, :, ::-1], "jpg")}
            images["depth_compressed"] = _stored(view.depth, form)
        kind = f"rtabmap_{'ros' if ros1 else 'msgs'}/msg/RGBDImage"
        rgbd_image(made, view, kind, **images)

    path = recorded(tmp_path / ("robot.bag" if ros1 else "robot"), add, ros1=ros1)
    read = open_recording(path, UNCHECKED)
    for frame, view in zip(read.frames(), VIEWS, strict=True):
        assert frame.stamp == pytest.approx(view.stamp, abs=1e-6)
        assert np.abs(frame.rgb.astype(int) - view.rgb).max() <= 3
        assert np.array_equal(np.nan_to_num(frame.depth * 1000).round(), view.depth)
        assert np.allclose(frame.T_map_cam, view.T, atol=0.03)
    with BagFile(path) as bag:
        (whole, *_) = bag.messages({"/rgbd_image/depth/image"})
        assert whole.topic == "/rgbd_image/depth/image"


def refusal(path: Path) -> str:
    with pytest.raises(RecordingError) as caught:
        list(open_recording(path, RecordingOptions(T_map_world=np.eye(4), check=False)).frames())
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_files_that_are_no_bag(tmp_path: Path) -> None:
    for name in ("empty.bag", "empty.mcap", "empty.db3"):
        for content in (b"", b"what is this" * 100):
            (tmp_path / name).write_bytes(content)
            assert "cannot be read" in refusal(tmp_path / name)
    (tmp_path / "metadata.yaml").write_text("a: [")
    assert "YAML" in refusal(tmp_path)


def bomb() -> bytes:
    """A small PNG that expands to gigabytes."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        body = kind + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

    header = struct.pack(">IIBBBBB", 30000, 30000, 1, 0, 0, 0, 0)
    head = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header)
    return head + chunk(b"IDAT", zlib.compress(bytes(3751 * 30000))) + chunk(b"IEND", b"")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"width": 2**31, "height": 2**31}, "pixels cannot be read"),
        ({"height": 0}, "pixels cannot be read"),
        ({"encoding": "yuv420"}, "is not read as colour"),
        ({"data": np.zeros(9, np.uint8)}, "no 160x120 image"),
        (None, "its header names too large a size"),
    ],
)
def test_hostile_images(tmp_path: Path, changes: dict[str, Any] | None, said: str) -> None:
    png = b"" if changes else bomb()

    def add(made: Bag, view: View) -> None:
        mapped(made, view)
        if changes is None:
            made.compressed("/rgb/image_raw/compressed", view.stamp, png, "png", "lens")
        else:
            fields = {"array": view.rgb, "encoding": "rgb8", "frame": "lens"} | changes
            made.image("/rgb/image_raw", view.stamp, **fields)

    assert said in refusal(recorded(tmp_path / "hostile", add))


def test_what_makes_no_sense_is_skipped_and_told(tmp_path, caplog):
    def add(made: Bag, view: View) -> None:
        if view.number == 3:
            lost = view.T.copy()
            lost[0, 3] = np.nan
            made.pose("/pose", view.stamp + 0.01, "map", lost)
            made.tf("/tf", view.stamp + 0.001, "map", "lens", lost)
        made.pose("/pose", view.stamp, "map", view.T)
        mapped(made, view)
        made.images(view)  # sent twice

    path = recorded(tmp_path / "lost", add)
    for pose in ("/pose", None):
        caplog.clear()
        options = RecordingOptions(check=False, streams=Streams(pose=pose))
        read = open_recording(path, options)
        assert len({frame.id for frame in read.frames()}) == len(read) == 6
        assert "transforms or poses that make no sense" in caplog.text


def test_a_loop_of_transforms(tmp_path: Path) -> None:
    def add(made: Bag, view: View) -> None:
        mapped(made, view)
        made.tf("/tf", view.stamp, "lens", "map", view.T)

    assert "transforms form a loop" in refusal(recorded(tmp_path / "loop", add))


def test_chunks_that_expand_to_more_than_they_say(source, tmp_path, monkeypatch):
    import lz4.frame
    from rosbags.rosbag1 import reader
    from rosbags.rosbag2 import storage_mcap

    from perception.sources.bags import bag_file

    path = written(source, tmp_path / "room.mcap")
    with monkeypatch.context() as patched:
        patched.setattr(bag_file, "MAX_CHUNK", 1000)
        assert "larger than any chunk" in refusal(path)
    large = bytes(1 << 24)
    bombs = {"zstd": vars(storage_mcap)["zstd"].compress(large), "lz4": lz4.frame.compress(large)}
    for compression, packed in bombs.items():
        assert len(packed) < 100_000
        with pytest.raises(RecordingError, match="expands to more than its 1000 bytes"):
            storage_mcap.decompress(packed, compression, 1000, 0)
        assert storage_mcap.decompress(packed, compression, len(large), 0) == large
    assert reader.decompressors["lz4"](bombs["lz4"]) == large


def test_another_map_frame_of_a_converted_recording(source, tmp_path):
    path = written(source, tmp_path / "room.mcap")
    read = open_recording(path, RecordingOptions(check=False, streams=Streams(map_frame="map")))
    assert np.allclose(read.T_map_world, np.eye(4), atol=0.02)
    assert np.allclose(read.frame(2).T_map_cam, source.frame(2).T_map_cam, atol=0.02)
