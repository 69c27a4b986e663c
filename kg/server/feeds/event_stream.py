"""Server-sent events (WHATWG HTML, section 9.2) that the client or the server may end."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator, Callable

from starlette.types import Receive, Scope, Send

_HEADERS = [
    (b"content-type", b"text/event-stream; charset=utf-8"),
    (b"cache-control", b"no-store"),
    (b"x-accel-buffering", b"no"),
]
HEARTBEAT = 15.0  # [s] of silence after which a comment shows that the stream lives


def event(number: int, kind: str, data: object) -> bytes:
    """One event; its id is the sequence number."""
    text = json.dumps(data, ensure_ascii=False, separators=(",", ":"))
    return f"id: {number}\nevent: {kind}\ndata: {text}\n\n".encode()


class EventStream:
    """An ASGI answer that sends `events` until they, the client or `ended` end it.

    `on_end` is called once, however it ends. `ended` cuts the connection at once: a client that
    does not read could otherwise hold it.
    """

    def __init__(
        self, events: AsyncIterator[bytes], ended: asyncio.Event, on_end: Callable[[], None]
    ) -> None:
        self._events, self._ended, self._on_end = events, ended, on_end

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request; a HEAD with the head alone."""
        if scope["method"] == "HEAD":
            self._on_end()
            await send({"type": "http.response.start", "status": 200, "headers": _HEADERS})
            await send({"type": "http.response.body", "body": b""})
            return
        left = asyncio.ensure_future(disconnected(receive))
        over = asyncio.ensure_future(self._ended.wait())
        pump = asyncio.ensure_future(self._pump(send))
        try:
            await asyncio.wait({left, over, pump}, return_when=asyncio.FIRST_COMPLETED)
            if not left.done():
                await self._finish(scope, pump, left)
        finally:
            for task in (left, over, pump):
                task.cancel()
            await asyncio.gather(left, over, pump, return_exceptions=True)
            self._on_end()

    async def _finish(
        self, scope: Scope, pump: asyncio.Task[None], left: asyncio.Task[None]
    ) -> None:
        if pump.done() and not pump.cancelled() and pump.exception() is not None:
            pump.result()
        scope["state"]["connection"].abort()
        await left

    async def _pump(self, send: Send) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": _HEADERS})
        await send(_part(b": here\n\n"))
        async for piece in _with_heartbeat(self._events):
            await send(_part(piece))


async def _with_heartbeat(events: AsyncIterator[bytes]) -> AsyncIterator[bytes]:
    iterator = aiter(events)
    coming: asyncio.Task[bytes] | None = None
    try:
        while True:
            coming = coming or asyncio.ensure_future(_next(iterator))
            done, _ = await asyncio.wait({coming}, timeout=HEARTBEAT)
            if not done:
                yield b": still here\n\n"
                continue
            try:
                piece = coming.result()
            except StopAsyncIteration:
                return
            coming = None
            yield piece
    finally:
        if coming is not None:
            coming.cancel()
            with contextlib.suppress(asyncio.CancelledError, StopAsyncIteration):
                await coming


async def _next(iterator: AsyncIterator[bytes]) -> bytes:
    return await anext(iterator)


def _part(body: bytes) -> dict[str, object]:
    return {"type": "http.response.body", "body": body, "more_body": True}


async def disconnected(receive: Receive) -> None:
    """Returns once the client has left; what it still sends is not looked at."""
    while (await receive())["type"] != "http.disconnect":
        pass
