"""Recordings in bags: ROS 1, ROS 2 (SQLite, MCAP) and plain MCAP files.

Colour and depth are paired by nearest stamps; the pose is that of colour's frame in the map frame
at colour's stamp, from tf or a topic of poses. World frames have z up (REP 103).
"""

from __future__ import annotations

import logging
import threading
from collections import OrderedDict
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from perception.camera.image_decoding import MILLIMETRES, metres
from perception.camera.intrinsics import Intrinsics
from perception.camera.poses import checked_pose
from perception.sources.association import nearest_pairs
from perception.sources.bags.bag_file import BagFile, RawMessage, bag_path
from perception.sources.bags.bag_index import BagIndex, Stream, read_index
from perception.sources.bags.bag_topics import (
    camera_topic,
    colour_topic,
    depth_topic,
    map_frame,
    pose_topic,
)
from perception.sources.listing import (
    DepthCamera,
    Format,
    FrameEntry,
    RecordingListing,
    Streams,
)
from perception.sources.ros.camera_info import intrinsics_of
from perception.sources.ros.headers import NANOSECONDS
from perception.sources.ros.images import colour_image, depth_image

SUFFIXES: Final = ".bag, .mcap, .db3"
AHEAD: Final = 2 * NANOSECONDS  # [ns] further on in the bag is sought instead of read on to
HELD: Final = 1 << 26  # [bytes] of messages passed on the way that are kept, for the other stream

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Choice:
    """The streams of a bag that make its frames."""

    colour: Stream
    depth: Stream
    camera: Stream | None
    depth_camera: Stream | None
    pose: Stream | None  # None: tf
    map_frame: str
    depth_apart: bool  # whether depth lies in another frame than colour, and is registered


def matches(path: Path) -> bool:
    """Whether `path` is a bag, or a folder with one."""
    return bag_path(path) is not None


def read(path: Path, streams: Streams) -> RecordingListing:
    """All colour images that have depth and a pose; the others are skipped with a warning.

    Raises RecordingError where the bag is damaged, or topics, camera or transforms are missing.
    """
    index = read_index(opened(path))
    return listing_of(index, choose(index, streams), streams)


def opened(path: Path) -> Path:
    """The bag that is `path`, or lies in it; raises RecordingError where there is none."""
    found = bag_path(path)
    if found is None:
        raise RecordingError(f"{path} is no bag ({SUFFIXES}, or a folder with metadata.yaml)")
    return found


def choose(index: BagIndex, streams: Streams) -> Choice:
    """The streams to read; raises RecordingError where one is missing."""
    colour = colour_topic(index, streams.colour)
    depth = depth_topic(index, streams.depth, colour)
    pose = _posed(index, colour, streams)
    if index.refused:
        _log.warning(
            "%s: %d transforms or poses that make no sense are skipped: %s",
            index.path,
            index.refused,
            index.refusal,
        )
    depth_camera = camera_topic(index, depth)
    return Choice(
        colour,
        depth,
        camera_topic(index, colour, streams.camera),
        depth_camera,
        pose,
        map_frame(index, colour.frame, streams.map_frame or _noted_frame(index)),
        _is_apart(index, colour, depth),
    )


def _posed(index: BagIndex, colour: Stream, streams: Streams) -> Stream | None:
    """Add the poses of a topic to the tree where they are asked for, or tf has none."""
    above = index.tree.ancestors(colour.frame)
    reached = streams.map_frame is None or streams.map_frame.lstrip("/") in above
    moving = any(not index.tree.is_static(frame) for frame in above[:-1])
    if streams.pose is None and reached and moving:
        return None
    pose = pose_topic(index, streams.pose)
    if pose is None:
        if index.tree.parent(colour.frame) is not None:
            return None
        raise RecordingError(
            f"{index.path} has no poses: no transforms of {colour.frame!r}, and no odometry or "
            "pose topic"
        )
    add_poses(index, pose.topic, colour.frame)
    return pose


def add_poses(index: BagIndex, topic: str, camera: str) -> None:
    """Add the poses of a topic to the tree; poses without a child frame are the camera's own."""
    found = index.poses[topic]
    child = found.child or camera
    for place, stamp in enumerate(found.stamps):
        numbers = found.rows[7 * place : 7 * place + 7]
        try:
            index.tree.add(found.parent, child, stamp, numbers)
        except RecordingError as error:
            index.refuse(str(error))
    index.tree.prefer(found.parent, child)


