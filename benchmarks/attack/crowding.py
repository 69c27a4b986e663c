"""Crowding: ways in which one address takes connections, memory and time of an HTTP server.

A kind of crowding is an asynchronous function that keeps one connection busy in its way for as long
as it runs. `crowd` runs hundreds of them from one address.
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
from typing import Final

from benchmarks.attack.target import TOKEN

Reader, Writer = asyncio.StreamReader, asyncio.StreamWriter
Kind = Callable[[Reader, Writer], Awaitable[None]]

ADDRESS: Final = "127.0.0.66"  # of the crowd; Linux has all of 127.0.0.0/8
CONNECTIONS: Final = 700
FEWER: Final = 210
LINGER: Final = 30.0  # [s]
_PAUSE: Final = 0.05  # [s] before a closed connection is opened again
_HOST: Final = b"Host: localhost\r\n"
_BODY: Final = b"Content-Type: application/sparql-query\r\n"
_POST: Final = b"POST /sparql HTTP/1.1\r\n" + _HOST + _BODY
_ASK: Final = b"GET /sparql?query=ASK%20%7B%7D HTTP/1.1\r\n" + _HOST + b"\r\n"
_LARGE: Final = 7_900_000  # bytes of a body
_BOMB: Final = gzip.compress(bytes(32 << 20))


async def nothing(reader: Reader, writer: Writer) -> None:
    """No crowd, for comparison."""
    await asyncio.sleep(LINGER)


async def half_heads(reader: Reader, writer: Writer) -> None:
    """Half of a head."""
    writer.write(b"GET /hea")
    await reader.read()


async def silence(reader: Reader, writer: Writer) -> None:
    """Not a byte."""
    await reader.read()


async def slow_bodies(reader: Reader, writer: Writer) -> None:
    """A body at a byte a second."""
    writer.write(_POST + b"Content-Length: 8000000\r\n\r\n")
    while not reader.at_eof():
        writer.write(b" ")
        await writer.drain()
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(reader.read(1 << 16), 1.0)


async def unasked_bodies(reader: Reader, writer: Writer) -> None:
    """A body at a byte a second, which no endpoint reads."""
    writer.write(b"GET /health HTTP/1.1\r\n" + _HOST + b"Content-Length: 8000000\r\n\r\n")
    while not reader.at_eof():
        writer.write(b" ")
        await writer.drain()
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(reader.read(1 << 16), 1.0)


async def large_bodies(reader: Reader, writer: Writer) -> None:
    """A large body without its last byte."""
    writer.write(_POST + b"Content-Length: %d\r\n\r\n" % (_LARGE + 1))
    for _ in range(100):
        writer.write(bytes(_LARGE // 100))
        await writer.drain()
    await reader.read()


async def unread_answers(reader: Reader, writer: Writer) -> None:
    """Many requests for the largest document, no answer read."""
    writer.transport.pause_reading()  # type: ignore[attr-defined]
    for _ in range(200):
        if writer.is_closing():
            return
        writer.write(b"GET /graphs/ontology HTTP/1.1\r\n" + _HOST + b"\r\n")
    await asyncio.sleep(LINGER)


async def compressed_answers(reader: Reader, writer: Writer) -> None:
    """Requests for the largest document, compressed."""
    zipped = b"Accept-Encoding: gzip\r\n\r\n"
    writer.write((b"GET /graphs/ontology HTTP/1.1\r\n" + _HOST + zipped) * 20)
    await reader.read()


async def pipelines(reader: Reader, writer: Writer) -> None:
    """Thousands of requests at once on a connection."""
    writer.write(_ASK * 4000)
    await reader.read()


async def idle(reader: Reader, writer: Writer) -> None:
    """One request, then nothing; the connection is kept."""
    writer.write(b"GET /health HTTP/1.1\r\n" + _HOST + b"\r\n")
    await reader.read()


async def feeds(reader: Reader, writer: Writer) -> None:
    """A feed of changes."""
    writer.write(b"GET /changes HTTP/1.1\r\nAccept: text/event-stream\r\n" + _HOST + b"\r\n")
    await reader.read()


async def subscriptions(reader: Reader, writer: Writer) -> None:
    """A followed query."""
    query = b"/subscribe?query=SELECT%20*%20%7B%20%3Fs%20%3Fp%20%3Fo%20%7D"
    writer.write(b"GET " + query + b" HTTP/1.1\r\n" + _HOST + b"\r\n")
    await reader.read()


async def upgrades(reader: Reader, writer: Writer) -> None:
    """An upgrade to WebSocket, then frames."""
    head = b"Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
    key = b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
    writer.write(b"GET /changes HTTP/1.1\r\n" + _HOST + head + key + b"\x81\x85aaaaabcde" * 100)
    await reader.read()


async def not_http(reader: Reader, writer: Writer) -> None:
    """The begin of a TLS handshake, and noise."""
    writer.write(b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + os.urandom(2000))
    await reader.read()


async def huge_heads(reader: Reader, writer: Writer) -> None:
    """A head of thousands of lines."""
    writer.write(b"GET /health HTTP/1.1\r\n" + _HOST + b"a:\r\n" * 60_000 + b"\r\n")
    await reader.read()


async def long_heads(reader: Reader, writer: Writer) -> None:
    """Heads of the permitted length and number of lines."""
    line = b"a: " + b"b" * 150 + b"\r\n"
    writer.write((b"GET /health HTTP/1.1\r\n" + _HOST + line * 98 + b"\r\n") * 4)
    await reader.read()


async def many_types(reader: Reader, writer: Writer) -> None:
    """Heads with as many media types and tags as fit, for a document."""
    types = b",".join(b"a/b%d;q=0.%d" % (n, n % 9) for n in range(290))
    tags = b",".join(b'"%d"' % n for n in range(600))
    head = b"Accept: " + types + b"\r\nIf-None-Match: " + tags + b"\r\n\r\n"
    writer.write((b"GET /object/1 HTTP/1.1\r\n" + _HOST + head) * 20)
    await reader.read()


async def endless_heads(reader: Reader, writer: Writer) -> None:
    """Heads of 62 kB."""
    types = b",".join(b"a/b%d;q=0.%d" % (n, n % 9) for n in range(4500))
    writer.write(b"GET /object/1 HTTP/1.1\r\n" + _HOST + b"Accept: " + types + b"\r\n\r\n")
    await reader.read()


async def plans(reader: Reader, writer: Writer) -> None:
    """Requests for search plans, each of another one."""
    words = b"&".join(b"object=cup%d" % (ord(os.urandom(1)) % 200) for _ in range(5))
    writer.write(b"GET /find?" + words + b" HTTP/1.1\r\n" + _HOST + b"\r\n")
    await reader.read()


async def tiny_chunks(reader: Reader, writer: Writer) -> None:
    """A body in chunks of one byte."""
    writer.write(_POST + b"Transfer-Encoding: chunked\r\n\r\n")
    for _ in range(100):
        writer.write(b"1\r\n \r\n" * 10_000)
        await writer.drain()
    await reader.read()


async def bombs(reader: Reader, writer: Writer) -> None:
    """A body of 32 kB that decompresses to 32 MB."""
    head = b"Content-Encoding: gzip\r\nContent-Length: %d\r\n\r\n" % len(_BOMB)
    writer.write(_POST + head + _BOMB)
    await reader.read()


async def both_lengths(reader: Reader, writer: Writer) -> None:
    """A request with two lengths, and another one hidden in its body."""
    lengths = b"Content-Length: 6\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n"
    writer.write(_POST + lengths + _ASK)
    await reader.read()


async def reconnections(reader: Reader, writer: Writer) -> None:
    """One request for each connection, as fast as possible."""
    writer.write(_ASK)
    await reader.read(100)


async def resets(reader: Reader, writer: Writer) -> None:
    """Requests whose client resets the connection at once."""
    writer.get_extra_info("socket").setsockopt(1, 13, struct.pack("ii", 1, 0))  # SO_LINGER
    writer.write(_ASK)
    await writer.drain()


async def heavy_queries(reader: Reader, writer: Writer) -> None:
    """A query that takes all the time it is given."""
    query = b"SELECT (COUNT(*) AS ?n) { ?a ?b ?c . ?d ?e ?f . ?g ?h ?i . ?j ?k ?l }"
    token = f"Authorization: Bearer {TOKEN}\r\n".encode()
    writer.write(_POST + token + b"Content-Length: %d\r\n\r\n" % len(query) + query)
    await reader.read()


#: how many connections each kind keeps busy
KINDS: Final[dict[Kind, int]] = {
    nothing: 0,
    half_heads: CONNECTIONS,
    silence: 2 * CONNECTIONS,
    slow_bodies: CONNECTIONS,
    unasked_bodies: CONNECTIONS,
    large_bodies: FEWER,
    unread_answers: FEWER,
    compressed_answers: FEWER,
    pipelines: FEWER,
    idle: 2 * CONNECTIONS,
    feeds: CONNECTIONS,
    subscriptions: CONNECTIONS,
    upgrades: CONNECTIONS,
    not_http: CONNECTIONS,
    huge_heads: FEWER,
    long_heads: FEWER,
    many_types: FEWER,
    endless_heads: CONNECTIONS,
    plans: FEWER,
    tiny_chunks: FEWER,
    bombs: FEWER,
    both_lengths: CONNECTIONS,
    reconnections: CONNECTIONS,
    resets: CONNECTIONS,
    heavy_queries: CONNECTIONS,
}


async def crowd(port: int, name: str) -> None:
    """Crowd a server of this machine in one way, until the process is ended."""
    kind, count = next((k, n) for k, n in KINDS.items() if k.__name__ == name)
    await asyncio.gather(*(_again(port, kind) for _ in range(count)))


async def _again(port: int, kind: Kind) -> None:
    while True:
        with contextlib.suppress(OSError):
            reader, writer = await asyncio.open_connection(
                "127.0.0.1", port, local_addr=(ADDRESS, 0)
            )
            try:
                await kind(reader, writer)
            finally:
                writer.transport.abort()
        await asyncio.sleep(_PAUSE)


if __name__ == "__main__":
    # a process of its own at the lowest priority, since a bystander's machine is another one
    os.nice(19)
    hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    asyncio.run(crowd(int(sys.argv[1]), sys.argv[2]))
