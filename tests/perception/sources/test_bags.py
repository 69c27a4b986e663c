"""Bags and MCAP files are read to the bits that were written; damaged ones are refused."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from perception.sources.bag_writer import write_bag
from perception.sources.listing import Streams
from perception.sources.recording import FolderRecording, open_recording
from perception.sources.recording_options import Selection
from perception.sources.ros.message_maker import whole_millimetres
from perception.sources.ros.message_types import message_types
from tests.perception.conftest import SIZE, K, look_at, room_depth

pytest.importorskip("rosbags")
from rosbags import rosbag1, rosbag2

from perception.sources.recording_options import RecordingOptions

NAMES = ("room.bag", "room.mcap", "room-2")
BEGIN = 1_700_000_000  # [s]
WORLD_UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture
def source(hololens: Callable[..., Path]) -> FolderRecording:
    return open_recording(hololens(), RecordingOptions(check=False, start_time=float(BEGIN)))


def written(recording: FolderRecording, path: Path) -> Path:
    assert sum(1 for _ in write_bag(recording, path)) == len(recording)
    return path


@pytest.mark.parametrize("name", NAMES)
def test_what_was_written_is_read(source: FolderRecording, tmp_path: Path, name: str) -> None:
    path = written(source, tmp_path / name)
    read = open_recording(path, RecordingOptions(check=False, start_time=float(BEGIN)))
    assert read.name == Path(name).stem
    assert np.array_equal(read.T_map_world, source.T_map_world)
    for ours, theirs in zip(read.frames(), source.frames(), strict=True):
        assert ours.id == theirs.id
        assert ours.stamp == theirs.stamp
        assert np.array_equal(ours.rgb, theirs.rgb)
        assert np.array_equal(ours.depth, theirs.depth, equal_nan=True)
        assert np.array_equal(ours.K, theirs.K)
        assert np.array_equal(ours.T_map_cam, theirs.T_map_cam)
    assert np.array_equal(read.frame(4).rgb, source.frame(4).rgb)  # and in any order
    assert np.array_equal(read.frame(1).depth, source.frame(1).depth, equal_nan=True)
    assert [p.name for p in tmp_path.iterdir() if p.name.startswith(".")] == []


def test_a_bag_of_a_bag_is_the_same_bag(source: FolderRecording, tmp_path: Path) -> None:
    first = open_recording(written(source, tmp_path / "room.bag"), RecordingOptions(check=False))
    again = open_recording(written(first, tmp_path / "room.mcap"), RecordingOptions(check=False))
    for a, b in zip(first.frames(), again.frames(), strict=True):
        assert a.id == b.id
        assert np.array_equal(a.depth, b.depth, equal_nan=True)


def test_nothing_is_overwritten_and_nothing_half_written_stays(
    source: FolderRecording, tmp_path: Path
) -> None:
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
    with pytest.raises(RecordingError, match=r"no frames selected; its 6 frames last 0\.17 s"):
        ids(start=9.0)


# Bags as robots record them, written message by message.


class Bag:
    """Writer of a bag of the room, by topics of one's own."""

    def __init__(self, path: Path, *, mcap: bool = True, ros1: bool = False) -> None:
        self.types, self.ros1 = message_types(ros1), ros1
        plugin = rosbag2.StoragePlugin.MCAP if mcap else rosbag2.StoragePlugin.SQLITE3
        self.bag: Any = (
            rosbag1.Writer(path) if ros1 else rosbag2.Writer(path, version=8, storage_plugin=plugin)
        )
        self.connections: dict[str, Any] = {}
        self.now: float | None = None  # [s] when messages are recorded; by default at their stamps
        self.bag.open()

    def make(self, kind: str, **fields: Any) -> Any:
        return self.types.types[kind](**fields)

    def header(self, stamp: float, frame: str) -> Any:
        ns = round(stamp * 1e9)
        time = self.make("builtin_interfaces/msg/Time", sec=ns // 10**9, nanosec=ns % 10**9)
        extra = {"seq": 0} if self.ros1 else {}
        return self.make("std_msgs/msg/Header", stamp=time, frame_id=frame, **extra)

    def write(self, topic: str, kind: str, stamp: float, message: Any) -> None:
        if topic not in self.connections:
            self.connections[topic] = self.bag.add_connection(topic, kind, typestore=self.types)
        serialize = self.types.serialize_ros1 if self.ros1 else self.types.serialize_cdr
        data = serialize(message, kind)
        self.bag.write(self.connections[topic], round((self.now or stamp) * 1e9), data)

    def image(self, topic: str, stamp: float, array: NDArray[Any], encoding: str, frame: str,
              **changes: Any) -> None:  # fmt: skip
        data = np.ascontiguousarray(array).view(np.uint8).ravel()
        fields: dict[str, Any] = {
            "height": array.shape[0],
            "width": array.shape[1],
            "encoding": encoding,
            "is_bigendian": 0,
            "step": data.size // array.shape[0],
            "data": data,
        }
        message = self.make("sensor_msgs/msg/Image", header=self.header(stamp, frame),
                            **(fields | changes))  # fmt: skip
        self.write(topic, "sensor_msgs/msg/Image", stamp, message)

    def compressed(self, topic: str, stamp: float, data: bytes, form: str, frame: str) -> None:
        kind = "sensor_msgs/msg/CompressedImage"
        message = self.make(kind, header=self.header(stamp, frame), format=form,
                            data=np.frombuffer(data, np.uint8))  # fmt: skip
        self.write(topic, kind, stamp, message)

    def camera(self, topic: str, stamp: float, frame: str, focal: float = K[0, 0]) -> None:
        kind = "sensor_msgs/msg/CameraInfo"
        k = K.copy()
        k[0, 0] = k[1, 1] = focal
        numbers = {"d": np.zeros(0), "k": k.ravel(), "r": np.eye(3).ravel(), "p": np.zeros(12)}
        if self.ros1:
            numbers = {name.upper(): value for name, value in numbers.items()}
        roi = self.make("sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0,
                        width=0, do_rectify=False)  # fmt: skip
        message = self.make(kind, header=self.header(stamp, frame), height=SIZE[1], width=SIZE[0],
                            distortion_model="plumb_bob", binning_x=0, binning_y=0, roi=roi,
                            **numbers)  # fmt: skip
        self.write(topic, kind, stamp, message)

    def body(self, T: NDArray[np.float64], vector: str) -> tuple[Any, Any]:
        from perception.camera.poses import quaternion_from_pose

        x, y, z = (float(n) for n in T[:3, 3])
        q = dict(zip("xyzw", (float(n) for n in quaternion_from_pose(T)), strict=True))
        return (
            self.make(f"geometry_msgs/msg/{vector}", x=x, y=y, z=z),
            self.make("geometry_msgs/msg/Quaternion", **q),
        )

    def tf(self, topic: str, stamp: float, parent: str, child: str, T: NDArray[np.float64]) -> None:
        translation, rotation = self.body(T, "Vector3")
        transform = self.make("geometry_msgs/msg/Transform", translation=translation,
                              rotation=rotation)  # fmt: skip
        stamped = self.make("geometry_msgs/msg/TransformStamped", header=self.header(stamp, parent),
                            child_frame_id=child, transform=transform)  # fmt: skip
        kind = "tf2_msgs/msg/TFMessage"
        self.write(topic, kind, stamp, self.make(kind, transforms=[stamped]))

    def pose(self, topic: str, stamp: float, frame: str, T: NDArray[np.float64]) -> None:
        position, orientation = self.body(T, "Point")
        pose = self.make("geometry_msgs/msg/Pose", position=position, orientation=orientation)
        kind = "geometry_msgs/msg/PoseStamped"
        message = self.make(kind, header=self.header(stamp, frame), pose=pose)
        self.write(topic, kind, stamp, message)

    def odometry(self, topic: str, stamp: float, child: str, T: NDArray[np.float64]) -> None:
        position, orientation = self.body(T, "Point")
        pose = self.make("geometry_msgs/msg/Pose", position=position, orientation=orientation)
        zero = self.make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        twist = self.make("geometry_msgs/msg/Twist", linear=zero, angular=zero)
        none = np.zeros(36)
        message = self.make(
            "nav_msgs/msg/Odometry",
            header=self.header(stamp, "odom"),
            child_frame_id=child,
            pose=self.make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=none),
            twist=self.make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=none),
        )
        self.write(topic, "nav_msgs/msg/Odometry", stamp, message)


