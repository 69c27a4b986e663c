"""Bags on disk: ROS 1 bags, ROS 2 bags (folder or file, SQLite or MCAP), read without ROS.

No other module reads with the package `rosbags`. Messages are decoded by the definitions that ship
with it, never by the definitions in a file, so that no code is made from the content of a file.
"""

from __future__ import annotations

import bz2
import contextlib
import functools
import weakref
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from kg.model.errors import RecordingError
from kg.model.regular_files import SQLITE_STEPS, StepLimit, check_regular

MAX_CHUNK: Final = 1 << 29  # [bytes] decompressed
MAX_FILE: Final = 1 << 44  # [bytes] of a bag, which is read in parts
MAX_METADATA: Final = 1 << 24  # [bytes] of the list of a bag's files
_FILES: Final = (".mcap", ".db3")
_ROS1: Final = ".bag"
_TRANSFORMS: Final = "geometry_msgs/TransformStamped[] transforms"
_ACTION: Final = "Header header\nactionlib_msgs/"
#: messages of ROS 1 that rosbags does not define: tf2, tf of old bags, and goals of move_base
_ROS1_TYPES: Final = {
    "tf2_msgs/msg/TFMessage": _TRANSFORMS,
    "tf/msg/tfMessage": _TRANSFORMS,
    "move_base_msgs/msg/MoveBaseGoal": "geometry_msgs/PoseStamped target_pose",
    "move_base_msgs/msg/MoveBaseResult": "",
    "move_base_msgs/msg/MoveBaseFeedback": "geometry_msgs/PoseStamped base_position",
    "move_base_msgs/msg/MoveBaseActionGoal": f"{_ACTION}GoalID goal_id\nMoveBaseGoal goal",
    "move_base_msgs/msg/MoveBaseActionResult": f"{_ACTION}GoalStatus status\nMoveBaseResult result",
    "move_base_msgs/msg/MoveBaseActionFeedback": (
        f"{_ACTION}GoalStatus status\nMoveBaseFeedback feedback"
    ),
}


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic of a bag."""

    name: str
    type: str  # e.g. sensor_msgs/msg/Image, of ROS 1 too
    count: int  # messages, as the bag's index says


@dataclass(frozen=True, slots=True)
class RawMessage:
    """A message of a bag as it lies there."""

    topic: str
    type: str
    time: int  # [ns] at which it was recorded
    data: bytes


def bag_path(path: Path) -> Path | None:
    """Path to open: `path` itself, or the one storage file in it; None where it is no bag."""
    if not path.is_dir():
        return path if path.suffix in (_ROS1, *_FILES) else None
    if (path / "metadata.yaml").is_file():
        return path
    inner = [p for p in path.iterdir() if p.suffix in (_ROS1, *_FILES) and p.is_file()]
    return inner[0] if len(inner) == 1 else None


class BagFile:
    """An open bag; close it, or use `with`. It belongs to the thread that opened it.

    Raises RecordingError, here and on reading, for what is no bag, is damaged or truncated.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.is_ros1 = path.suffix == _ROS1
        try:
            if not path.is_dir():
                check_regular(path, MAX_FILE)
            else:
                check_regular(path / "metadata.yaml", MAX_METADATA)
        except OSError as error:
            raise RecordingError(f"cannot read {path}: {error.strerror}") from error
        self._limit = StepLimit(path)
        with _errors(path):
            self._reader = _reader(path)
            with _limited_sqlite(self._limit):
                self._reader.open()
        self.close = weakref.finalize(self, _close, self._reader)
        counts: dict[str, tuple[str, int]] = {}
        for connection in self._reader.connections:
            before = counts.get(connection.topic, ("", 0))[1]
            counts[connection.topic] = (connection.msgtype, before + connection.msgcount)
        self.topics = tuple(Topic(name, *counts[name]) for name in sorted(counts))

    def __enter__(self) -> BagFile:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def messages(self, topics: Collection[str], start: int | None = None) -> Iterator[RawMessage]:
        """Messages of `topics` in order of recording, from the time `start` [ns] on."""
        chosen = [one for one in self._reader.connections if one.topic in topics]
        if not chosen:
            return
        self._limit.reset()
        with _errors(self.path):
            for connection, time, data in self._reader.messages(chosen, start=start):
                yield RawMessage(connection.topic, connection.msgtype, time, data)

    def decoded(self, raw: RawMessage) -> Any:
        """The message with its fields."""
        return decoded(raw, self.is_ros1, self.path)


