"""Index of a bag: its streams, stamps, cameras and transforms, from one pass over its messages."""

from __future__ import annotations

import logging
import struct
from array import array
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from perception.number_tables import json_object
from perception.sources.bags.bag_file import BagFile, RawMessage
from perception.sources.bags.librealsense import IMAGE, TEXT, LibrealsenseText
from perception.sources.ros.image_messages import (
    NANOSECONDS,
    ImageKind,
    frame_name,
    image_kind,
    is_calibrated,
    nanoseconds,
)
from perception.sources.ros.message_types import RGBD_IMAGES
from perception.sources.ros.transform_tree import TransformTree, pose_numbers

IMAGES: Final = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
WITH_IMAGES: Final = (*IMAGES, *RGBD_IMAGES)
CAMERA: Final = "sensor_msgs/msg/CameraInfo"
TRANSFORMS: Final = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
ODOMETRY: Final = "nav_msgs/msg/Odometry"
POSES: Final = (
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/TransformStamped",
)
PATH: Final = "nav_msgs/msg/Path"
ROS_ENCODINGS: Final = ("ros1", "cdr")
TF_NAMES: Final = ("tf", "tf_static")
STRING: Final = "std_msgs/msg/String"
WANTED: Final = frozenset((*IMAGES, CAMERA, *TRANSFORMS, ODOMETRY, *POSES, PATH))
MIN_TIME: Final = 1  # [ns] when a message may be recorded; `rosbag play` leaves out those at 0
SIMULATED: Final = 10**17  # [ns] stamps below count from the start of a simulation
SMALL: Final = 512  # [bytes] of a message of an image; smaller ones may have no pixels
STAMPED: Final = 12  # [bytes] of a message of ROS up to the end of its stamp
NOTE_TOPIC: Final = "/hereabouts/recording"  # what `hereabouts convert` adds to ROS' own messages
_log = logging.getLogger(__name__)


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
    run: int = 0  # place of the first that came after stamps jumped back


@dataclass(slots=True)
class BagIndex:
    """All of a bag but its images."""

    path: Path | str  # of the bag, or where messages come from
    streams: dict[str, Stream] = field(default_factory=dict)
    others: dict[str, tuple[str, int]] = field(default_factory=dict)  # topic -> type, messages
    kept: int | None = None  # transforms of a link; None: all
    trees: dict[str, TransformTree] = field(default_factory=dict)  # of tf, by its namespace
    poses: dict[str, PoseRows] = field(default_factory=dict)  # by topic
    note: dict[str, Any] | None = None  # what `hereabouts convert` wrote
    blank: int = 0  # images without any pixel, which are left out
    restarts: int = 0  # times that the stamps of images went back
    refused: int = 0  # transforms and poses that make no sense, ...
    refusal: str = ""  # ... and why, of the first
    text: LibrealsenseText = field(default_factory=LibrealsenseText)

    @property
    def tree(self) -> TransformTree:
        """Tree of /tf, else of the first namespace."""
        return self.trees.get("") or next(iter(self.trees.values()), None) or self.tree_of("")

    def tree_of(self, namespace: str) -> TransformTree:
        """Tree of a namespace of tf."""
        return self.trees.setdefault(namespace, TransformTree(self.kept))

    def robot(self, topic: str) -> str:
        """The robot of a topic: the longest namespace of tf that it lies in."""
        return max(
            (name for name in self.trees if topic.startswith(f"{name}/")), key=len, default=""
        )

    def refuse(self, why: str) -> None:
        """Count a transform or pose that makes no sense."""
        self.refused += 1
        self.refusal = self.refusal or why