def views() -> Iterator[tuple[int, float, NDArray[np.float64], NDArray[np.uint8], NDArray[Any]]]:
    for i, angle in enumerate(np.linspace(0, 2, 6)):
        T = look_at((0.2 * i - 0.5, 0, 1.4), (2 * np.cos(angle), 2 * np.sin(angle), 0.7))
        rgb = np.full((SIZE[1], SIZE[0], 3), 40 * i, np.uint8)
        millimetres = np.round(room_depth(T, K, SIZE) * 1000).astype(np.uint16)
        yield i, BEGIN + i / 10, T, rgb, millimetres


MOUNT = np.array([[0.0, 0, 1, 0.1], [-1, 0, 0, 0], [0, -1, 0, 1.2], [0, 0, 0, 1]])


def robot_bag(
    path: Path, *, skip: tuple[str, ...] = (), raised: float = 0.0, **options: Any
) -> Path:
    """The room as a robot with odometry, a mounted camera and depth 5 ms late records it.

    The map frame is `raised` [m] below the floor.
    """
    made = Bag(path, **options)
    for i, stamp, T, rgb, mm in views():
        T[2, 3] += raised
        T_map_base = T @ np.linalg.inv(MOUNT)
        if i == 0 and "static" not in skip:
            made.tf("/tf_static", stamp, "base", "lens", MOUNT)
        if "tf" not in skip:
            made.tf("/tf", stamp, "odom", "base", T_map_base)
            made.tf("/tf", stamp, "map", "odom", np.eye(4))
        if "odometry" not in skip:
            made.odometry("/odom", stamp, "base", T_map_base)
        if "pose" not in skip:
            made.pose("/vslam/pose", stamp, "map", T)
        if "info" not in skip:
            made.camera("/cam/rgb/camera_info", stamp, "lens")
        made.image("/cam/rgb/image_raw", stamp, rgb[:, :, ::-1], "bgr8", "lens")
        made.image("/cam/ir/image_raw", stamp, rgb[:, :, 0], "mono8", "lens")
        if "depth" not in skip:
            made.image("/cam/depth/image_raw", stamp + 0.005, mm, "16UC1", "lens")
    made.bag.close()
    return path


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("robot.bag", {"ros1": True}),
        ("mcap-folder", {}),
        ("sqlite-folder", {"mcap": False}),
    ],
)
def test_a_robots_bag_is_read_by_guessed_topics(
    tmp_path: Path, name: str, options: dict[str, Any]
) -> None:
    read = open_recording(robot_bag(tmp_path / name, **options))
    assert read.format == "bag"
    for frame, (i, stamp, T, rgb, mm) in zip(read.frames(), views(), strict=True):
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
        assert len(open_recording(path, RecordingOptions(check=False))) == 6


