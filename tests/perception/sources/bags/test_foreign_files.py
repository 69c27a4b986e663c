"""Files of bags that other programs write: other schemas and encodings, split and cut files."""

import base64
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kg.model.errors import RecordingError

pytest.importorskip("rosbags")
pytest.importorskip("mcap")
from mcap.writer import CompressionType, Writer

from perception.sources.bags.bag_file import BagFile
from perception.sources.ros.message_types import message_types
from tests.perception.sources.robot_bags import VIEWS, opened, robot_bag, same_poses


def mcap(path: Path, raws: list[Any], data: Callable[[Any], bytes] | None = None, *,
         profile: str = "", encoding: str = "cdr", name: Callable[[str], str] = str,
         schema: str = "ros2msg", **options: Any) -> Path:  # fmt: skip
    """Messages as an MCAP file with its own names of types and encodings."""
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


def test_messages_are_read_by_the_encoding_of_their_channel(tmp_path, raws):
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
    assert np.array_equal(read.frame(3).rgb, VIEWS[3].rgb)
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

    def converted(key: str, value: Any) -> Any:
        if key == "timestamp":
            return messages.Timestamp(sec=value["sec"], nsec=value["nsec"])
        if isinstance(value, dict):
            return as_sdk(messages, known[key], value)
        return [as_sdk(messages, known[key], one) for one in value] if key in known else value

    return getattr(messages, name)(**{key: converted(key, value) for key, value in fields.items()})


@pytest.mark.parametrize("chunked", [True, False])
def test_an_mcap_file_without_end_is_read_up_to_its_last_whole_part(
    tmp_path: Path, raws: list[Any], chunked: bool, caplog: pytest.LogCaptureFixture
) -> None:
    path = mcap(tmp_path / "cut.mcap", raws, use_chunking=chunked, chunk_size=1000)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * 0.7)])
    read = opened(path)
    assert 2 <= len(read) < 6
    assert np.allclose(read.frame(1).T_map_cam, VIEWS[1].T, atol=0.03)
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


def test_another_storage_plugin_is_named_with_the_way_to_convert_it(tmp_path: Path) -> None:
    path = robot_bag(tmp_path / "robot", mcap=False) / "metadata.yaml"
    path.write_text(path.read_text().replace("sqlite3", "their_storage"))
    with pytest.raises(RecordingError, match=r"'their_storage' not supported; .*ros2 bag convert"):
        opened(path.parent)


def test_messages_beside_an_sqlite_file_are_not_left_out(tmp_path: Path) -> None:
    path = robot_bag(tmp_path / "robot", mcap=False)
    (path / "robot.db3-wal").write_bytes(b"pages")
    with pytest.raises(RecordingError, match=r"robot.db3-wal holds messages .* wal_checkpoint"):
        opened(path)
