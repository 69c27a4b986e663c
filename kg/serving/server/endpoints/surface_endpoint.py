"""`/surface?at=`: the coloured voxels of the map (`kg.maps.surface.wire_format`)."""

from __future__ import annotations

import gzip
from functools import partial

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response

from kg.maps.surface.voxels import Surface
from kg.maps.surface.wire_format import MEDIA_TYPE, encoded
from kg.serving.server.app_state import AppState
from kg.serving.server.http.bodies import query_parameters
from kg.serving.server.http.problems import Problem
from kg.serving.server.http.time_parameters import sequence_at

MAX_COUNT = 3  # digits of ?count=


async def surface(serving: AppState, request: Request) -> Response:
    """The surface now, or at ``?at=``; of voxels that ``?count=`` frames showed (2)."""
    given = query_parameters(request)
    at, count = given.one("at"), given.one("count") or "2"
    if not (count.isascii() and count.isdigit() and len(count) <= MAX_COUNT):
        raise Problem(400, f"count must be a number of frames up to 999, got {count[:40]!r}")
    sequence = None if at is None else await sequence_at(serving.semantic_map, at)
    packed = "gzip" in request.headers.get("accept-encoding", "")
    store = serving.semantic_map.surface_store
    read = Surface.empty if store is None else partial(store.surface, sequence, int(count))
    body = await run_in_threadpool(lambda: _packed(encoded(read()), packed))
    headers = {"Vary": "Accept-Encoding", "Cache-Control": "no-cache"}
    if packed:
        headers["Content-Encoding"] = "gzip"
    return Response(body, media_type=MEDIA_TYPE, headers=headers)


def _packed(data: bytes, packed: bool) -> bytes:
    return gzip.compress(data, 1) if packed else data
