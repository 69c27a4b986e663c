"""Responses that outlast their clients or not: server-sent events, writes, queries.

Server-sent events (WHATWG HTML, section 9.2) end with the client or the server. If a client leaves
before its response, a write completes, and a query is cancelled.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Callable, Coroutine
from typing import Any, TypeVar

from starlette.requests import Request
from starlette.types import Receive, Scope, Send

from kg.serving.server.http.connection import LimitedConnection
from kg.serving.server.http.problems import Problem

T = TypeVar("T")
_HEADERS = [
    (b"content-type", b"text/event-stream; charset=utf-8"),
    (b"cache-control", b"no-store"),
    (b"x-accel-buffering", b"no"),
]
HEARTBEAT = 15.0  # [s] between the comments that keep a stream alive


def event(number: int, kind: str, data: object) -> bytes:
    """One event; its id is the sequence number."""
    text = json.dumps(data, ensure_ascii=False, separators=(",", ":"))
    return f"id: {number}\nevent: {kind}\ndata: {text}\n\n".encode()


class EventStream:
    """ASGI response that sends `events` until they end, the client leaves, or `ended` is set.

    `on_end` is called once at the end. The connection is then aborted, since a client that does not
    read could otherwise keep it open.
    """

    def __init__(
        self, events: AsyncIterator[bytes], ended: asyncio.Event, on_end: Callable[[], None]
    ) -> None:
        self._events, self._ended, self._on_end = events, ended, on_end

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request; a HEAD with the head alone."""
        head = {"type": "http.response.start", "status": 200, "headers": _HEADERS}
        if scope["method"] == "HEAD":
            self._on_end()
            await send(head)
            await send({"type": "http.response.body", "body": b""})
            return
        try:
            await send(head)
            await self._stream(scope["state"]["connection"], receive, send)
        finally:
            self._on_end()

    async def _stream(self, connection: LimitedConnection, receive: Receive, send: Send) -> None:
        parts = self._ended.wait(), self._send_events(send), _send_heartbeats(send)
        tasks = [asyncio.ensure_future(part) for part in parts]
        left = asyncio.ensure_future(disconnected(receive))
        try:
            done, _ = await asyncio.wait((left, *tasks), return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            connection.abort()
            await left
        for finished in done:
            finished.result()

    async def _send_events(self, send: Send) -> None:
        await send(_part(b": connected\n\n"))
        async for text in self._events:
            await send(_part(text))


async def _send_heartbeats(send: Send) -> None:
    while True:
        await asyncio.sleep(HEARTBEAT)
        await send(_part(b": still connected\n\n"))


def _part(body: bytes) -> dict[str, object]:
    return {"type": "http.response.body", "body": body, "more_body": True}


async def unless_gone(request: Request, answering: Coroutine[Any, Any, T]) -> T:
    """The answer to a query, which is cancelled if the client leaves."""
    query = asyncio.ensure_future(answering)
    gone = asyncio.ensure_future(disconnected(request.receive))
    try:
        waiting: set[asyncio.Future[Any]] = {query, gone}
        await asyncio.wait(waiting, return_when=asyncio.FIRST_COMPLETED)
        if not query.done():
            query.cancel()
            await asyncio.gather(query, return_exceptions=True)
            raise Problem(400, "the client left before its answer was ready")
        return query.result()
    finally:
        gone.cancel()
        query.cancel()


async def disconnected(receive: Receive) -> None:
    """Return once the client has left; the rest of its request is ignored."""
    while (await receive())["type"] != "http.disconnect":
        pass
