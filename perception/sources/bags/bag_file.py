"""Bags on disk: ROS 1 bags, ROS 2 bags (folder or file, SQLite or MCAP), read without ROS.

The modules of this folder alone read with the package `rosbags`. A recording that was split into
files, and one that was cut short, are read like others. Messages are decoded by the definitions
that ship with it, and Foxglove's by `perception.sources.ros.foxglove_schemas`, never by the
definitions in a file, so that no code is made from the content of a file.
"""

from __future__ import annotations

import bz2
import contextlib
import functools
import heapq
import re
import weakref
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from kg.model.errors import RecordingError, in_one_line
from kg.model.regular_files import SQLITE_STEPS, StepLimit, check_regular, read_text
from perception.sources.ros.foxglove_schemas import ENCODINGS as FOXGLOVE
from perception.sources.ros.foxglove_schemas import ROS_TYPES, decoded_foxglove, ros_type
from perception.sources.ros.message_types import RGBD_IMAGES, message_types
from perception.sources.ros.rgbd_image import parts, wholes

MAX_CHUNK: Final = 1 << 29  # [bytes] decompressed
MAX_FILE: Final = 1 << 44  # [bytes] of a bag, which is read in parts
MAX_METADATA: Final = 1 << 24  # [bytes] of the list of a bag's files
_FILES: Final = (".mcap", ".db3")
_ROS1: Final = ".bag"
_PART: Final = re.compile(r"_(\d+)\.(bag|mcap|db3)(\.active)?$")
_NAMED: Final = re.compile(r"^\s*-\s*(?:path:\s*)?(\S+\.(?:mcap|db3)\S*)\s*$", re.M)
_ZSTD: Final = b"\x28\xb5\x2f\xfd"  # beginning of what is compressed


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
    encoding: str = ""  # "ros1", "cdr", "protobuf", "json"; "": that of its source
    schema: str = ""  # of protobuf and JSON


def bag_path(path: Path) -> Path | None:
    """Path to open: `path` itself, or the one storage file in it; None where it is no bag."""
    if not path.is_dir():
        return path if _storage(path) in (_ROS1, *_FILES) else None
    inner = storage_files(path)
    renamed = len(inner) == 1 and _names_other_files(path / "metadata.yaml")
    if (path / "metadata.yaml").is_file() and not renamed:
        return path
    if len(inner) == 1:
        return inner[0]
    return path if inner and _are_parts(inner) else None


def _names_other_files(metadata: Path) -> bool:
    """Whether a list of a bag's files has none that is there, as after renaming it."""
    try:
        text = read_text(metadata, max_bytes=MAX_METADATA)
    except (OSError, UnicodeDecodeError):
        return False
    names = _NAMED.findall(text)
    return bool(names) and not any((metadata.parent / name).exists() for name in names)


def storage_files(folder: Path) -> list[Path]:
    """Storage files of bags in a folder, in the order of their numbers."""
    found = [p for p in folder.iterdir() if _storage(p) in (_ROS1, *_FILES) and p.is_file()]
    return sorted(found, key=lambda p: (_part(p), p.name))


def _storage(path: Path) -> str:
    """Suffix of a storage file; `rosbag record` adds .active until it ends."""
    return path.with_suffix("").suffix if path.suffix == ".active" else path.suffix


def _part(path: Path) -> int:
    """Number of a recording's part: 1 for kitchen_1.bag; -1 where it has none."""
    found = _PART.search(path.name)
    return int(found[1]) if found else -1


def _are_parts(files: list[Path]) -> bool:
    """Whether files are those of one recording that was split: kitchen_0.bag, kitchen_1.bag."""
    first = _part(files[0])
    numbered = [_part(file) for file in files] == list(range(first, first + len(files)))
    names = {re.sub(r"[\d-]+", "", _PART.sub("", file.name)) for file in files}
    return first >= 0 and numbered and len(names) == 1