def read_index(path: Path) -> BagIndex:
    """Index of the bag at `path`; raises RecordingError."""
    index = BagIndex(path)
    paths = dict[str, RawMessage]()
    with BagFile(path) as bag:
        if bag.cut_short:
            _log.warning("%s was cut short; it is read up to its last whole part", path)
        topics = {t.name for t in bag.topics if t.type in WANTED or t.name == NOTE_TOPIC}
        index.others = {t.name: (t.type, t.count) for t in bag.topics if t.name not in topics}
        if bag.is_ros1 and any(map(IMAGE.fullmatch, topics)):
            raise RecordingError(
                f"{path} was recorded by librealsense before 2.58, whose messages are not quite "
                "those of ROS; pyrealsense2 makes a file that works of it: "
                f"pyrealsense2.context().convert_bag_to_db3({str(path)!r}, "
                f"{str(path.with_suffix('.db3'))!r})"
            )
        topics |= {t.name for t in bag.topics if t.type == STRING and TEXT.fullmatch(t.name)}
        for raw in bag.messages(topics):
            if raw.type != PATH:
                add_message(index, bag, raw)
                continue
            # a path that grows is read once, whole
            before, paths[raw.topic] = paths.get(raw.topic), raw
            if before is not None and len(before.data) >= len(raw.data):
                add_message(index, bag, before)
        for raw in paths.values():
            add_message(index, bag, raw)
    if index.blank:
        _log.warning("%s: %d images without pixels are left out", path, index.blank)
    _use_text(index)
    return index


def _use_text(index: BagIndex) -> None:
    """Set the stamps of images, and missing cameras, from librealsense's text."""
    found = {m[1]: s for s in index.streams.values() if (m := IMAGE.fullmatch(s.topic))}
    stamps = index.text.stamps({sensor: images.times for sensor, images in found.items()})
    for sensor, images in found.items():
        images.stamps = stamps.get(sensor, images.stamps)
        topic, camera = f"{sensor}/image/camera_info", index.text.cameras.get(sensor)
        if camera is not None and topic not in index.streams:
            index.streams[topic] = Stream(topic, CAMERA, camera, frame=images.frame)


def add_message(index: BagIndex, bag: Decoder, raw: RawMessage) -> None:
    """Add a message; raises RecordingError where it cannot be decoded."""
    if raw.topic == NOTE_TOPIC:
        index.note = json_object(bag.decoded(raw).data, f"{index.path}: {NOTE_TOPIC}")
    elif raw.type == STRING:
        index.text.add(raw.topic, raw.time, str(bag.decoded(raw).data))
    elif raw.type in TRANSFORMS:
        _add_transforms(index, bag, raw)
    else:
        _add_stamped(index, bag, raw)


def _add_transforms(index: BagIndex, bag: Decoder, raw: RawMessage) -> None:
    stream = index.streams.setdefault(raw.topic, Stream(raw.topic, raw.type))
    stream.times.append(raw.time)
    stream.stamps.append(raw.time)
    namespace, _, name = raw.topic.rpartition("/")
    tree = index.tree_of(namespace if name in TF_NAMES else "")
    for why in tree.add_message(bag.decoded(raw), static=name.endswith("tf_static")):
        index.refuse(why)


def _add_stamped(index: BagIndex, bag: Decoder, raw: RawMessage) -> None:
    if raw.type in IMAGES and len(raw.data) < SMALL and not len(bag.decoded(raw).data):
        index.blank += 1
        return
    stream = index.streams.get(raw.topic)
    is_pose = raw.type in (ODOMETRY, *POSES, PATH)
    blank = stream is not None and raw.type == CAMERA and not is_calibrated(stream.first)
    message: Any = bag.decoded(raw) if stream is None or is_pose or blank else None
    if stream is None:
        stream = index.streams[raw.topic] = Stream(raw.topic, raw.type, message)
        stream.frame = frame_name(message.header.frame_id)
        stream.kind = image_kind(message) if raw.type in IMAGES else None
        if raw.type in IMAGES:
            stream.first = None  # pixels are not kept
    elif blank:  # a driver may know its camera only later
        stream.first = message
    if is_pose:
        _add_poses(index, raw.topic, message)
    stamp = nanoseconds(message.header) if message else stamp_of(bag, raw, index.path)
    if _begins_at_zero(stream, stamp):
        stream.stamps[0] = 0
    back = bool(stamp and stream.stamps) and stamp < stream.stamps[-1] - NANOSECONDS
    if back and raw.type in IMAGES:  # a simulation was started again: its last run counts
        del stream.times[:], stream.stamps[:]
        index.restarts += 1
    stream.times.append(raw.time)
    known = stamp or raw.time <= MIN_TIME or _is_simulated(stream)
    stream.stamps.append(stamp if known else raw.time)


