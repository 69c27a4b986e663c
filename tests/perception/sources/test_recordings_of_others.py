"""Bags that other programs write: poses that do not reach the camera, other schemas, cut files."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kg.model.errors import RecordingError
from perception.camera.intrinsics import Intrinsics
from perception.camera.poses import BODY_FROM_CAMERA
from perception.sources.listing import Streams
from perception.sources.recording import FolderRecording, open_recording
from perception.sources.recording_options import RecordingOptions, Selection
from tests.perception.conftest import SIZE, K, room_depth

pytest.importorskip("rosbags")
pytest.importorskip("mcap")
from mcap.writer import CompressionType, Writer

from perception.sources.bags.bag_file import BagFile
from perception.sources.ros.message_types import message_types
from tests.perception.sources.test_bags import BEGIN, MOUNT, Bag, robot_bag, views

# MOUNT as --camera-in has it: the camera looks ahead, so only its place is left
WHERE = "0.1,0,1.2,0,0,0"
NO_TF = ("tf", "static", "pose")


def opened(path: Path, **streams: Any) -> FolderRecording:
    return open_recording(path, RecordingOptions(check=False, up="z", streams=Streams(**streams)))


def same_poses(read: FolderRecording) -> bool:
    return all(
        np.allclose(frame.T_map_cam, T, atol=0.03)
        for frame, (_, _, T, _, _) in zip(read.frames(), views(), strict=True)
    )


def test_odometry_that_nothing_links_to_the_camera_is_refused_until_its_mount_is_given(
    tmp_path: Path,
) -> None:
    path = robot_bag(tmp_path / "robot", skip=NO_TF)
    with pytest.raises(RecordingError, match=r"poses of base, but none reach .* --camera-in base="):
        opened(path)
    assert same_poses(opened(path, camera_in=f"base={WHERE}"))
    urdf = tmp_path / "robot.urdf"
    urdf.write_text(
        '<robot name="r"><joint name="mount" type="fixed"><parent link="base"/>'
        '<child link="lens"/><origin xyz="0.1 0 1.2" rpy="-1.5707963 0 -1.5707963"/></joint>'
        "</robot>"
    )
    assert same_poses(opened(path, camera_in=str(urdf)))
    with pytest.raises(RecordingError, match=r"is no mount; base_link=0.2,0,1.1,0,0,0 is one"):
        opened(path, camera_in="base=1,2,three")
    with pytest.raises(RecordingError, match=r"cannot read .*nowhere\.urdf"):
        opened(path, camera_in=str(tmp_path / "nowhere.urdf"))
    urdf.write_text('<!DOCTYPE r [<!ENTITY a "a">]><robot>&a;</robot>')
    with pytest.raises(RecordingError, match="declares entities"):
        opened(path, camera_in=str(urdf))


def test_a_mount_is_the_pose_of_the_cameras_body() -> None:
    from perception.sources.bags.bag_poses import mount

    assert np.allclose(mount(f"base={WHERE}") @ BODY_FROM_CAMERA, MOUNT)
    turned = mount("base=0,0,0,0.1,-0.2,0.3")
    roll, pitch = np.arctan2(turned[2, 1], turned[2, 2]), np.arcsin(-turned[2, 0])
    assert (roll, pitch) == pytest.approx((0.1, -0.2))
    assert np.arctan2(turned[1, 0], turned[0, 0]) == pytest.approx(0.3)


def test_poses_of_a_frame_that_a_topic_does_not_name(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    made = Bag(tmp_path / "robot")
    for i, stamp, T, rgb, mm in views():
        if i == 0:
            made.tf("/tf_static", stamp, "base", "lens", MOUNT)
        made.pose("/robot_pose", stamp, "map", T @ np.linalg.inv(MOUNT))
        made.pose("/goal_pose", stamp, "map", np.eye(4))
        images(made, "/cam", stamp, rgb, mm)
    made.bag.close()
    assert same_poses(opened(tmp_path / "robot", pose_frame="base"))
    opened(tmp_path / "robot")
    assert "poses of /robot_pose are taken for those of lens; --pose-frame base if" in caplog.text


def images(made: Bag, name: str, stamp: float, rgb: Any, mm: Any, frame: str = "lens") -> None:
    made.camera(f"{name}/camera_info", stamp, frame)
    made.image(f"{name}/image_raw", stamp, rgb, "rgb8", frame)
    made.image(f"{name}/depth/image_raw", stamp, mm, "16UC1", frame)


def test_each_robot_has_its_own_tree_and_its_own_images(tmp_path: Path) -> None:
    made = Bag(tmp_path / "robots")
    for i, stamp, T, rgb, mm in views():
        for name, where, depth in (("/a", T, mm), ("/b", np.eye(4), mm // 4)):
            if i == 0:
                made.tf(f"{name}/tf_static", stamp, "base", "lens", MOUNT)
            made.tf(f"{name}/tf", stamp, "odom", "base", where @ np.linalg.inv(MOUNT))
            if name == "/a" or i:  # the other robot has fewer images
                images(made, name, stamp, rgb, depth)
    made.bag.close()
    read = opened(tmp_path / "robots")
    assert same_poses(read)
    assert np.array_equal(np.nan_to_num(read.frame(2).depth * 1000).round(), list(views())[2][4])
    other = opened(tmp_path / "robots", colour="/b/image_raw")
    assert np.allclose(other.frame(0).T_map_cam[:3, :3], np.eye(3))


def test_a_camera_that_poses_reach_comes_before_one_with_more_images(tmp_path: Path) -> None:
    made = Bag(tmp_path / "robot")
    for _, stamp, T, rgb, mm in views():
        made.tf("/tf", stamp, "odom", "lens", T)
        images(made, "/front", stamp, rgb, mm)
        for k in range(2):
            images(made, "/rear", stamp + k / 50, rgb, mm, "rear_lens")
    made.bag.close()
    assert same_poses(opened(tmp_path / "robot"))


def test_a_path_gives_the_cameras_poses(tmp_path: Path) -> None:
    made, kind = Bag(tmp_path / "robot"), "nav_msgs/msg/Path"
    poses = []
    for _, stamp, T, rgb, mm in views():
        position, orientation = made.body(T, "Point")
        pose = made.make("geometry_msgs/msg/Pose", position=position, orientation=orientation)
        header = made.header(stamp, "map")
        poses.append(made.make("geometry_msgs/msg/PoseStamped", header=header, pose=pose))
        made.write("/path", kind, stamp, made.make(kind, header=header, poses=list(poses)))
        images(made, "/cam", stamp, rgb, mm)
    made.bag.close()
    assert same_poses(opened(tmp_path / "robot"))


@pytest.mark.parametrize("moving", [True, False])
def test_the_frame_that_images_name_may_be_given(tmp_path: Path, moving: bool) -> None:
    made = Bag(tmp_path / "robot")
    for _, stamp, T, rgb, mm in views():
        if moving:
            made.tf("/tf", stamp, "odom", "cam_optical", T)
        images(made, "/cam", stamp, rgb, mm, "")
    made.bag.close()
    if moving:
        with pytest.raises(RecordingError, match="--camera-frame cam_optical names its frame"):
            opened(tmp_path / "robot")
        assert same_poses(opened(tmp_path / "robot", camera_frame="cam_optical"))
    else:
        options = RecordingOptions(check=False, estimate_poses=False)
        with pytest.raises(RecordingError, match=r"has no poses of .* --poses FILE"):
            open_recording(tmp_path / "robot", options)


def test_a_camera_that_stands_still_is_mapped_where_it_is_asked_for(tmp_path: Path) -> None:
    made = Bag(tmp_path / "robot")
    for _, stamp, _, rgb, mm in views():
        made.tf("/tf_static", stamp, "base", "lens", MOUNT)
        images(made, "/cam", stamp, rgb, mm)
    made.bag.close()
    options = RecordingOptions(check=False, estimate_poses=False)
    with pytest.raises(RecordingError, match=r"tf does not move.*--map-frame base maps a camera"):
        open_recording(tmp_path / "robot", options)
    assert np.allclose(
        opened(tmp_path / "robot", map_frame="base").frame(0).T_map_cam[:2, 3], MOUNT[:2, 3]
    )


def test_stamps_that_are_too_far_apart_name_the_tolerance(tmp_path: Path) -> None:
    path = robot_bag(tmp_path / "robot")
    with pytest.raises(RecordingError, match=r"0.005 s apart: --tolerance 0.01 would work"):
        opened(path, tolerance=0.001)


def test_a_camera_that_is_not_calibrated_names_what_is(tmp_path: Path) -> None:
    made = Bag(tmp_path / "robot")
    for _, stamp, T, rgb, mm in views():
        made.tf("/tf", stamp, "odom", "lens", T)
        images(made, "/cam", stamp, rgb, mm)
        made.camera("/other/camera_info", stamp, "elsewhere")
    made.bag.close()
    with BagFile(tmp_path / "robot") as bag:
        raws = list(bag.messages({topic.name for topic in bag.topics}))
    types = message_types(False)

    def blank(raw: Any) -> bytes:
        message = types.deserialize_cdr(raw.data, raw.type)
        return bytes(types.serialize_cdr(replace(message, k=np.zeros(9)), raw.type))

    blind = ["/cam/camera_info"]
    path = mcap(
        tmp_path / "k.mcap", raws, lambda raw: blank(raw) if raw.topic in blind else raw.data
    )
    with pytest.raises(RecordingError, match=r"has K = 0; .*FILE, --info-topic /other/camera_info"):
        opened(path)
    assert same_poses(opened(path, camera="/other/camera_info"))
    given = Intrinsics(K[0, 0], K[1, 1], K[0, 2], K[1, 2], *SIZE, source="given")
    assert same_poses(open_recording(path, RecordingOptions(check=False, up="z", intrinsics=given)))


def mcap(path: Path, raws: list[Any], data: Callable[[Any], bytes] | None = None, *,
         profile: str = "", encoding: str = "cdr", name: Callable[[str], str] = str,
         schema: str = "ros2msg", **options: Any) -> Path:  # fmt: skip
    channels: dict[str, int] = {}
    with path.open("wb") as file:
        writer = Writer(file, **options)
        writer.start(profile)
        for raw in raws:
            if raw.topic not in channels:
                number = writer.register_schema(name(raw.type), schema, b"\xff\x00")
                channels[raw.topic] = writer.register_channel(raw.topic, encoding, number)
            content = data(raw) if data else raw.data
            writer.add_message(channels[raw.topic], raw.time, content, raw.time)
        writer.finish()
    return path


@pytest.fixture
def raws(tmp_path: Path) -> list[Any]:
    with BagFile(robot_bag(tmp_path / "source", skip=("odometry", "pose"))) as bag:
        return list(bag.messages({topic.name for topic in bag.topics}))


def test_messages_are_read_by_the_encoding_of_their_channel(
    tmp_path: Path, raws: list[Any]
) -> None:
    def plain(kind: str) -> str:
        return kind.replace("/msg/", "/")

    assert same_poses(opened(mcap(tmp_path / "cdr.mcap", raws)))
    with BagFile(robot_bag(tmp_path / "robot.bag", ros1=True)) as bag:
        old = list(bag.messages({topic.name for topic in bag.topics}))
    path = mcap(tmp_path / "ros1.mcap", old, profile="ros1", encoding="ros1", name=plain)
    assert same_poses(opened(path))


@pytest.mark.parametrize("encoding", ["json", "protobuf"])
def test_foxgloves_schemas_are_read(tmp_path: Path, raws: list[Any], encoding: str) -> None:
    messages = pytest.importorskip("foxglove.messages")
    names = {"Image": "RawImage", "CameraInfo": "CameraCalibration", "TFMessage": "FrameTransforms"}
    types = message_types(False)

    def encoded(raw: Any) -> bytes:
        fields = foxglove_fields(types.deserialize_cdr(raw.data, raw.type))
        if encoding == "json":
            return json.dumps(fields, default=lambda data: base64.b64encode(data).decode()).encode()
        return bytes(as_sdk(messages, names[raw.type.split("/")[-1]], fields).encode())

    path = mcap(
        tmp_path / "robot.mcap",
        raws,
        encoded,
        encoding=encoding,
        schema="protobuf" if encoding == "protobuf" else "jsonschema",
        name=lambda kind: f"foxglove.{names[kind.split('/')[-1]]}",
        compression=CompressionType.NONE,
        enable_crcs=False,
    )
    read = opened(path)
    assert same_poses(read)
    assert np.array_equal(read.frame(3).rgb, list(views())[3][3])
    whole = path.read_bytes()
    path.write_bytes(whole.replace(b"lens", b"\xfe\xfe\xfe\xfe"))
    with pytest.raises(RecordingError):
        opened(path)


def foxglove_fields(message: Any) -> dict[str, Any]:
    def vector(given: Any, names: str) -> dict[str, float]:
        return {name: float(getattr(given, name)) for name in names}

    def stamped(header: Any) -> dict[str, Any]:
        return {"timestamp": {"sec": header.stamp.sec, "nsec": header.stamp.nanosec}}

    if hasattr(message, "transforms"):
        links = [
            stamped(one.header)
            | {"parent_frame_id": one.header.frame_id, "child_frame_id": one.child_frame_id}
            | {"translation": vector(one.transform.translation, "xyz")}
            | {"rotation": vector(one.transform.rotation, "xyzw")}
            for one in message.transforms
        ]
        return {"transforms": links}
    start = stamped(message.header) | {"frame_id": message.header.frame_id}
    start |= {"width": message.width, "height": message.height}
    if hasattr(message, "encoding"):
        data = message.data.tobytes()
        return start | {"encoding": message.encoding, "step": message.step, "data": data}
    numbers = {name.upper(): getattr(message, name).tolist() for name in "dkrp"}
    return start | {"distortion_model": message.distortion_model} | numbers


def as_sdk(messages: Any, name: str, fields: dict[str, Any]) -> Any:
    known = {"translation": "Vector3", "rotation": "Quaternion", "transforms": "FrameTransform"}
    values = {}
    for key, value in fields.items():
        if key == "timestamp":
            values[key] = messages.Timestamp(sec=value["sec"], nsec=value["nsec"])
        elif isinstance(value, dict):
            values[key] = as_sdk(messages, known[key], value)
        elif key in known:
            values[key] = [as_sdk(messages, known[key], one) for one in value]
        else:
            values[key] = value
    return getattr(messages, name)(**values)


@pytest.mark.parametrize("chunked", [True, False])
def test_an_mcap_file_without_end_is_read_up_to_its_last_whole_part(
    tmp_path: Path, raws: list[Any], chunked: bool, caplog: pytest.LogCaptureFixture
) -> None:
    path = mcap(tmp_path / "cut.mcap", raws, use_chunking=chunked, chunk_size=1000)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * 0.7)])
    read = opened(path)
    assert 2 <= len(read) < 6
    assert np.allclose(read.frame(1).T_map_cam, list(views())[1][2], atol=0.03)
    assert "cut short" in caplog.text


def test_a_bag_of_ros1_without_an_index_is_read(tmp_path: Path) -> None:
    path = robot_bag(tmp_path / "robot.bag", ros1=True)
    whole = bytearray(path.read_bytes())
    at = whole.index(b"index_pos=") + len(b"index_pos=")
    end = int.from_bytes(whole[at : at + 8], "little")
    whole[at : at + 8] = bytes(8)
    active = tmp_path / "robot.bag.active"
    active.write_bytes(whole[:end])
    assert same_poses(opened(active))


def test_parts_of_a_split_recording_are_one(tmp_path: Path, raws: list[Any]) -> None:
    folder = tmp_path / "split"
    folder.mkdir()
    third = len(raws) // 3
    for i in range(3):
        mcap(folder / f"robot_{i}.mcap", raws[i * third : (i + 1) * third if i < 2 else None])
    assert same_poses(opened(folder))
    (folder / "other.mcap").write_bytes(b"")
    with pytest.raises(RecordingError, match="is no recording of a known format"):
        opened(folder)
    assert BEGIN == 1_700_000_000


def test_a_camera_that_is_mounted_upside_down_is_turned(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    made, half = Bag(tmp_path / "robot"), np.diag([-1.0, -1.0, 1.0, 1.0])
    for _, stamp, T, rgb, mm in views():
        made.tf("/tf", stamp, "odom", "lens", T @ half)
        images(made, "/cam", stamp, rgb[::-1, ::-1], mm[::-1, ::-1])
    made.bag.close()
    read = opened(tmp_path / "robot")
    assert "turned by 180 degrees" in caplog.text
    assert same_poses(read)
    assert np.array_equal(np.nan_to_num(read.frame(2).depth * 1000).round(), list(views())[2][4])
    moved = [SIZE[0] - 1 - K[0, 2], SIZE[1] - 1 - K[1, 2]]
    assert read.frame(2).K[:2, 2].tolist() == moved


def test_a_world_whose_z_is_not_up_is_refused_with_the_direction(tmp_path: Path) -> None:
    made = Bag(tmp_path / "robot")
    first = np.linalg.inv(next(views())[2])
    for _, stamp, T, rgb, mm in views():
        made.tf("/tf", stamp, "world", "lens", first @ T)
        images(made, "/cam", stamp, rgb, mm)
    made.bag.close()
    with pytest.raises(
        RecordingError, match=r"--up -?0\.\d+,-0\.9\d+,-0\.\d+ would work"
    ) as refused:
        open_recording(tmp_path / "robot")
    up = str(refused.value).split("--up ")[1].split(" ")[0]
    read = open_recording(tmp_path / "robot", RecordingOptions(up=up))
    assert np.allclose(read.frame(3).T_map_cam[2], list(views())[3][2][2], atol=0.05)


def test_the_last_run_of_a_simulation_counts(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    made = Bag(tmp_path / "robot.bag", ros1=True)
    for run in range(2):
        for i, (_, stamp, T, rgb, mm) in enumerate(views()):
            place = T.copy()
            place[0, 3] += 1 - run
            made.now = stamp + run  # recorded later, with the stamps of the first run
            made.tf("/tf", 5.0 + i, "odom", "lens", place)
            images(made, "/cam", 5.0 + i, rgb, mm)
    made.bag.close()
    read = opened(tmp_path / "robot.bag")
    assert "started again" in caplog.text
    assert same_poses(read)


def test_a_map_frame_that_hangs_below_the_camera_gives_its_poses(tmp_path: Path) -> None:
    made = Bag(tmp_path / "robot")
    for _, stamp, T, rgb, mm in views():
        made.tf("/tf_static", stamp, "base", "lens", MOUNT)
        made.tf("/tf", stamp, "base", "odom", MOUNT @ np.linalg.inv(T))
        images(made, "/cam", stamp, rgb, mm)
    made.bag.close()
    assert same_poses(opened(tmp_path / "robot"))


def test_messages_beside_an_sqlite_file_are_not_left_out(tmp_path: Path) -> None:
    path = robot_bag(tmp_path / "robot", mcap=False)
    (path / "robot.db3-wal").write_bytes(b"pages")
    with pytest.raises(RecordingError, match=r"robot.db3-wal holds messages .* wal_checkpoint"):
        opened(path)


def test_depth_of_another_lens_at_the_same_place_is_projected(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    made, wide = Bag(tmp_path / "robot"), K.copy()
    wide[0, 0] = wide[1, 1] = 100.0
    for _, stamp, T, rgb, _ in views():
        made.tf("/tf", stamp, "map", "lens", T)
        made.camera("/c/color/camera_info", stamp, "lens")
        made.camera("/c/depth/camera_info", stamp, "lens", focal=100.0)
        made.image("/c/color/image_raw", stamp, rgb, "rgb8", "lens")
        depth = room_depth(T, wide, SIZE).astype(np.float32)
        made.image("/c/depth/image_raw", stamp, depth, "32FC1", "lens")
    made.bag.close()
    frame = opened(tmp_path / "robot").frame(3)
    off = np.abs(frame.depth - room_depth(list(views())[3][2], K, SIZE))
    assert np.nanmedian(off) < 0.01
    assert "another field of view than colour by its own CameraInfo" in caplog.text


def test_images_of_video_are_no_colour_images_and_are_named(tmp_path: Path) -> None:
    made = Bag(tmp_path / "robot")
    for _, stamp, T, _, mm in views():
        made.tf("/tf", stamp, "map", "lens", T)
        made.camera("/cam/rgb/camera_info", stamp, "lens")
        made.compressed("/cam/rgb/image_raw/compressed", stamp, bytes(600), "h264", "lens")
        made.image("/cam/depth/image_raw", stamp, mm, "16UC1", "lens")
    made.bag.close()
    with pytest.raises(RecordingError, match=r"no colour images, but /cam/rgb.* video .*republish"):
        opened(tmp_path / "robot")


@pytest.mark.parametrize("first", [0.0, -2.0])
def test_stamps_may_begin_at_zero_or_pass_it(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, first: float
) -> None:
    made = Bag(tmp_path / "robot")
    for i, (_, stamp, T, rgb, mm) in enumerate(views()):
        made.now = stamp
        made.tf("/tf", first + i, "odom", "lens", T)
        images(made, "/cam", first + i, rgb, mm)
    made.bag.close()
    read = opened(tmp_path / "robot")
    assert same_poses(read)
    assert "started again" not in caplog.text


def test_another_storage_plugin_is_named_with_the_way_to_convert_it(tmp_path: Path) -> None:
    path = robot_bag(tmp_path / "robot", mcap=False) / "metadata.yaml"
    path.write_text(path.read_text().replace("sqlite3", "their_storage"))
    with pytest.raises(RecordingError, match=r"'their_storage' not supported; .*ros2 bag convert"):
        opened(path.parent)


@pytest.mark.parametrize("clock", [5000.0, 1.0])
def test_up_of_estimated_poses_is_that_of_floor_and_walls_where_given_poses_turn_otherwise(
    shared: Callable[[str], Path], tmp_path: Path, clock: float
) -> None:
    """By another clock, or those of a head whose robot moves."""
    room = open_recording(
        shared("data/rgbd/icl_livingroom"), RecordingOptions(selection=Selection(every=4, limit=14))
    )
    made = Bag(tmp_path / "robot")
    for i, frame in enumerate(room.frames()):
        made.tf("/tf", clock + i, "map", "lens", frame.T_map_cam if clock > 1 else np.eye(4))
        made.image("/cam/rgb/image_raw", 1.0 + i, frame.rgb, "rgb8", "lens")
        made.image("/cam/depth/image_raw", 1.0 + i, frame.depth, "32FC1", "lens")
    made.bag.close()
    options = RecordingOptions(intrinsics=room.rectifier.camera, estimate_poses=True)
    read = open_recording(tmp_path / "robot", options)
    # heights of the camera's axes
    assert read.frame(0).T_map_cam[2, :3] @ room.frame(0).T_map_cam[2, :3] > np.cos(np.radians(3))
