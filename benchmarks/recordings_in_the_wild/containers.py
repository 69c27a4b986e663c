"""Files that other people's programs write: rosbag of ROS 1, rosbags, and the writers of MCAP."""

from __future__ import annotations

import base64
import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags import rosbag1, rosbag2
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from benchmarks.recordings_in_the_wild.robot import (
    CAMERA_INFO,
    COMPRESSED,
    IMAGE,
    POSE,
    TF,
    Message,
    Messages,
)

Container = Callable[[Messages, Path], Path]
ROS2: Final = get_typestore(Stores.ROS2_JAZZY)
ROS1: Final = get_typestore(Stores.ROS1_NOETIC)
ROS2.register(
    {
        **get_types_from_msg(
            "std_msgs/Header header\nuint8[] data", "theora_image_transport/msg/Packet"
        ),
        **get_types_from_msg(
            "std_msgs/Header header\nint32 width\nint32 height\nstring encoding\nuint64 pts\n"
            "uint8 flags\nbool is_bigendian\nuint8[] data",
            "ffmpeg_image_transport_msgs/msg/FFMPEGPacket",
        ),
        **get_types_from_msg(
            "builtin_interfaces/Time timestamp\nstring frame_id\nuint8[] data\nstring format",
            "foxglove_msgs/msg/CompressedVideo",
        ),
    }
)
ROS1.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))
SYSTEM_PYTHON: Final = "/usr/bin/python3"
#: rewrites a bag with ROS' own rosbag: arguments are source, compression, then the new files;
#: a file that is not closed stays as a crash leaves it
ROSBAG: Final = """
import os, sys, rosbag
source, compression, crash, *files = sys.argv[1:]
messages = list(rosbag.Bag(source).read_messages(raw=True))
part = -(-len(messages) // len(files))
for i, name in enumerate(files):
    # rosbag record writes chunks of 768 kB
    bag = rosbag.Bag(name, "w", compression=compression, chunk_threshold=768 * 1024)
    for topic, raw, time in messages[i * part : (i + 1) * part]:
        bag.write(topic, raw, time, raw=True)
    if crash == "crash":
        bag._file.flush()
        os._exit(0)
    bag.close()
"""


def made(types: Any, kind: str, fields: dict[str, Any]) -> Any:
    """A message of a typestore; fields that are not given are zero, empty or the identity."""
    values = {}
    for name, (node, about) in types.fielddefs[kind][1]:
        given = fields.get(name, fields.get(name.lower()))
        values[name] = _value(types, node, about, given)
    return types.types[kind](**values)


def _value(types: Any, node: Any, about: Any, given: Any) -> Any:
    if node == Nodetype.NAME:
        return made(types, about, given or {})
    if node == Nodetype.BASE:
        empty: Any = "" if about[0] == "string" else False if about[0] == "bool" else 0
        return empty if given is None else given
    (inner, what), length = about
    if inner == Nodetype.NAME:
        return [made(types, what, one) for one in (given or [])]
    if what[0] == "string":
        return list(given or [])
    return np.array(np.zeros(length) if given is None else given, dtype=what[0])


def encoded(types: Any, message: Message) -> bytes:
    """A message as a typestore serialises it."""
    built = made(types, message.type, message.fields)
    serialize = types.serialize_ros1 if types is ROS1 else types.serialize_cdr
    return bytes(serialize(built, message.type))


def _fill(writer: Any, types: Any, messages: Messages) -> None:
    connections: dict[str, Any] = {}
    for message in messages:
        if message.topic not in connections:
            connections[message.topic] = writer.add_connection(
                message.topic, message.type, typestore=types
            )
        writer.write(connections[message.topic], message.time, encoded(types, message))


def bag(messages: Messages, folder: Path) -> Path:
    """A ROS 1 bag by rosbags."""
    path = folder / "robot.bag"
    with rosbag1.Writer(path) as writer:
        _fill(writer, ROS1, messages)
    return path


def rosbag(compression: str = "none", parts: int = 1, *, crash: bool = False) -> Container:
    """ROS 1 bags by ROS' own rosbag."""

    def write(messages: Messages, folder: Path) -> Path:
        (folder / "source").mkdir()
        source = bag(messages, folder / "source")
        out = folder / "robot"
        out.mkdir()
        suffix = ".bag.active" if crash else ".bag"
        names = [out / f"robot_{i}{suffix}" for i in range(parts)]
        words = [source, compression, "crash" if crash else "close", *names]
        subprocess.run([SYSTEM_PYTHON, "-c", ROSBAG, *map(str, words)], check=True)
        source.unlink()
        return out if parts > 1 else names[0]

    return write


