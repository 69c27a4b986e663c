"""State of one moment for pages: `/state`, `/surface`, `/timeline`, and search plans, `/find`."""

from __future__ import annotations

import json
import time
from functools import partial
from typing import Final

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response

from kg.maps.surface.voxels import MEDIA_TYPE, Surface, encoded
from kg.model.errors import HistoryError
from kg.serving.server.app_state import AppState
from kg.serving.server.http.bodies import JSON
from kg.serving.server.http.problems import Problem
from kg.serving.server.moments import at_moment, moment_of, present_of
from kg.serving.workers.content_negotiation import negotiate
from kg.serving.workers.process import Answer
from kg.serving.workers.request import WorkerCall

MAX_COUNT: Final = 999  # frames, of `/surface`
MAX_WORDS: Final = 5  # objects of one search
_MAX_LETTERS: Final = 100  # letters of one
_PLAN_AGE: Final = 60.0  # [s] in which a plan for an unchanged map is made once
#: all pages are one client of the query pool, so that they use one worker at a time
_PAGES: Final = "the pages of this server"


async def state(serving: AppState, request: Request) -> Response:
    """The state at ``?at=``, or now, in the pieces of `kg.history.replay.map_state`.

    With ``objects=0`` objects and things are left out, which a page follows by the feed of changes.
    `surface` is its version, a number of frames.
    """
    moment = await moment_of(serving, request)
    whole, frames = moment.given.one("objects") != "0", _frames(serving)
    wanted = {"base": serving.semantic_map.base, "objects": whole, "surface": frames}
    call = WorkerCall(b"V", wanted, at=moment.past, at_least=moment.sequence, client=_PAGES)
    make = partial(serving.pool.answer_async, call)
    return await at_moment(serving, request, moment, make, version=(whole, frames))


async def surface(serving: AppState, request: Request) -> Response:
    """The coloured voxels at ``?at=``, or now, that ``?count=`` frames showed (2)."""
    moment = await moment_of(serving, request)
    given, store = moment.given.number("count"), serving.semantic_map.surface_store
    count = 2 if given is None else given
    if count > MAX_COUNT:
        raise Problem(400, f"count must be a number of frames up to {MAX_COUNT}, got {count}")

    def read() -> bytes:
        return encoded(Surface.empty() if store is None else store.surface(moment.past, count))

    async def make() -> Answer:
        return Answer(MEDIA_TYPE, await run_in_threadpool(read), moment.sequence)

    return await at_moment(serving, request, moment, make, version=(count, _frames(serving)))


async def timeline(serving: AppState, request: Request) -> Response:
    """The times at which things changed."""
    negotiate(request.headers.get("accept"), (JSON,))
    moment = present_of(serving, request)
    wanted = {"what": "timeline", "media_type": JSON}
    client, least = request.state.client, moment.sequence
    call = WorkerCall(b"T", wanted, at_least=least, client=client)
    make = partial(serving.pool.answer_async, call)
    try:
        floor = serving.semantic_map.history.log.floor
    except HistoryError:
        floor = 0
    return await at_moment(serving, request, moment, make, version=(floor,))


async def find(serving: AppState, request: Request) -> Response:
    """A search plan for ``?object=``, as `hereabouts find --json` prints it; may be repeated.

    One plan is made at a time, since planning occupies a processor for about a second.
    """
    moment, planner = present_of(serving, request), serving.planner
    wanted = moment.given.all("object")
    if planner is None:
        raise Problem(404, "this server has no planner; `hereabouts serve` has one")
    if not 0 < len(wanted) <= MAX_WORDS or any(not 0 < len(w) <= _MAX_LETTERS for w in wanted):
        raise Problem(
            400, f"needs ?object=, e.g. ?object=cup; up to {MAX_WORDS} of {_MAX_LETTERS} letters"
        )

    def plan() -> bytes:
        text = json.dumps(planner(list(wanted)), ensure_ascii=False, allow_nan=False)
        return f"{text}\n".encode()

    async def make() -> Answer:
        try:
            return Answer(JSON, await run_in_threadpool(plan), moment.sequence)
        except ValueError as error:
            raise Problem(
                422, "no plan: the length of a path is not finite; is the robot's position right?"
            ) from error

    version = (*wanted, int(time.monotonic() / _PLAN_AGE))
    return await at_moment(serving, request, moment, make, version=version)


def _frames(serving: AppState) -> int:
    """Number of frames in the surface of the map, which changes without a transaction."""
    store = serving.semantic_map.surface_store
    return 0 if store is None else store.frames
