"""Foxglove's schemas, in protobuf or JSON, as the messages of ROS with the same content.

The fields' numbers and names are Foxglove's own (foxglove.dev/docs/sdk/schemas); definitions in a
file are not looked at.
"""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Callable, Iterator, Mapping
from types import SimpleNamespace
from typing import Any, Final

ENCODINGS: Final = ("protobuf", "json")
#: types of ROS by the schemas that are read
ROS_TYPES: Final = {
    "foxglove.RawImage": "sensor_msgs/msg/Image",
    "foxglove.CompressedImage": "sensor_msgs/msg/CompressedImage",
    "foxglove.CameraCalibration": "sensor_msgs/msg/CameraInfo",
    "foxglove.FrameTransform": "tf2_msgs/msg/TFMessage",
    "foxglove.FrameTransforms": "tf2_msgs/msg/TFMessage",
    "foxglove.PoseInFrame": "geometry_msgs/msg/PoseStamped",
}
#: fields by schema: number in protobuf, then a plain kind or the schema of a part; [] repeats it
_STAMPED: Final = {"timestamp": (1, "Time")}
_SCHEMAS: Final[Mapping[str, Mapping[str, tuple[int, str]]]] = {
    "Time": {"sec": (1, "int"), "nsec": (2, "int")},
    "Vector3": {"x": (1, "double"), "y": (2, "double"), "z": (3, "double")},
    "Quaternion": {name: (i, "double") for i, name in enumerate("xyzw", 1)},
    "Pose": {"position": (1, "Vector3"), "orientation": (2, "Quaternion")},
    "RawImage": _STAMPED
    | {
        "width": (2, "int"),
        "height": (3, "int"),
        "encoding": (4, "string"),
        "step": (5, "int"),
        "data": (6, "bytes"),
        "frame_id": (7, "string"),
    },
    "CompressedImage": _STAMPED
    | {"data": (2, "bytes"), "format": (3, "string"), "frame_id": (4, "string")},
    "CameraCalibration": _STAMPED
    | {"width": (2, "int"), "height": (3, "int"), "distortion_model": (4, "string")}
    | {name: (i, "double[]") for i, name in enumerate("DKRP", 5)}
    | {"frame_id": (9, "string")},
    "FrameTransform": _STAMPED
    | {
        "parent_frame_id": (2, "string"),
        "child_frame_id": (3, "string"),
        "translation": (4, "Vector3"),
        "rotation": (5, "Quaternion"),
    },
    "FrameTransforms": {"transforms": (1, "FrameTransform[]")},
    "PoseInFrame": _STAMPED | {"frame_id": (2, "string"), "pose": (3, "Pose")},
}
_EMPTY: Final[Mapping[str, Any]] = {"int": 0, "double": 0.0, "string": "", "bytes": b""}


def ros_type(schema: str) -> str:
    """Type of ROS 2 of a schema: sensor_msgs/msg/Image for sensor_msgs/Image, and Foxglove's."""
    if schema in ROS_TYPES:
        return ROS_TYPES[schema]
    package, _, name = schema.partition("/")
    is_whole = not name or name.startswith(("msg/", "action/"))
    return schema if is_whole else f"{package}/msg/{name}"


def decoded_foxglove(data: bytes, schema: str, encoding: str) -> Any:
    """The message of ROS for one of Foxglove's; raises ValueError where it is malformed."""
    name = schema.removeprefix("foxglove.")
    if encoding == "json":
        fields = _from_json(json.loads(data), name)
    else:
        fields = _from_protobuf(memoryview(data), name)
    return _MAKE.get(name, _stamped)(fields)


def _from_json(given: Any, schema: str) -> SimpleNamespace:
    if not isinstance(given, dict):
        raise ValueError(f"{schema} is no JSON object")
    fields = {}
    for name, (_, kind) in _SCHEMAS[schema].items():
        value, part = given.get(name), kind.removesuffix("[]")
        if kind.endswith("[]"):
            items = value if isinstance(value, list) else []
            fields[name] = [_json_value(one, part) for one in items]
        else:
            fields[name] = _json_value(value, part)
    return SimpleNamespace(**fields)