def test_poses_come_from_the_topic_that_is_named(tmp_path: Path) -> None:
    path = robot_bag(tmp_path / "robot", skip=("tf", "static"))
    named = open_recording(
        path, RecordingOptions(check=False, streams=Streams(pose="/vslam/pose"), up="z")
    )
    assert np.allclose(named.frame(3).T_map_cam, list(views())[3][2], atol=0.03)


def test_odometry_joins_tf_where_tf_lacks_it(tmp_path: Path) -> None:
    read = open_recording(
        robot_bag(tmp_path / "robot", skip=("tf",)), RecordingOptions(check=False)
    )
    assert np.allclose(read.frame(3).T_map_cam, list(views())[3][2], atol=0.03)


def test_given_topics_and_frames_are_taken(tmp_path: Path) -> None:
    path = robot_bag(tmp_path / "robot")
    grey = open_recording(
        path, RecordingOptions(check=False, streams=Streams(colour="/cam/ir/image_raw"))
    )
    assert np.array_equal(grey.frame(2).rgb, list(views())[2][3])
    with pytest.raises(RecordingError, match=r"'/cam/rgb/image' is no topic .* did you mean /cam/"):
        open_recording(path, RecordingOptions(streams=Streams(colour="/cam/rgb/image")))
    with pytest.raises(RecordingError, match="no transforms of frame 'mop'"):
        open_recording(path, RecordingOptions(streams=Streams(map_frame="mop")))
    with pytest.raises(RecordingError, match=r"lie within 0\.001 s"):
        open_recording(path, RecordingOptions(streams=Streams(tolerance=0.001)))


@pytest.mark.parametrize(
    ("skip", "said"),
    [
        (("info",), "no CameraInfo of /cam/rgb/image_raw; --intrinsics FILE would work"),
        (("depth",), "has no depth images; image topics are: /cam/ir"),
        (
            ("static", "pose"),
            "has poses of base, odom, but none reach the camera .* --camera-in base=X",
        ),
    ],
)
def test_what_a_bag_lacks_is_said(tmp_path: Path, skip: tuple[str, ...], said: str) -> None:
    path = robot_bag(tmp_path / "robot", skip=skip)
    with pytest.raises(RecordingError, match=said):
        open_recording(path, RecordingOptions(streams=Streams(map_frame="map")))


