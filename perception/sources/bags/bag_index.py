"""Index of a bag: its streams, stamps, cameras and transforms, from one pass over its messages."""

from __future__ import annotations

import json
import struct
from array import array
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from perception.sources.bags.bag_file import BagFile, RawMessage
from perception.sources.ros.headers import NANOSECONDS, frame_name, nanoseconds
from perception.sources.ros.images import ImageKind, image_kind
from perception.sources.ros.transform_tree import TransformTree, pose_numbers

IMAGES: Final = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
CAMERA: Final = "sensor_msgs/msg/CameraInfo"
TRANSFORMS: Final = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
ODOMETRY: Final = "nav_msgs/msg/Odometry"
POSES: Final = ("geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseWithCovarianceStamped")
STRING: Final = "std_msgs/msg/String"
MIN_TIME: Final = 1  # [ns] when a message may be recorded; `rosbag play` leaves out those at 0
NOTE_TOPIC: Final = "/hereabouts/recording"  # what `hereabouts convert` adds to ROS' own messages


class Decoder(Protocol):
    """Decoder of messages: an open bag, or a live connection."""

    @property
    def is_ros1(self) -> bool:
        """Whether they are serialised as ROS 1 does."""

    def decoded(self, raw: RawMessage) -> Any:
        """The message with its fields; raises RecordingError."""


@dataclass(slots=True)
class Stream:
    """A topic with stamped messages."""

    topic: str
    type: str
    first: Any = None  # its first message
    kind: ImageKind | None = None  # of images
    frame: str = ""  # frame of its first message
    times: array[int] = field(default_factory=lambda: array("q"))  # [ns] when recorded
    stamps: array[int] = field(default_factory=lambda: array("q"))  # [ns] of the headers

    @property
    def seconds(self) -> NDArray[np.float64]:
        """Stamps [s] (n,), in order of recording."""
        return np.array([stamp / NANOSECONDS for stamp in self.stamps])


@dataclass(slots=True)
class PoseRows:
    """Poses of one frame in another, of a topic that is not tf."""

    parent: str
    child: str  # "" where the messages name none
    rows: array[float] = field(default_factory=lambda: array("d"))  # x, y, z, qx, qy, qz, qw
    stamps: array[int] = field(default_factory=lambda: array("q"))  # [ns]


@dataclass(slots=True)
class BagIndex:
    """All of a bag but its images."""

    path: Path | str  # of the bag, or where messages come from
    streams: dict[str, Stream] = field(default_factory=dict)
    others: dict[str, tuple[str, int]] = field(default_factory=dict)  # topic -> type, messages
    tree: TransformTree = field(default_factory=TransformTree)
    poses: dict[str, PoseRows] = field(default_factory=dict)  # by topic
    note: dict[str, Any] | None = None  # what `hereabouts convert` wrote
    refused: int = 0  # transforms and poses that make no sense, ...
    refusal: str = ""  # ... and why, of the first

    def refuse(self, why: str) -> None:
        """Count a transform or pose that makes no sense."""
        self.refused += 1
        self.refusal = self.refusal or why


def read_index(path: Path) -> BagIndex:
    """Index of the bag at `path`; raises RecordingError."""
    index = BagIndex(path)
    wanted = {*IMAGES, CAMERA, *TRANSFORMS, ODOMETRY, *POSES}
    with BagFile(path) as bag:
        topics = {t.name for t in bag.topics if t.type in wanted or t.name == NOTE_TOPIC}
        index.others = {t.name: (t.type, t.count) for t in bag.topics if t.name not in topics}
        for raw in bag.messages(topics):
            add_message(index, bag, raw)
    return index


def add_message(index: BagIndex, bag: Decoder, raw: RawMessage) -> None:
    """Add a message; raises RecordingError where it cannot be decoded."""
    if raw.topic == NOTE_TOPIC:
        index.note = _note(bag.decoded(raw), index.path)
    elif raw.type in TRANSFORMS:
        _add_transforms(index, bag, raw)
    else:
        _add_stamped(index, bag, raw)


def _add_transforms(index: BagIndex, bag: Decoder, raw: RawMessage) -> None:
    stream = index.streams.setdefault(raw.topic, Stream(raw.topic, raw.type))
    stream.times.append(raw.time)
    stream.stamps.append(raw.time)
    static = raw.topic.endswith("tf_static")
    for why in index.tree.add_message(bag.decoded(raw), static=static):
        index.refuse(why)


def _add_stamped(index: BagIndex, bag: Decoder, raw: RawMessage) -> None:
    stream = index.streams.get(raw.topic)
    is_pose = raw.type == ODOMETRY or raw.type in POSES
    message: Any = bag.decoded(raw) if stream is None or is_pose else None
    if stream is None:
        stream = index.streams[raw.topic] = Stream(raw.topic, raw.type, message)
        stream.frame = frame_name(message.header.frame_id)
        stream.kind = image_kind(message) if raw.type in IMAGES else None
        if raw.type in IMAGES:
            stream.first = None  # pixels are not kept
    if is_pose:
        _add_pose(index, raw.topic, message)
    stamp = nanoseconds(message.header) if message else header_stamp(raw, bag.is_ros1, index.path)
    stream.times.append(raw.time)
    stream.stamps.append(stamp or (raw.time if raw.time > MIN_TIME else 0))


def _add_pose(index: BagIndex, topic: str, message: Any) -> None:
    parent, child = message.header.frame_id, getattr(message, "child_frame_id", "")
    rows = index.poses.setdefault(topic, PoseRows(parent, child))
    if (parent, child) != (rows.parent, rows.child):
        index.refuse(f"{topic} changes its frames: {rows.child!r} in {rows.parent!r} at first")
        return
    pose = message.pose.pose if hasattr(message.pose, "pose") else message.pose
    rows.rows.extend(pose_numbers(pose.position, pose.orientation))
    rows.stamps.append(nanoseconds(message.header))


def header_stamp(raw: RawMessage, is_ros1: bool, path: Path | str) -> int:
    """Stamp [ns] of a message that begins with a header, without decoding the rest."""
    try:
        if is_ros1:
            _, sec, nsec = struct.unpack_from("<III", raw.data)
        else:
            order = "<" if raw.data[1] & 1 else ">"
            sec, nsec = struct.unpack_from(f"{order}iI", raw.data, 4)
    except (struct.error, IndexError) as error:
        raise RecordingError(f"{path}: a message of {raw.topic} is cut short") from error
    return int(sec) * NANOSECONDS + int(nsec)


def _note(message: Any, path: Path | str) -> dict[str, Any]:
    try:
        note = json.loads(message.data)
    except (ValueError, RecursionError) as error:
        raise RecordingError(f"{path}: {NOTE_TOPIC} holds no JSON: {error}") from error
    if not isinstance(note, dict):
        raise RecordingError(f"{path}: {NOTE_TOPIC} holds no JSON object")
    return note
