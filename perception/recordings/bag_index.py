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

from kg.errors import RecordingError
from perception.recordings.bag_file import BagFile, RawMessage
from perception.ros.headers import NANOSECONDS, frame_name, nanoseconds
from perception.ros.images import ImageKind, image_kind
from perception.ros.transform_tree import TransformTree

IMAGES: Final = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
CAMERA: Final = "sensor_msgs/msg/CameraInfo"
TRANSFORMS: Final = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
ODOMETRY: Final = "nav_msgs/msg/Odometry"
POSES: Final = ("geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseWithCovarianceStamped")
STRING: Final = "std_msgs/msg/String"
EARLIEST: Final = 1  # [ns] when a message may be recorded; `rosbag play` leaves out those at 0
NOTE_TOPIC: Final = "/hereabouts/recording"  # what `hereabouts convert` adds to ROS' own messages


class Decoder(Protocol):
    """What messages are decoded by: an open bag, or a live connection."""

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
class BagIndex:
    """All of a bag but its images."""

    path: Path | str  # of the bag, or where messages come from
    streams: dict[str, Stream] = field(default_factory=dict)
    others: dict[str, tuple[str, int]] = field(default_factory=dict)  # topic -> type, messages
    tree: TransformTree = field(default_factory=TransformTree)
    poses: dict[str, list[Any]] = field(default_factory=dict)  # topic -> pose messages
    note: dict[str, Any] | None = None  # what `hereabouts convert` wrote
    refused: list[str] = field(default_factory=list)  # transforms that make no sense, the first few


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
    try:
        index.tree.add_message(bag.decoded(raw), static=raw.topic.endswith("tf_static"))
    except RecordingError as error:
        index.refused.append(str(error))


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
        index.poses.setdefault(raw.topic, []).append(message)
    stamp = nanoseconds(message.header) if message else header_stamp(raw, bag.is_ros1, index.path)
    stream.times.append(raw.time)
    stream.stamps.append(stamp or (raw.time if raw.time > EARLIEST else 0))


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