def test_depth_of_a_camera_apart_is_registered(tmp_path: Path) -> None:
    made = Bag(tmp_path / "apart")
    beside = np.eye(4)
    beside[0, 3] = 0.05  # [m] the depth camera sits to the right of the colour camera
    made.tf("/tf_static", BEGIN, "colour", "depth", beside)
    for _, stamp, T, rgb, _ in views():
        made.tf("/tf", stamp, "map", "colour", T)
        made.camera("/c/color/camera_info", stamp, "colour")
        made.camera("/c/depth/camera_info", stamp, "depth", focal=100.0)
        made.image("/c/color/image_raw", stamp, rgb, "rgb8", "colour")
        wide = K.copy()
        wide[0, 0] = wide[1, 1] = 100.0
        depth = room_depth(T @ beside, wide, SIZE).astype(np.float32)
        made.image("/c/depth/image_raw", stamp, depth, "32FC1", "depth")
    made.bag.close()
    read = open_recording(tmp_path / "apart", RecordingOptions(check=False))
    assert read.listing.depth_camera is not None
    for frame, (_, _, T, _, _) in zip(read.frames(), views(), strict=True):
        seen = np.isfinite(frame.depth)
        assert seen.mean() > 0.8
        off = np.abs(frame.depth - room_depth(T, K, SIZE))[seen]
        assert np.median(off) < 0.01


def test_compressed_images(tmp_path: Path) -> None:
    made = Bag(tmp_path / "small")
    for _, stamp, T, rgb, mm in views():
        made.tf("/tf", stamp, "map", "lens", T)
        made.camera("/cam/rgb/camera_info", stamp, "lens")
        jpeg = cv2.imencode(".jpg", rgb[:, :, ::-1])[1].tobytes()
        made.compressed("/cam/rgb/image_raw/compressed", stamp, jpeg, "rgb8; jpeg", "lens")
        png = struct.pack("<iff", 0, 0, 0) + cv2.imencode(".png", mm)[1].tobytes()
        topic = "/cam/depth_registered/image_raw/compressedDepth"
        made.compressed(topic, stamp, png, "16UC1; compressedDepth png", "lens")
    made.bag.close()
    read = open_recording(tmp_path / "small", RecordingOptions(check=False))
    _, _, _, rgb, mm = list(views())[2]
    assert np.abs(read.frame(2).rgb.astype(int) - rgb).max() <= 3
    assert np.array_equal(np.nan_to_num(read.frame(2).depth * 1000).round(), mm)


def refusal(path: Path) -> str:
    with pytest.raises(RecordingError) as caught:
        list(open_recording(path, RecordingOptions(T_map_world=np.eye(4), check=False)).frames())
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_files_that_are_no_bag(tmp_path: Path) -> None:
    for name in ("empty.bag", "empty.mcap", "empty.db3"):
        (tmp_path / name).write_bytes(b"")
        assert "cannot be read" in refusal(tmp_path / name)
        (tmp_path / name).write_bytes(b"what is this" * 100)
        assert "cannot be read" in refusal(tmp_path / name)
    (tmp_path / "metadata.yaml").write_text("a: [")
    assert "YAML" in refusal(tmp_path)


def test_hostile_images_and_transforms(tmp_path: Path) -> None:
    def bag(name: str, **changes: Any) -> Path:
        made = Bag(tmp_path / name)
        for _, stamp, T, rgb, mm in views():
            made.tf("/tf", stamp, "map", "lens", T)
            made.camera("/cam/rgb/camera_info", stamp, "lens")
            encoding = changes.get("encoding", "rgb8")
            others = {name: value for name, value in changes.items() if name != "encoding"}
            made.image("/cam/rgb/image_raw", stamp, rgb, encoding, "lens", **others)
            made.image("/cam/depth/image_raw", stamp, mm, "16UC1", "lens")
        made.bag.close()
        return tmp_path / name

    assert "pixels cannot be read" in refusal(bag("huge", width=2**31, height=2**31))
    assert "pixels cannot be read" in refusal(bag("flat", height=0))
    assert "is not read as colour" in refusal(bag("odd", encoding="yuv420"))
    assert "no 160x120 image" in refusal(bag("short", data=np.zeros(9, np.uint8)))


def test_transforms_that_make_no_sense_are_skipped_and_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    made = Bag(tmp_path / "nan")
    for i, stamp, T, rgb, mm in views():
        lost = np.full((4, 4), np.nan)
        made.tf("/tf", stamp, "map", "lens", T)
        if i == 3:
            broken = T.copy()
            broken[:3, 3] = lost[:3, 3]
            made.tf("/tf", stamp + 0.001, "map", "lens", broken)
        made.camera("/cam/rgb/camera_info", stamp, "lens")
        made.image("/cam/rgb/image_raw", stamp, rgb, "rgb8", "lens")
        made.image("/cam/depth/image_raw", stamp, mm, "16UC1", "lens")
    made.bag.close()
    assert len(open_recording(tmp_path / "nan", RecordingOptions(check=False))) == 6
    assert "1 transforms or poses that make no sense" in caplog.text