class BagFile:
    """An open bag; close it, or use `with`. It belongs to the thread that opened it.

    Raises RecordingError, here and on reading, for what is no bag, is damaged or truncated.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        metadata = path / "metadata.yaml"
        whole = not path.is_dir() or metadata.is_file()
        parts = [path] if whole else storage_files(path)
        self.is_ros1 = _storage(parts[0]) == _ROS1
        self._limit, self._readers = StepLimit(path), list[Any]()
        self.close = weakref.finalize(self, _close, self._readers)
        for part in parts:
            try:
                inside = part.is_dir()
                check_regular(metadata if inside else part, MAX_METADATA if inside else MAX_FILE)
            except OSError as error:
                raise RecordingError(f"cannot read {part}: {error.strerror}") from error
            _check_journal(part)
            with _errors(part):
                self._readers.append(_reader(part))
                with _limited_sqlite(self._limit):
                    self._readers[-1].open()
        counts: dict[str, tuple[str, int]] = {}
        for connection in (one for reader in self._readers for one in reader.connections):
            before = counts.get(connection.topic, ("", 0))[1]
            kind = ros_type(connection.msgtype) if _is_read(connection) else connection.msgtype
            counts[connection.topic] = (kind, before + connection.msgcount)
        self._whole = wholes({name: kind for name, (kind, _) in counts.items()})
        counts |= {one: (kind, counts[of][1]) for one, (of, kind) in self._whole.items()}
        self.topics = tuple(Topic(name, *counts[name]) for name in sorted(counts))

    @property
    def cut_short(self) -> bool:
        """Whether a file lacks its end, as a crash leaves it."""
        return any(_is_cut(reader) for reader in self._readers)

    def __enter__(self) -> BagFile:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def messages(self, topics: Collection[str], start: int | None = None) -> Iterator[RawMessage]:
        """Messages of `topics` in order of recording, from the time `start` [ns] on."""
        self._limit.reset()
        parts = [self._part_messages(reader, topics, start) for reader in self._readers]
        with _errors(self.path):
            yield from parts[0] if len(parts) == 1 else heapq.merge(*parts, key=lambda m: m.time)

    def _part_messages(
        self, reader: Any, topics: Collection[str], start: int | None
    ) -> Iterator[RawMessage]:
        wanted = {self._whole.get(topic, (topic, ""))[0] for topic in topics}
        chosen = [c for c in reader.connections if c.topic in wanted and _is_read(c)]
        if not chosen:
            return
        for connection, time, data in reader.messages(chosen, start=start):
            encoding, kind = _encoding(connection), connection.msgtype
            if encoding == "cdr" and data[:4] == _ZSTD:  # no CDR begins so
                data = _decompressed(data, connection.topic)
            raw = RawMessage(connection.topic, ros_type(kind), time, data, encoding, kind)
            for one in parts_of(raw, self.is_ros1):
                if one.topic in topics and (one is raw or one.topic in self._whole):
                    yield one

    def decoded(self, raw: RawMessage) -> Any:
        """The message with its fields."""
        return decoded(raw, self.is_ros1, self.path)


def _decompressed(data: bytes, topic: str) -> bytes:
    """A message that is compressed alone, where no metadata.yaml says so."""
    import zstandard  # which rosbags needs, too

    size = zstandard.frame_content_size(data)
    if not 0 <= size <= MAX_CHUNK:
        raise RecordingError(f"a message of {topic} expands to {size} bytes; {MAX_CHUNK} would do")
    return zstandard.ZstdDecompressor().decompress(data)


def decoded(raw: RawMessage, is_ros1: bool, where: Path | str) -> Any:
    """A message with its fields; raises RecordingError, beginning with `where`."""
    with _errors(where, f"a message of {raw.topic}"):
        if raw.encoding in FOXGLOVE:
            return decoded_foxglove(raw.data, raw.schema, raw.encoding)
        is_ros1 = raw.encoding == "ros1" if raw.encoding else is_ros1
        types = message_types(is_ros1)
        deserialize = types.deserialize_ros1 if is_ros1 else types.deserialize_cdr
        return deserialize(raw.data, raw.type)


def parts_of(raw: RawMessage, is_ros1: bool) -> Iterator[RawMessage]:
    """A message that holds images of others, as messages of their own; else the message itself."""
    if raw.type not in RGBD_IMAGES:
        yield raw
        return
    is_ros1 = raw.encoding == "ros1" if raw.encoding else is_ros1
    with _errors(raw.topic, "a message"):
        found = list(parts(raw.topic, raw.data, is_ros1=is_ros1))
    for topic, kind, data in found:
        yield replace(raw, topic=topic, type=kind, data=data)


def _encoding(connection: Any) -> str:
    """Encoding of a connection's messages."""
    return str(getattr(connection.ext, "serialization_format", "ros1"))


