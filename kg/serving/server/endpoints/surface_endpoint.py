"""`/surface?at=`: the coloured voxels of the map (`kg.maps.surface.wire_format`).

An answer is made once for each moment, and has an ETag.
"""

from __future__ import annotations

import asyncio
import gzip
from typing import Final

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response

from kg.maps.surface.voxels import Surface
from kg.maps.surface.wire_format import MEDIA_TYPE, encoded
from kg.serving.server.app_state import AppState
from kg.serving.server.http.bodies import query_parameters
from kg.serving.server.http.client_departure import unless_gone
from kg.serving.server.http.conditions import State
from kg.serving.server.http.problems import Problem
from kg.serving.server.http.time_parameters import sequence_at
from kg.serving.server.state_cache import MAX_WAITING
from kg.serving.workers.process import Answer

MAX_DIGITS: Final = 3  # of ?count=


async def surface(serving: AppState, request: Request) -> Response:
    """The surface now, or at ``?at=``; of voxels that ``?count=`` frames showed (2).

    Raises Problem: 400 for another text, 404 if that past is not kept, 503 if too many wait.
    """
    given, semantic_map = query_parameters(request), serving.semantic_map
    at, count = given.one("at"), given.one("count") or "2"
    if not (count.isascii() and count.isdigit() and len(count) <= MAX_DIGITS):
        raise Problem(400, f"count must be a number of frames up to 999, got {count[:40]!r}")
    past = None if at is None else await sequence_at(semantic_map, at)
    number = semantic_map.sequence if past is None else past
    store = semantic_map.surface_store
    frames = 0 if store is None else store.frames
    form = f"{serving.surfaces.mark}-{count}-{frames}" + ("-past" if at is not None else "")
    known = State(number, None, form=form)
    headers = {**known.headers, "Vary": "Accept-Encoding"}
    if known.is_known_to(request):
        return Response(status_code=304, headers=headers)
    if serving.surfaces.waiting >= MAX_WAITING:
        raise Problem(503, "too many requests for surfaces wait already", {"Retry-After": "1"})

    def read() -> bytes:
        found = Surface.empty() if store is None else store.surface(past, int(count))
        return encoded(found)

    async def make() -> Answer:
        return Answer(MEDIA_TYPE, await run_in_threadpool(read), number)

    made = serving.surfaces.get((number, past is not None, int(count), frames), make)
    body = (await unless_gone(request, asyncio.ensure_future(made))).packed
    if "gzip" in request.headers.get("accept-encoding", ""):
        headers["Content-Encoding"] = "gzip"
    else:
        body = await run_in_threadpool(gzip.decompress, body)
    return Response(body, media_type=MEDIA_TYPE, headers=headers)