def _json_value(value: Any, kind: str) -> Any:
    if kind in _SCHEMAS:
        return _from_json(value or {}, kind)
    if kind == "bytes":
        return base64.b64decode(value or "")
    return type(_EMPTY[kind])(_EMPTY[kind] if value is None else value)


def _from_protobuf(data: memoryview, schema: str) -> SimpleNamespace:
    numbers = {number: (name, kind) for name, (number, kind) in _SCHEMAS[schema].items()}
    fields: dict[str, Any] = {}
    for number, value in _wire_fields(data):
        if number not in numbers:
            continue
        name, kind = numbers[number]
        part = kind.removesuffix("[]")
        if kind == part:
            fields[name] = _wire_value(value, part)
        elif part == "double":  # packed, or one by one
            fields.setdefault(name, []).extend(v for (v,) in struct.iter_unpack("<d", value))
        else:
            fields.setdefault(name, []).append(_wire_value(value, part))
    for name, (_, kind) in _SCHEMAS[schema].items():
        if name not in fields:
            empty = b"" if kind in _SCHEMAS else _EMPTY.get(kind)
            fields[name] = [] if kind.endswith("[]") else _wire_value(empty, kind)
    return SimpleNamespace(**fields)


def _wire_value(value: Any, kind: str) -> Any:
    if kind in _SCHEMAS:
        return _from_protobuf(memoryview(value), kind)
    if kind == "double" and not isinstance(value, float):
        return struct.unpack("<d", value)[0]
    if kind == "int" and not isinstance(value, int):
        return int.from_bytes(value, "little")
    return str(value, "utf-8") if kind == "string" and not isinstance(value, str) else value


def _wire_fields(data: memoryview) -> Iterator[tuple[int, Any]]:
    """Number and value of each field: an int, or bytes of it."""
    at = 0
    while at < len(data):
        tag, at = _varint(data, at)
        wire = tag & 7
        if wire == 0:
            value, at = _varint(data, at)
            yield tag >> 3, value
            continue
        if wire == 2:
            size, at = _varint(data, at)
        else:
            size = {1: 8, 5: 4}.get(wire, -1)
        if size < 0 or at + size > len(data):
            raise ValueError("a field of protobuf is cut short")
        yield tag >> 3, data[at : at + size]
        at += size


def _varint(data: memoryview, at: int) -> tuple[int, int]:
    value = shift = 0
    while at < len(data) and shift < 70:
        byte = data[at]
        value |= (byte & 127) << shift
        at, shift = at + 1, shift + 7
        if byte < 128:
            return value, at
    raise ValueError("a number of protobuf is cut short")


def _header(fields: SimpleNamespace, frame: str) -> SimpleNamespace:
    time = fields.timestamp
    return SimpleNamespace(stamp=SimpleNamespace(sec=time.sec, nanosec=time.nsec), frame_id=frame)


def _stamped(fields: SimpleNamespace) -> SimpleNamespace:
    """A message whose other fields are those of ROS."""
    fields.header = _header(fields, fields.frame_id)
    fields.is_bigendian = False
    return fields


def _camera(fields: SimpleNamespace) -> SimpleNamespace:
    fields.roi = SimpleNamespace(width=0, height=0, x_offset=0, y_offset=0)
    return _stamped(fields)


def _link(fields: SimpleNamespace) -> SimpleNamespace:
    return SimpleNamespace(
        header=_header(fields, fields.parent_frame_id),
        child_frame_id=fields.child_frame_id,
        transform=SimpleNamespace(translation=fields.translation, rotation=fields.rotation),
    )


_MAKE: Final[Mapping[str, Callable[[SimpleNamespace], Any]]] = {
    "CameraCalibration": _camera,
    "FrameTransform": lambda fields: SimpleNamespace(transforms=[_link(fields)]),
    "FrameTransforms": lambda fields: SimpleNamespace(
        transforms=[_link(one) for one in fields.transforms]
    ),
}