def _is_read(connection: Any) -> bool:
    """Whether messages of a connection can be decoded."""
    encoding = _encoding(connection)
    return encoding in ("ros1", "cdr") or (encoding in FOXGLOVE and connection.msgtype in ROS_TYPES)


def _is_cut(reader: Any) -> bool:
    """Whether a reader, or one of a folder's files, found no end."""
    inner = getattr(getattr(reader, "storage", None), "storages", ())
    storages = (reader, getattr(reader, "storage", None), *inner)
    return any(getattr(one, "cut_short", False) for one in storages)


def _close(readers: list[Any]) -> None:
    for reader in readers:
        with contextlib.suppress(Exception):
            reader.close()


def _reader(path: Path) -> Any:
    try:
        from rosbags import rosbag2
    except ImportError as error:
        raise RecordingError(
            f"reading {path} needs the package rosbags: pip install 'hereabouts[ros]'"
        ) from error
    from perception.sources.bags.ros1_reader import AnyBagReader

    _bound_decompression()
    return AnyBagReader(path) if _storage(path) == _ROS1 else rosbag2.Reader(path)


def _check_journal(path: Path) -> None:
    """Raise RecordingError where a crash left messages beside an SQLite file, not in it."""
    for file in path.glob("*.db3") if path.is_dir() else (path,):
        journal = file.with_name(f"{file.name}-wal")
        if journal.is_file() and journal.stat().st_size:
            raise RecordingError(
                f"{journal} holds messages that a crash kept from {file.name}; "
                f"`sqlite3 {file.name} 'PRAGMA wal_checkpoint(TRUNCATE)'` would move them there"
            )


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


@contextlib.contextmanager
def _errors(path: Path | str, what: str = "") -> Iterator[None]:
    """Turn any error of a parser into a RecordingError of one line."""
    try:
        yield
    except RecordingError:
        raise
    except Exception as error:  # rosbags parses hostile bytes and asserts much
        reason = in_one_line(error)
        if "Storage plugin" in reason:  # of rosbags
            reason = (
                f"{reason.partition(';')[0]}; sqlite3 and mcap are read, which `ros2 bag convert` "
                "writes where that plugin is installed"
            )
        where = f"{path}: {what}" if what else str(path)
        raise RecordingError(f"{where} cannot be read: {reason[:300]}") from error


@functools.cache
def _bound_decompression() -> None:
    """Let rosbags refuse chunks that expand to more than their stated size, or than MAX_CHUNK.

    Otherwise a file of kilobytes could fill the memory. Also let it read any MCAP file.
    """
    import lz4.frame
    from rosbags.rosbag1 import reader
    from rosbags.rosbag2 import reader as reader2
    from rosbags.rosbag2 import storage_mcap

    from perception.sources.bags.mcap_reader import AnyMcapReader, read_any_schema

    read_any_schema()
    for known in (reader2.DirectoryReader, reader2.Reader):
        plugins: dict[str, Any] = dict(known.STORAGE_PLUGINS)
        mcap = {name: AnyMcapReader for name in plugins if "mcap" in name}
        known.STORAGE_PLUGINS = plugins | mcap

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
