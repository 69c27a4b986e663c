"""MCAP files of any profile and schema: by their index, or scanned where they have no whole one.

rosbags reads MCAP files of the profile ros2 that were closed. Here a file that lacks an end, as a
crash leaves it, is read up to its last whole record. Definitions of messages are not looked at.
"""

from __future__ import annotations

import heapq
import os
import struct
from collections import Counter
from collections.abc import Collection, Generator, Iterator
from io import BytesIO
from typing import Any, Final

from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat
from rosbags.rosbag2 import storage_mcap
from rosbags.rosbag2.errors import ReaderError
from rosbags.rosbag2.storage_mcap import ChunkInfo, McapReader, Statistics

MAGIC: Final = b"\x89MCAP0\r\n"
FOOTER: Final = 37  # [bytes] of the footer and the magic behind it
_RECORD: Final = struct.Struct("<BQ")  # kind and length
_MESSAGE: Final = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_CHUNK: Final = struct.Struct("<QQQI")  # start, end, size, checksum
_SCHEMA, _CHANNEL, _LOOSE, _CHUNKED, _DATA_END, _FOOTER = 3, 4, 5, 6, 15, 2


class AnyMcapReader(McapReader):
    """Reader of MCAP files, whatever wrote them; the interface is that of rosbags."""

    def __init__(self, path: Any) -> None:
        super().__init__(path)
        self.cut_short = False
        self._loose: list[tuple[int, int, int, int]] = []  # time, channel, offset, size

    def _open(self) -> None:
        bio = self.bio
        assert bio is not None
        if bio.read(len(MAGIC)) != MAGIC:
            raise ReaderError("File magic is invalid.")
        self.data_start = len(MAGIC)
        if not self._by_index():
            for known in (self.schemas, self.channels, self.chunks, self.connections):
                known.clear()
            self._scan()
        if self.cut_short and not self.connections:
            raise ReaderError("It has neither an end nor a whole part.")
        assert self.statistics is not None
        counts = self.statistics.channel_message_counts
        self.connections = [c._replace(msgcount=counts.get(c.id, 0)) for c in self.connections]

    def _by_index(self) -> bool:
        """Read the index; whether there is one that finds all messages."""
        bio = self.bio
        assert bio is not None
        try:
            bio.seek(-FOOTER, os.SEEK_END)
            tail = bio.read(FOOTER)
            start = int.from_bytes(tail[9:17], "little")
            if tail[-len(MAGIC) :] != MAGIC or tail[0] != _FOOTER or not start:
                return False
            self.data_end = start
            self.read_index()
        except (OSError, ReaderError, LookupError, ValueError, TypeError, struct.error):
            return False
        found = sum(sum(chunk.channel_count.values()) for chunk in self.chunks)
        return self.statistics is not None and found == self.statistics.message_count

    def _scan(self) -> None:
        """Find all whole records, chunk by chunk."""
        bio = self.bio
        assert bio is not None
        at, size = self.data_start, os.fstat(bio.fileno()).st_size
        counts, known, self.cut_short = Counter[int](), BytesIO(), True
        while at + _RECORD.size <= size:
            bio.seek(at)
            kind, length = _RECORD.unpack(bio.read(_RECORD.size))
            if kind in (_DATA_END, _FOOTER):
                self.cut_short = False
                break
            if at + _RECORD.size + length > size:
                break
            if kind in (_SCHEMA, _CHANNEL):
                known.write(_RECORD.pack(kind, length) + bio.read(length))
            elif kind == _LOOSE:
                channel, _, time, _ = _MESSAGE.unpack(bio.read(_MESSAGE.size))
                body = at + _RECORD.size + _MESSAGE.size
                self._loose.append((time, channel, body, length - _MESSAGE.size))
                counts[channel] += 1
            elif kind == _CHUNKED:
                self._add_chunk(at, bio.read(length), known)
            at += _RECORD.size + length
        for chunk in self.chunks:
            counts.update(chunk.channel_count)
        self._loose.sort()
        self._learn(known)
        total, both = counts.total(), (len(self.schemas), len(self.channels))
        self.statistics = Statistics(total, *both, 0, 0, len(self.chunks), 0, 0, dict(counts))

    def _add_chunk(self, at: int, data: bytes, known: BytesIO) -> None:
        """Index a chunk; its schemas and channels go to `known`."""
        _, _, size, crc = _CHUNK.unpack_from(data)
        (name,) = struct.unpack_from("<I", data, _CHUNK.size)
        body = _CHUNK.size + 4 + name
        compression = data[_CHUNK.size + 4 : body].decode()
        (packed,) = struct.unpack_from("<Q", data, body)
        raw = storage_mcap.decompress(data[body + 8 : body + 8 + packed], compression, size, crc)
        counts, place, times = Counter[int](), 0, list[int]()
        while place + _RECORD.size <= len(raw):
            kind, length = _RECORD.unpack_from(raw, place)
            place += _RECORD.size
            if kind == _LOOSE:
                channel, _, time, _ = _MESSAGE.unpack_from(raw, place)
                counts[channel] += 1
                times.append(time)
            elif kind in (_SCHEMA, _CHANNEL):
                known.write(_RECORD.pack(kind, length) + raw[place : place + length])
            place += length
        if times:
            span, length = (min(times), max(times)), _RECORD.size + len(data)
            self.chunks.append(
                ChunkInfo(*span, at, length, {}, 0, compression, packed, size, dict(counts))
            )

    def _learn(self, known: BytesIO) -> None:
        """Let rosbags read records of schemas and channels, as it reads an index."""
        known.write(_RECORD.pack(_FOOTER, 0))
        file, end = self.bio, self.data_end
        self.bio, self.data_end = known, 0
        try:
            self.read_index()
        finally:
            self.bio, self.data_end = file, end

    def messages(
        self, connections: Collection[Any], start: int | None = None, stop: int | None = None
    ) -> Generator[tuple[Any, int, bytes], None, None]:
        """Messages of `connections` by time, of chunks and beside them."""
        chunked = super().messages(connections, start, stop) if self.chunks else ()
        if not self._loose:
            yield from chunked
            return
        loose = self._loose_messages({c.id: c for c in connections}, start or 0)
        yield from heapq.merge(loose, chunked, key=lambda one: one[1])

    def _loose_messages(
        self, connections: dict[int, Any], start: int
    ) -> Iterator[tuple[Any, int, bytes]]:
        bio = self.bio
        assert bio is not None
        for time, channel, offset, size in self._loose:
            if time >= start and channel in connections:
                bio.seek(offset)
                yield connections[channel], time, bio.read(size)


def read_any_schema() -> None:
    """Let rosbags pass over definitions of any encoding."""
    module: Any = storage_mcap
    none = MessageDefinition(MessageDefinitionFormat.NONE, "")
    module.get_msgdef = lambda schema: none
    module.read_string = lambda bio: module.read_bytes(bio).decode(errors="replace")