def other_storage(messages: Messages, folder: Path) -> Path:
    """A ROS 2 bag whose storage plugin is none of ROS' own."""
    path = ros2()(messages, folder)
    for name in ("metadata.yaml", *(p.name for p in path.glob("*.db3"))):
        file = path / name
        if name == "metadata.yaml":
            file.write_text(
                file.read_text().replace("sqlite3", "zed_storage").replace("db3", "zed")
            )
        else:
            file.rename(file.with_suffix(".zed"))
    return path


def without_definitions(messages: Messages, folder: Path) -> Path:
    """An MCAP file whose recorder did not find the definitions of messages."""
    return mcap("ros2", "cdr", definitions=False)(messages, folder)


def cut(container: Container, share: float = 0.9) -> Container:
    """The file of another container, cut short."""

    def write(messages: Messages, folder: Path) -> Path:
        path = container(messages, folder)
        whole = path.read_bytes()
        path.write_bytes(whole[: int(share * len(whole))])
        return path

    return write


def ros2(
    storage: str = "SQLITE3",
    compression: str = "",
    parts: int = 1,
    *,
    metadata: bool = True,
    inner: bool = False,
) -> Container:
    """ROS 2 bags by rosbags: in several files, without metadata, or one file alone."""

    def write(messages: Messages, folder: Path) -> Path:
        out = folder / "robot"
        plugin = rosbag2.StoragePlugin[storage]
        size = -(-len(messages) // parts)
        for part in range(parts):
            target = folder / f"robot_{part}" if parts > 1 else out
            writer = rosbag2.Writer(target, version=9, storage_plugin=plugin)
            if compression:
                mode = rosbag2.CompressionMode[compression]
                writer.set_compression(mode, rosbag2.CompressionFormat.ZSTD)
            with writer:
                _fill(writer, ROS2, messages[part * size : (part + 1) * size])
            if part == 0 and parts > 1:
                target.rename(out)
            for file in target.iterdir() if part else ():
                if file.name != "metadata.yaml":
                    file.rename(out / file.name)
        if parts > 1 and metadata:
            _list_files(out)
        if not metadata:
            (out / "metadata.yaml").unlink()
        return next(p for p in out.iterdir() if p.suffix != ".yaml") if inner else out

    return write


def _list_files(folder: Path) -> None:
    """Name all files in the metadata of the first part, as a recorder that splits does."""
    path = folder / "metadata.yaml"
    names = sorted(p.name for p in folder.iterdir() if p.suffix != ".yaml")
    lines: list[str] = []
    for line in path.read_text().splitlines():
        if line.strip() == f"- {names[0]}":
            lines += [line.replace(names[0], name) for name in names]
        else:
            lines.append(line)
    path.write_text("\n".join(lines) + "\n")


def mcap_ros2(messages: Messages, folder: Path) -> Path:
    """An MCAP file by mcap-ros2-support, which serialises by itself."""
    from mcap_ros2.writer import Writer

    path = folder / "robot.mcap"
    schemas: dict[str, Any] = {}
    with path.open("wb") as file:
        writer = Writer(file)
        for message in messages:
            if message.type not in schemas:
                text, _ = ROS2.generate_msgdef(message.type, ros_version=2)
                schemas[message.type] = writer.register_msgdef(message.type, text)
            built = _plain(made(ROS2, message.type, message.fields))
            writer.write_message(message.topic, schemas[message.type], built, message.time)
        writer.finish()
    return path


def _plain(value: Any) -> Any:
    """A message of rosbags without numpy."""
    if isinstance(value, np.ndarray):
        return value.tobytes() if value.dtype == np.uint8 else value.tolist()
    if isinstance(value, list):
        return [_plain(one) for one in value]
    if hasattr(value, "__msgtype__"):
        fields = (name for name in value.__dataclass_fields__ if name != "__msgtype__")
        return {name: _plain(getattr(value, name)) for name in fields}
    return value


def mcap(
    profile: str,
    encoding: str,
    *,
    compression: CompressionType = CompressionType.ZSTD,
    name: str = "robot.mcap",
    definitions: bool = True,
    **options: Any,
) -> Container:
    """An MCAP file by mcap's own writer, its channels in ROS' encodings."""
    types = ROS1 if encoding == "ros1" else ROS2

    def write(messages: Messages, folder: Path) -> Path:
        path, channels = folder / name, dict[str, int]()
        with path.open("wb") as file:
            writer = McapWriter(file, compression=compression, **options)
            writer.start(profile)
            for message in messages:
                if message.topic not in channels:
                    version = 1 if encoding == "ros1" else 2
                    text, _ = types.generate_msgdef(message.type, ros_version=version)
                    kind = message.type.replace("/msg/", "/") if version == 1 else message.type
                    known = text.encode() if definitions else b""
                    schema = writer.register_schema(kind, f"ros{version}msg", known)
                    channels[message.topic] = writer.register_channel(
                        message.topic, encoding, schema
                    )
                data = encoded(types, message)
                writer.add_message(channels[message.topic], message.time, data, message.time)
            writer.finish()
        return path

    return write


def foxglove(message: Message) -> tuple[str, dict[str, Any]] | None:
    """A message in Foxglove's schemas; None where it has none for it."""
    fields = message.fields
    if message.type == TF:
        links = [
            {
                "timestamp": one["header"]["stamp"],
                "parent_frame_id": one["header"]["frame_id"],
                "child_frame_id": one["child_frame_id"],
                **one["transform"],
            }
            for one in fields["transforms"]
        ]
        return "FrameTransforms", {"transforms": links}
    start = {"timestamp": fields["header"]["stamp"], "frame_id": fields["header"]["frame_id"]}
    if message.type == CAMERA_INFO:
        numbers = {name.upper(): list(map(float, fields[name])) for name in "dkrp"}
        sizes = {name: fields[name] for name in ("width", "height", "distortion_model")}
        return "CameraCalibration", {**start, **sizes, **numbers}
    if message.type == IMAGE:
        names = ("width", "height", "encoding", "step")
        rest = {name: fields[name] for name in names}
        return "RawImage", {**start, **rest, "data": fields["data"].tobytes()}
    if message.type == COMPRESSED:
        data = np.asarray(fields["data"], np.uint8).tobytes()
        return "CompressedImage", {**start, "format": fields["format"], "data": data}
    if message.type == POSE:
        return "PoseInFrame", {**start, "pose": fields["pose"]}
    return None


def mcap_protobuf(messages: Messages, folder: Path) -> Path:
    """An MCAP file by mcap-protobuf-support, with Foxglove's schemas."""
    from mcap_protobuf.writer import Writer

    path = folder / "robot.mcap"
    with path.open("wb") as file, Writer(file) as writer:
        for message in messages:
            said = foxglove(message)
            if said is not None:
                built = protobuf(*said)
                writer.write_message(message.topic, built, message.time, message.time)
    return path


def protobuf(schema: str, fields: dict[str, Any]) -> Any:
    """A protobuf message of foxglove-schemas-protobuf."""
    from importlib import import_module

    module = import_module(f"foxglove_schemas_protobuf.{schema}_pb2")
    return _filled(getattr(module, schema)(), fields)


def _filled(built: Any, fields: dict[str, Any]) -> Any:
    for name, value in fields.items():
        if name == "timestamp":
            built.timestamp.seconds, built.timestamp.nanos = value["sec"], value["nanosec"]
        elif name == "transforms":
            for one in value:
                _filled(built.transforms.add(), one)
        elif isinstance(value, dict):
            _filled(getattr(built, name), value)
        elif isinstance(value, list):
            getattr(built, name).extend(value)
        else:
            setattr(built, name, value)
    return built


def as_json(schema: str, fields: dict[str, Any]) -> bytes:
    """A message as Foxglove's JSON schemas have it."""

    def plain(value: Any) -> Any:
        if isinstance(value, dict):
            renamed = {("nsec" if key == "nanosec" else key): v for key, v in value.items()}
            return {key: plain(v) for key, v in renamed.items()}
        if isinstance(value, list):
            return [plain(one) for one in value]
        return base64.b64encode(value).decode() if isinstance(value, bytes) else value

    return json.dumps(plain(fields)).encode()


def mcap_json(messages: Messages, folder: Path) -> Path:
    """An MCAP file by mcap's own writer, with Foxglove's schemas in JSON."""
    path, channels = folder / "robot.mcap", dict[str, int]()
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start("")
        for message in messages:
            said = foxglove(message)
            if said is None:
                continue
            if message.topic not in channels:
                text = json.dumps({"title": f"foxglove.{said[0]}", "type": "object"}).encode()
                schema = writer.register_schema(f"foxglove.{said[0]}", "jsonschema", text)
                channels[message.topic] = writer.register_channel(message.topic, "json", schema)
            data = as_json(*said)
            writer.add_message(channels[message.topic], message.time, data, message.time)
        writer.finish()
    return path