def _is_apart(index: BagIndex, colour: Stream, depth: Stream) -> bool:
    if depth.frame == colour.frame:
        return False
    try:
        index.tree.at(colour.frame, depth.frame, depth.stamps[0] / NANOSECONDS)
    except RecordingError as error:
        _log.warning(
            "%s: depth is taken for registered to colour, though it is in another frame: %s",
            index.path,
            error,
        )
        return False
    return True


def listing_of(index: BagIndex, choice: Choice, streams: Streams) -> RecordingListing:
    """Entries of the chosen streams; raises RecordingError where nothing fits together."""
    entries = _entries(index, choice, streams)
    camera = camera_of(index, choice.camera, choice.colour)
    noted = _noted(index, "T_map_world") if choice.map_frame == _noted_frame(index) else None
    return RecordingListing(
        entries,
        camera,
        MILLIMETRES,
        depth_camera_of(index, choice, entries[0].stamp) if choice.depth_apart else None,
        up=np.array([0.0, 0.0, 1.0]),
        T_map_world=None if noted is None else _transform(noted, index.path),
    )


def _entries(index: BagIndex, choice: Choice, streams: Streams) -> tuple[FrameEntry, ...]:
    colour, depth = choice.colour, choice.depth
    stamps = colour.seconds
    pairs = sorted(
        nearest_pairs(stamps, depth.seconds, streams.tolerance), key=lambda ij: stamps[ij[0]]
    )
    if not pairs:
        raise RecordingError(
            f"{index.path}: no stamps of {colour.topic} and {depth.topic} lie within "
            f"{streams.tolerance:g} s"
        )
    source = MessageSource(Path(index.path), (colour.topic, depth.topic))
    images = _images(source, colour), _images(source, depth)
    ids = _noted(index, "frames")
    named = isinstance(ids, list) and len(ids) == len(pairs) and all(map(_is_name, ids))
    named = named and len(set(ids)) == len(ids)
    entries: list[FrameEntry] = []
    for place, (i, j) in enumerate(pairs):
        T = index.tree.at(choice.map_frame, colour.frame, float(stamps[i]))
        repeated = bool(entries) and entries[-1].stamp == stamps[i]
        if T is not None and not repeated:
            id_ = ids[place] if named else _frame_id(colour.stamps[i])
            entries.append(FrameEntry(id_, images[0][i], images[1][j], T, float(stamps[i])))
    if not entries:
        span = index.tree.span(choice.map_frame, colour.frame)
        reach = "" if span is None else f"; transforms reach from {span[0]:.3f} to {span[1]:.3f}"
        raise RecordingError(
            f"{index.path}: none of the {len(pairs)} images has a pose of {colour.frame!r} in "
            f"{choice.map_frame!r} (images: {stamps.min():.3f} to {stamps.max():.3f}{reach})"
        )
    if len(entries) < len(stamps):
        _log.warning(
            "%s: %d of %d images have no depth within %g s or no pose and are skipped",
            index.path,
            len(stamps) - len(entries),
            len(stamps),
            streams.tolerance,
        )
    return tuple(entries)


def _frame_id(stamp: int) -> str:
    return f"{stamp // NANOSECONDS}.{stamp % NANOSECONDS:09d}"


def _is_name(text: Any) -> bool:
    """Whether a frame's noted name may be a file's name."""
    return isinstance(text, str) and 0 < len(text) < 200 and not set(text) & set("/\\\0\n\r")


def camera_of(index: BagIndex, info: Stream | None, images: Stream) -> Intrinsics | None:
    """Camera of a stream of images by its CameraInfo; None where it has none."""
    if info is None:
        return None
    where = f"{index.path}, {info.topic}"
    return intrinsics_of(info.first, where, rectified="rect" in images.topic.split("/image")[-1])


def depth_camera_of(index: BagIndex, choice: Choice, stamp: float) -> DepthCamera:
    """Camera of the depth images, where it is apart from colour's; raises RecordingError."""
    camera = camera_of(index, choice.depth_camera, choice.depth)
    if camera is None:
        raise RecordingError(
            f"{index.path}: {choice.depth.topic} is in frame {choice.depth.frame!r}, not in "
            f"colour's {choice.colour.frame!r}, and has no CameraInfo to register it by"
        )
    T = index.tree.at(choice.colour.frame, choice.depth.frame, stamp)
    if T is None:
        raise RecordingError(
            f"{index.path}: no transform of {choice.depth.frame!r} to {choice.colour.frame!r} at "
            f"{stamp:.3f}"
        )
    return DepthCamera(camera, T)


