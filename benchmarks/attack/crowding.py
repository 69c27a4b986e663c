"""Crowding: ways in which one address takes connections, memory and time of an HTTP server.

`crowd` keeps hundreds of connections busy from one address, each in one of the `KINDS`.
"""

from __future__ import annotations

import asyncio
import contextlib
import gzip
import os
import resource
import struct
import sys
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Final

from benchmarks.attack.target import TOKEN

Reader, Writer = asyncio.StreamReader, asyncio.StreamWriter

ADDRESS: Final = "127.0.0.66"  # of the crowd; Linux has all of 127.0.0.0/8
MANY: Final = 700  # connections
FEWER: Final = 210
LINGER: Final = 30.0  # [s]
_PAUSE: Final = 0.05  # [s] before a closed connection is opened again
_HOST: Final = b"Host: localhost\r\n"
_BODY: Final = b"Content-Type: application/sparql-query\r\n"
_POST: Final = b"POST /sparql HTTP/1.1\r\n" + _HOST + _BODY
_LARGE: Final = 7_900_000  # bytes of a body
_BOMB: Final = gzip.compress(bytes(32 << 20))


async def _wait(reader: Reader, writer: Writer) -> None:
    await asyncio.sleep(LINGER)


async def _trickle(reader: Reader, writer: Writer) -> None:
    """A byte a second."""
    while not reader.at_eof():
        writer.write(b" ")
        await writer.drain()
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(reader.read(1 << 16), 1.0)


async def _large(reader: Reader, writer: Writer) -> None:
    """A large body without its last byte."""
    for _ in range(100):
        writer.write(bytes(_LARGE // 100))
        await writer.drain()
    await reader.read()


async def _unread(reader: Reader, writer: Writer) -> None:
    """Many requests for the largest document, no answer read."""
    writer.transport.pause_reading()  # type: ignore[attr-defined]
    for _ in range(200):
        if writer.is_closing():
            return
        writer.write(_get(b"/graphs/ontology"))
    await asyncio.sleep(LINGER)


async def _chunks(reader: Reader, writer: Writer) -> None:
    """A body in chunks of one byte."""
    for _ in range(100):
        writer.write(b"1\r\n \r\n" * 10_000)
        await writer.drain()
    await reader.read()


async def _again_at_once(reader: Reader, writer: Writer) -> None:
    """One request for each connection, as fast as possible."""
    await reader.read(100)


async def _reset(reader: Reader, writer: Writer) -> None:
    """The client resets the connection at once."""
    writer.get_extra_info("socket").setsockopt(1, 13, struct.pack("ii", 1, 0))  # SO_LINGER
    await writer.drain()


def _get(path: bytes, head: bytes = b"") -> bytes:
    return b"GET " + path + b" HTTP/1.1\r\n" + _HOST + head + b"\r\n"


def _post(body: bytes, head: bytes = b"") -> bytes:
    return _POST + head + b"Content-Length: %d\r\n\r\n" % len(body) + body


def _plan() -> bytes:
    """A request for a search plan, each of another one."""
    words = b"&".join(b"object=cup%d" % (ord(os.urandom(1)) % 200) for _ in range(5))
    return _get(b"/find?" + words)


def _types(count: int) -> bytes:
    return b"Accept: " + b",".join(b"a/b%d;q=0.%d" % (n, n % 9) for n in range(count)) + b"\r\n"


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of crowding: how many connections, what each sends first, and does then."""

    count: int
    sends: bytes | Callable[[], bytes] = b""
    then: Callable[[Reader, Writer], Awaitable[object]] = lambda reader, writer: reader.read()


_ASK: Final = _get(b"/sparql?query=ASK%20%7B%7D")
_ALL: Final = b"/subscribe?query=SELECT%20*%20%7B%20%3Fs%20%3Fp%20%3Fo%20%7D"
_UPGRADE: Final = (
    b"Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
    b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
)
_TAGS: Final = b"If-None-Match: " + b",".join(b'"%d"' % n for n in range(600)) + b"\r\n"
_BOTH: Final = b"Content-Length: 6\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n"
_HEAVY: Final = b"SELECT (COUNT(*) AS ?n) { ?a ?b ?c . ?d ?e ?f . ?g ?h ?i . ?j ?k ?l }"
_ANN: Final = f"Authorization: Bearer {TOKEN}\r\n".encode()
_ENDLESS: Final = b"Content-Length: 8000000\r\n"

KINDS: Final[dict[str, Kind]] = {
    "nothing": Kind(0, then=_wait),  # for comparison
    "half_heads": Kind(MANY, b"GET /hea"),
    "silence": Kind(2 * MANY),
    "slow_bodies": Kind(MANY, _POST + _ENDLESS + b"\r\n", _trickle),
    "unasked_bodies": Kind(MANY, _get(b"/health", _ENDLESS), _trickle),  # which no endpoint reads
    "large_bodies": Kind(FEWER, _POST + b"Content-Length: %d\r\n\r\n" % (_LARGE + 1), _large),
    "unread_answers": Kind(FEWER, then=_unread),
    "compressed_answers": Kind(FEWER, _get(b"/graphs/ontology", b"Accept-Encoding: gzip\r\n") * 20),
    "pipelines": Kind(FEWER, _ASK * 4000),  # thousands of requests at once
    "idle": Kind(2 * MANY, _get(b"/health")),
    "feeds": Kind(MANY, _get(b"/changes", b"Accept: text/event-stream\r\n")),
    "subscriptions": Kind(MANY, _get(_ALL)),
    "upgrades": Kind(MANY, _get(b"/changes", _UPGRADE) + b"\x81\x85aaaaabcde" * 100),
    "not_http": Kind(MANY, b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + os.urandom(2000)),
    "huge_heads": Kind(FEWER, _get(b"/health", b"a:\r\n" * 60_000)),
    "long_heads": Kind(FEWER, _get(b"/health", (b"a: " + b"b" * 150 + b"\r\n") * 98) * 4),
    "many_types": Kind(FEWER, _get(b"/object/1", _types(290) + _TAGS) * 20),
    "endless_heads": Kind(MANY, _get(b"/object/1", _types(4500))),
    "plans": Kind(FEWER, _plan),
    "tiny_chunks": Kind(FEWER, _POST + b"Transfer-Encoding: chunked\r\n\r\n", _chunks),
    "bombs": Kind(FEWER, _post(_BOMB, b"Content-Encoding: gzip\r\n")),
    "both_lengths": Kind(MANY, _POST + _BOTH + _ASK),  # another request hidden in the body
    "reconnections": Kind(MANY, _ASK, _again_at_once),
    "resets": Kind(MANY, _ASK, _reset),
    "heavy_queries": Kind(MANY, _post(_HEAVY, _ANN)),
}


async def crowd(port: int, name: str) -> None:
    """Crowd a server of this machine in one way, until the process is ended."""
    kind = KINDS[name]
    await asyncio.gather(*(_again(port, kind) for _ in range(kind.count)))


async def _again(port: int, kind: Kind) -> None:
    while True:
        with contextlib.suppress(OSError):
            reader, writer = await asyncio.open_connection(
                "127.0.0.1", port, local_addr=(ADDRESS, 0)
            )
            try:
                if first := kind.sends() if callable(kind.sends) else kind.sends:
                    writer.write(first)
                await kind.then(reader, writer)
            finally:
                writer.transport.abort()
        await asyncio.sleep(_PAUSE)


if __name__ == "__main__":
    # a process of its own at the lowest priority, since a bystander's machine is another one
    os.nice(19)
    hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    asyncio.run(crowd(int(sys.argv[1]), sys.argv[2]))