def decoded(raw: RawMessage, is_ros1: bool, where: Path | str) -> Any:
    """A message with its fields; raises RecordingError, beginning with `where`."""
    with _errors(where, f"a message of {raw.topic}"):
        types = message_types(is_ros1)
        deserialize = types.deserialize_ros1 if is_ros1 else types.deserialize_cdr
        return deserialize(raw.data, raw.type)


def _close(reader: Any) -> None:
    with contextlib.suppress(Exception):
        reader.close()


def _reader(path: Path) -> Any:
    try:
        from rosbags import rosbag1, rosbag2
    except ImportError as error:
        raise RecordingError(
            f"reading {path} needs the package rosbags: pip install 'hereabouts[ros]'"
        ) from error
    _bound_decompression()
    return rosbag1.Reader(path) if path.suffix == _ROS1 else rosbag2.Reader(path)


@contextlib.contextmanager
def _limited_sqlite(limit: StepLimit) -> Iterator[None]:
    """Limit steps and lengths of the connections that rosbags makes within a block."""
    import apsw

    def hook(connection: apsw.Connection) -> None:
        connection.set_progress_handler(limit, SQLITE_STEPS)
        connection.limit(apsw.SQLITE_LIMIT_LENGTH, MAX_CHUNK)
        connection.pragma("trusted_schema", 0)  # a stranger's file calls no functions

    apsw.connection_hooks.append(hook)
    try:
        yield
    finally:
        apsw.connection_hooks.remove(hook)


@functools.cache
def message_types(is_ros1: bool) -> Any:
    """Message types of ROS 1 or ROS 2, as rosbags serialises them."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    if not is_ros1:
        return get_typestore(Stores.ROS2_HUMBLE)
    types = get_typestore(Stores.ROS1_NOETIC)
    for name, definition in _ROS1_TYPES.items():
        types.register(get_types_from_msg(definition, name))
    return types


@contextlib.contextmanager
def _errors(path: Path | str, what: str = "") -> Iterator[None]:
    """Turn any error of a parser into a RecordingError of one line."""
    try:
        yield
    except RecordingError:
        raise
    except Exception as error:  # rosbags parses hostile bytes and asserts much
        reason = " ".join(str(error).split()) or type(error).__name__
        where = f"{path}: {what}" if what else str(path)
        raise RecordingError(f"{where} cannot be read: {reason[:300]}{_hint(reason)}") from error


def _hint(reason: str) -> str:
    if "not indexed" in reason or "index looks damaged" in reason:
        return " (`rosbag reindex` would repair a bag whose recording was cut short)"
    if reason == "Profile is not ros2.":
        return " (recordings hold ROS 2 messages; this is an MCAP file of another kind)"
    if "end magic" in reason or "footer" in reason:
        return " (`mcap recover` would repair a file whose recording was cut short)"
    return ""


@functools.cache
def _bound_decompression() -> None:
    """Let rosbags refuse chunks that expand to more than their stated size, or than MAX_CHUNK.

    Otherwise a file of kilobytes could fill the memory.
    """
    import lz4.frame
    from rosbags.rosbag1 import reader
    from rosbags.rosbag2 import storage_mcap

    def zstd(data: bytes, size: int) -> bytes:
        return _bounded(vars(storage_mcap)["zstd"].ZstdDecompressor(), data, size)

    def lz4_(data: bytes, size: int = MAX_CHUNK) -> bytes:
        return _bounded(lz4.frame.LZ4FrameDecompressor(), data, size)

    def bz2_(data: bytes) -> bytes:
        return _bounded(bz2.BZ2Decompressor(), data, MAX_CHUNK)

    tables: tuple[tuple[dict[str, Callable[..., bytes]], dict[str, Callable[..., bytes]]], ...] = (
        (storage_mcap.DECOMPRESSORS, {"zstd": zstd, "lz4": lz4_}),
        (reader.decompressors, {"lz4": lz4_, "bz2": bz2_}),
    )
    for table, bounded in tables:
        table.update(bounded)


def _bounded(decompressor: Any, data: bytes, size: int) -> bytes:
    """Decompressed `data`; raises RecordingError where it has more than `size` bytes."""
    if size > MAX_CHUNK:
        raise RecordingError(f"a chunk of {size} bytes is larger than any chunk of a bag")
    out: bytes = decompressor.decompress(data, max_length=size + 1)
    if len(out) > size:
        raise RecordingError(f"a chunk expands to more than its {size} bytes")
    return out