def _noted(index: BagIndex, key: str) -> Any:
    return None if index.note is None else index.note.get(key)


def _noted_frame(index: BagIndex) -> str | None:
    frame = _noted(index, "frame")
    return frame if isinstance(frame, str) and frame else None


def _transform(numbers: Any, path: Path | str) -> NDArray[np.float64]:
    where = f"{path}: the noted T_map_world"
    try:
        T = np.array(numbers, np.float64).reshape(4, 4)
    except (TypeError, ValueError, OverflowError) as error:
        raise RecordingError(f"{where} is no 4x4 matrix") from error
    checked_pose(T, where)
    return T


@dataclass(frozen=True, slots=True)
class BagImage:
    """An image of a recording that is a message of a bag."""

    source: MessageSource
    topic: str
    time: int  # [ns] at which it was recorded
    ordinal: int  # which of the topic's messages of that time

    def __str__(self) -> str:
        return f"{self.source.path}, {self.topic} at {_frame_id(self.time)}"

    def check(self) -> None:
        """Nothing: bags keep no checksum of a message."""

    def colour(self) -> NDArray[np.uint8]:
        """(H, W, 3) RGB; raises RecordingError for an unreadable image."""
        return colour_image(self.source.message(self.topic, self.time, self.ordinal), str(self))

    def depth(self, depth_scale: float) -> NDArray[np.float32]:
        """(H, W) [m], nan = no return; `depth_scale` [units a metre] is that of 16-bit images."""
        message = self.source.message(self.topic, self.time, self.ordinal)
        return metres(depth_image(message, str(self)), depth_scale)


def _images(source: MessageSource, stream: Stream) -> list[BagImage]:
    images: list[BagImage] = []
    for time in stream.times:
        same = bool(images) and images[-1].time == time
        images.append(BagImage(source, stream.topic, time, images[-1].ordinal + 1 if same else 0))
    return images


@dataclass(frozen=True, slots=True, eq=False)
class MessageSource:
    """Messages of a bag, in any order; fast in the order in which they were recorded."""

    path: Path
    topics: tuple[str, ...]
    _open: threading.local = field(default_factory=threading.local)  # a reader for each thread

    def message(self, topic: str, time: int, ordinal: int) -> Any:
        """The `ordinal`-th message of `topic` recorded at `time` [ns]."""
        if not hasattr(self._open, "tape"):
            self._open.tape = _Tape(BagFile(self.path), self.topics)
        return self._open.tape.message((topic, time, ordinal))


_Key = tuple[str, int, int]


class _Tape:
    """A bag read from message to message; messages passed on the way are kept for a while."""

    def __init__(self, bag: BagFile, topics: tuple[str, ...]) -> None:
        self._bag = bag
        self._topics = topics
        self._wind(None)

    def _wind(self, start: int | None) -> None:
        self._messages = self._bag.messages(self._topics, start)
        self._passed = OrderedDict[_Key, RawMessage]()
        self._held = 0  # [bytes]
        self._last: dict[str, tuple[int, int]] = {}
        self._now = start or 0

    def message(self, key: _Key) -> Any:
        raw = self._passed.pop(key, None)
        if raw is not None:
            self._held -= len(raw.data)
        else:
            if not self._now <= key[1] <= self._now + AHEAD:
                self._wind(key[1])
            raw = self._found(key)
        if raw is None:  # passed before, and not kept
            self._wind(key[1])
            raw = self._found(key)
        if raw is None:
            raise RecordingError(f"{self._bag.path}: a message of {key[0]} is gone")
        return self._bag.decoded(raw)

    def _found(self, key: _Key) -> RawMessage | None:
        for raw in self._messages:
            time, ordinal = self._last.get(raw.topic, (-1, 0))
            ordinal = ordinal + 1 if time == raw.time else 0
            self._last[raw.topic] = (raw.time, ordinal)
            self._now = raw.time
            found = (raw.topic, raw.time, ordinal)
            if found == key:
                return raw
            self._passed[found] = raw
            self._held += len(raw.data)
            while self._held > HELD:
                self._held -= len(self._passed.popitem(last=False)[1].data)
            if raw.time > key[1]:
                return None
        return None


FORMAT = Format("bag", "a ROS 1 or ROS 2 bag or an MCAP file", matches, read)
