"""ROS 1 bags by their index, or scanned where a crash or a cut left them without one."""

from __future__ import annotations

from collections import defaultdict
from io import BytesIO
from typing import Any, Final

from rosbags.rosbag1 import Reader, ReaderError
from rosbags.rosbag1.reader import (
    Chunk,
    Header,
    IndexData,
    RecordType,
    decompressors,
    read_bytes,
    read_uint32,
)

NO_INDEX: Final = ("not indexed", "index looks damaged", "Could not read", "truncated")


class AnyBagReader(Reader):
    """Reader of ROS 1 bags; the interface is that of rosbags."""

    cut_short = False

    def open(self) -> None:
        """Open the bag; raises ReaderError for what is none."""
        try:
            super().open()
        except ReaderError as error:
            if not any(words in str(error) for words in NO_INDEX):
                raise
            self.cut_short = True
            self.bio = self.path.open("rb")
            self._scan(self.path.stat().st_size)

    def _scan(self, size: int) -> None:
        """Index all whole chunks."""
        bio = self.bio
        assert bio is not None
        bio.readline()
        Header.read(bio, RecordType.BAGHEADER)
        bio.seek(read_uint32(bio), 1)
        indexes: dict[int, list[IndexData]] = defaultdict(list)
        known: dict[int, Any] = {}
        while True:
            at = bio.tell()
            try:
                header = Header.read(bio)
                length = read_uint32(bio)
                kind = header.get_uint8("op")
            except ReaderError:
                break
            body = bio.tell()
            if body + length > size:
                break
            if kind == RecordType.CHUNK:
                decompressor = decompressors[header.get_string("compression")]
                self.chunks[at] = Chunk(length, body, decompressor)
                self._scan_chunk(at, decompressor(read_bytes(bio, length)), known, indexes)
            bio.seek(body + length)
        if not known:
            raise ReaderError("It has neither an index nor a whole part.")
        self.indexes = {number: sorted(indexes[number]) for number in known}
        self.connections = [
            one._replace(msgcount=len(self.indexes[number])) for number, one in known.items()
        ]

    def _scan_chunk(
        self, at: int, raw: bytes, known: dict[int, Any], indexes: dict[int, list[IndexData]]
    ) -> None:
        file, chunk = self.bio, BytesIO(raw)
        self.bio = chunk  # where rosbags reads a connection
        try:
            while (offset := chunk.tell()) < len(raw):
                header = Header.read(chunk)
                if header.get_uint8("op") == RecordType.CONNECTION:
                    chunk.seek(offset)
                    connection = self.read_connection()
                    known.setdefault(connection.id, connection)
                    continue
                indexes[header.get_uint32("conn")].append(
                    IndexData(header.get_time("time"), at, offset)
                )
                chunk.seek(read_uint32(chunk), 1)
        finally:
            self.bio = file
