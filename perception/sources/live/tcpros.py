"""TCPROS: a header of `key=value` fields, then messages, each with its length before it.

Lengths are 4 bytes, little-endian (wiki.ros.org: ROS/TCPROS).
"""

from __future__ import annotations

import math
import socket
import struct
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from kg.model.errors import RecordingError

TICK: Final = 0.5  # [s] after which a silent connection checks whether it is still wanted
HEADER_WITHIN: Final = 5.0  # [s]
MAX_HEADER: Final = 1 << 20  # [bytes]; it has the message's definition


@dataclass(frozen=True, slots=True)
class TcprosConnection:
    """TCPROS connection over an open socket; reading ends once `ended` is set."""

    connected: socket.socket
    name: str  # of the topic or node, for messages
    ended: threading.Event

    def __post_init__(self) -> None:
        self.connected.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        self.connected.settimeout(TICK)

    def block(self, bound: int, within: float = math.inf) -> bytes | None:
        """The next block of data; None once either side has ended the connection.

        Raises RecordingError for more than `bound` [bytes], OSError where the connection breaks
        off or the block is not complete after `within` [s].
        """
        until = time.monotonic() + within
        length = self._exactly(4, until, may_end=True)
        if length is None:
            return None
        (size,) = struct.unpack("<I", length)
        if size > bound:
            raise RecordingError(f"{self.name}: a message of {size} bytes; up to {bound} are taken")
        return self._exactly(size, until)

    def _exactly(self, size: int, until: float, *, may_end: bool = False) -> bytes | None:
        parts, missing = list[bytes](), size
        while missing:
            if self.ended.is_set():
                return None
            if time.monotonic() > until:
                raise TimeoutError(f"{self.name}: the other side is silent")
            try:
                part = self.connected.recv(min(missing, 1 << 20))
            except TimeoutError:
                continue
            if not part and may_end and missing == size:
                return None
            if not part:
                raise ConnectionError("the other side closed the connection")
            parts.append(part)
            missing -= len(part)
        return b"".join(parts)

    def fields(self) -> dict[str, str]:
        """Fields of the other side's header; raises RecordingError where it is malformed."""
        header, at = self.block(MAX_HEADER, HEADER_WITHIN) or b"", 0
        fields = dict[str, str]()
        while at < len(header):
            size = struct.unpack_from("<I", header, at)[0] if at + 4 <= len(header) else len(header)
            line = header[at + 4 : at + 4 + size]
            if len(line) < size:
                raise RecordingError(f"{self.name}: the other side's header is malformed")
            key, _, value = line.decode("utf-8", "replace").partition("=")
            fields[key] = value
            at += 4 + size
        return fields

    def send_fields(self, fields: Mapping[str, str]) -> None:
        """Send a header."""
        lines = [f"{key}={value}".encode() for key, value in fields.items()]
        self.connected.sendall(block(b"".join(map(block, lines))))


def block(data: bytes) -> bytes:
    """`data` with its length before it."""
    return struct.pack("<I", len(data)) + data