def _is_simulated(stream: Stream) -> bool:
    """Whether the last stamp was that of a simulation, so that a stamp of zero is one, too."""
    return bool(stream.stamps) and abs(stream.stamps[-1]) < SIMULATED <= stream.times[-1]


def _begins_at_zero(stream: Stream, stamp: int) -> bool:
    """Whether the first stamp was zero as the time of a simulation, not for lack of a stamp."""
    first = stream.stamps[0] if len(stream.stamps) == 1 else 0
    return 0 < stamp < SIMULATED <= first == stream.times[0]


def _add_poses(index: BagIndex, topic: str, message: Any) -> None:
    parent, child = message.header.frame_id, getattr(message, "child_frame_id", "")
    rows = index.poses.setdefault(topic, PoseRows(parent, child))
    if (parent, child) != (rows.parent, rows.child):
        index.refuse(f"{topic} changes its frames: {rows.child!r} in {rows.parent!r} at first")
        return
    poses = getattr(message, "poses", None)
    stamp = nanoseconds(message.header)
    if poses is None and rows.stamps and stamp < rows.stamps[-1] - NANOSECONDS:
        rows.run = len(rows.stamps)
    for one in [message] if poses is None else poses:
        if hasattr(one, "transform"):
            place, turn = one.transform.translation, one.transform.rotation
        else:
            pose = one.pose.pose if hasattr(one.pose, "pose") else one.pose
            place, turn = pose.position, pose.orientation
        rows.rows.extend(pose_numbers(place, turn))
        rows.stamps.append(nanoseconds(one.header))


def stamp_of(bag: Decoder, raw: RawMessage, path: Path | str) -> int:
    """Stamp [ns] of a message; of one of ROS, which begins with its header, without the rest."""
    encoding = _encoding(bag, raw)
    if encoding not in ROS_ENCODINGS:
        return nanoseconds(bag.decoded(raw).header)
    try:
        if encoding == "ros1":
            _, sec, nsec = struct.unpack_from("<III", raw.data)
        else:
            order = "<" if raw.data[1] & 1 else ">"
            sec, nsec = struct.unpack_from(f"{order}iI", raw.data, 4)
    except (struct.error, IndexError) as error:
        raise RecordingError(f"{path}: a message of {raw.topic} is cut short") from error
    return int(sec) * NANOSECONDS + int(nsec)


def _encoding(bag: Decoder, raw: RawMessage) -> str:
    return raw.encoding or ("ros1" if bag.is_ros1 else "cdr")


def frame_of(bag: Decoder, raw: RawMessage, path: Path | str) -> str:
    """Frame of a message's header; of one of ROS, without decoding the rest."""
    encoding = _encoding(bag, raw)
    if encoding not in ROS_ENCODINGS:
        return str(bag.decoded(raw).header.frame_id)
    order = "<" if encoding == "ros1" or raw.data[1] & 1 else ">"
    if len(raw.data) < STAMPED + 4:
        raise RecordingError(f"{path}: a message of {raw.topic} is cut short")
    (size,) = struct.unpack_from(f"{order}I", raw.data, STAMPED)
    name = raw.data[STAMPED + 4 : STAMPED + 4 + size]
    return bytes(name).rstrip(b"\x00").decode("utf-8", "replace")