def test_chunks_that_expand_to_more_than_they_say(
    source: FolderRecording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from perception.sources.bags import bag_file

    path = written(source, tmp_path / "room.mcap")
    monkeypatch.setattr(bag_file, "MAX_CHUNK", 1000)
    assert "larger than any chunk" in refusal(path)


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_a_chunk_that_is_a_bomb_is_not_expanded(
    source: FolderRecording, tmp_path: Path, compression: str
) -> None:
    import lz4.frame
    from rosbags.rosbag1 import reader
    from rosbags.rosbag2 import storage_mcap

    open_recording(written(source, tmp_path / "room.mcap"), RecordingOptions(check=False))
    large = bytes(1 << 24)
    zstd = vars(storage_mcap)["zstd"]
    packed = zstd.compress(large) if compression == "zstd" else lz4.frame.compress(large)
    assert len(packed) < 100_000
    with pytest.raises(RecordingError, match="expands to more than its 1000 bytes"):
        storage_mcap.decompress(packed, compression, 1000, 0)
    assert storage_mcap.decompress(packed, compression, len(large), 0) == large
    assert reader.decompressors["lz4"](lz4.frame.compress(large)) == large


def test_poses_of_a_topic_that_make_no_sense_are_skipped_and_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    made = Bag(tmp_path / "lost")
    for i, stamp, T, rgb, mm in views():
        if i == 3:
            lost = T.copy()
            lost[0, 3] = np.nan
            made.pose("/pose", stamp + 0.01, "map", lost)
        made.pose("/pose", stamp, "map", T)
        made.camera("/cam/rgb/camera_info", stamp, "lens")
        made.image("/cam/rgb/image_raw", stamp, rgb, "rgb8", "lens")
        made.image("/cam/rgb/image_raw", stamp, rgb, "rgb8", "lens")  # sent twice
        made.image("/cam/depth/image_raw", stamp, mm, "16UC1", "lens")
        made.image("/cam/depth/image_raw", stamp, mm, "16UC1", "lens")
    made.bag.close()
    read = open_recording(tmp_path / "lost", RecordingOptions(check=False))
    assert len(read) == 6
    assert len({frame.id for frame in read.frames()}) == 6
    assert "1 transforms or poses that make no sense" in caplog.text


def test_another_map_frame_of_a_converted_recording(
    source: FolderRecording, tmp_path: Path
) -> None:
    path = written(source, tmp_path / "room.mcap")
    read = open_recording(path, RecordingOptions(check=False, streams=Streams(map_frame="map")))
    assert np.allclose(read.T_map_world, np.eye(4), atol=0.02)
    assert np.allclose(read.frame(2).T_map_cam, source.frame(2).T_map_cam, atol=0.02)


def test_a_png_that_expands_to_gigabytes(tmp_path: Path) -> None:
    def chunk(kind: bytes, data: bytes) -> bytes:
        body = kind + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

    header = struct.pack(">IIBBBBB", 30000, 30000, 1, 0, 0, 0, 0)
    bomb = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header)
    bomb += chunk(b"IDAT", zlib.compress(bytes(3751 * 30000))) + chunk(b"IEND", b"")
    made = Bag(tmp_path / "bomb")
    for _, stamp, T, _, mm in views():
        made.tf("/tf", stamp, "map", "lens", T)
        made.camera("/cam/rgb/camera_info", stamp, "lens")
        made.compressed("/cam/rgb/image_raw/compressed", stamp, bomb, "png", "lens")
        made.image("/cam/depth/image_raw", stamp, mm, "16UC1", "lens")
    made.bag.close()
    assert "its header names too large a size" in refusal(tmp_path / "bomb")


def test_a_loop_of_transforms(tmp_path: Path) -> None:
    made = Bag(tmp_path / "loop")
    for _, stamp, T, rgb, mm in views():
        made.tf("/tf", stamp, "map", "lens", T)
        made.tf("/tf", stamp, "lens", "map", T)
        made.camera("/cam/rgb/camera_info", stamp, "lens")
        made.image("/cam/rgb/image_raw", stamp, rgb, "rgb8", "lens")
        made.image("/cam/depth/image_raw", stamp, mm, "16UC1", "lens")
    made.bag.close()
    assert "transforms form a loop" in refusal(tmp_path / "loop")
