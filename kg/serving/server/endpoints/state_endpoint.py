"""`/state?at=`: what a page draws of the map at one moment; without `at`, now.

With `objects=0` objects and things are left out, which a page follows by the feed of changes.

The answer has `sequence`, `time` (of a past moment), `objects`, `things` (without a name),
`places`, `doors`, `robot`, `floor` (see `kg.history.replay.map_state`), `surface`: its version, a
number of frames, and `poses`: a line for each recording whose poses were estimated from its images.
It is made once for each moment, and has an ETag.
"""

from __future__ import annotations

import asyncio
import gzip
from functools import partial
from typing import Final

from starlette.requests import Request
from starlette.responses import Response

from kg.serving.server.app_state import AppState
from kg.serving.server.http.bodies import JSON, query_parameters
from kg.serving.server.http.client_departure import unless_gone
from kg.serving.server.http.clients import asker_of
from kg.serving.server.http.conditions import State
from kg.serving.server.http.problems import Problem
from kg.serving.server.http.time_parameters import sequence_at
from kg.serving.server.state_cache import MAX_WAITING, StoredAnswer
from kg.serving.workers.process import Answer
from kg.serving.workers.request import Asker
from kg.store.sparql_client import SEQUENCE

#: all pages are one client of the query pool, so that they use one worker at a time
_PAGES: Final = Asker("the pages of this server")


async def state(serving: AppState, request: Request) -> Response:
    """The state at a moment: ISO 8601, or the number of a transaction.

    Raises Problem: 400 for another text, 404 if that past is not kept, 503 if too many wait.
    """
    given = query_parameters(request)
    moment, whole = given.one("at"), given.one("objects") != "0"
    past = None if moment is None else await sequence_at(serving.semantic_map, moment)
    number = serving.semantic_map.sequence if past is None else past
    store = serving.semantic_map.surface_store
    frames = 0 if store is None else store.frames
    key = (number, past is not None, whole, frames)
    form = f"{serving.states.mark}{int(past is None)}{int(whole)}-{frames}"
    known = State(number, None, form=form)
    headers = {**known.headers, "Vary": "Accept-Encoding"}
    if known.is_known_to(request):
        return Response(status_code=304, headers=headers)
    if serving.states.waiting >= MAX_WAITING:
        raise Problem(503, "too many requests for states wait already", {"Retry-After": "1"})
    made = serving.states.get(key, partial(_made, serving, *key))
    found = await unless_gone(request, asyncio.ensure_future(made))
    if past is None:
        serving.sessions.saw(asker_of(request).client, found.sequence)
    return _response(request, found, headers)


async def _made(serving: AppState, number: int, is_past: bool, whole: bool, frames: int) -> Answer:
    request = {"base": serving.semantic_map.base, "objects": whole, "surface": frames}
    past = number if is_past else None
    return await serving.pool.state_async(request, at=past, at_least=number, asker=_PAGES)


def _response(request: Request, found: StoredAnswer, headers: dict[str, str]) -> Response:
    headers = {**headers, SEQUENCE: str(found.sequence)}
    body = found.packed
    if "gzip" in request.headers.get("accept-encoding", ""):
        headers["Content-Encoding"] = "gzip"
    else:
        body = gzip.decompress(body)
    return Response(body, media_type=JSON, headers=headers)
