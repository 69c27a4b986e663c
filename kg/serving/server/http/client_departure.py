"""Queries whose client leaves before the response are cancelled."""

from __future__ import annotations

import asyncio
from typing import Any, TypeVar

from starlette.requests import Request
from starlette.types import Receive

from kg.serving.server.http.problems import Problem

T = TypeVar("T")


async def unless_gone(request: Request, query: asyncio.Future[T]) -> T:
    """The answer to a query, which is cancelled if the client leaves."""
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
