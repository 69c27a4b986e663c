"""`/find?object=`: a search plan for objects; `object` may be repeated.

One plan is made at a time, since planning occupies a processor for about a second. A few requests
may wait; a request whose client leaves is removed from the queue.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from typing import Final

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response

from kg.serving.server.app_state import AppState
from kg.serving.server.http.bodies import json_response
from kg.serving.server.http.client_departure import unless_gone
from kg.serving.server.http.problems import Problem

MAX_WORDS: Final = 5  # objects of one search
MAX_WAITING: Final = 8  # requests
_MAX_LETTERS: Final = 100  # letters of one


async def find(serving: AppState, request: Request) -> Response:
    """The plan as JSON, as `hereabouts find --json` prints it."""
    wanted = request.query_params.getlist("object")
    if serving.planner is None:
        raise Problem(404, "this server has no planner; `hereabouts serve` has one")
    if not 0 < len(wanted) <= MAX_WORDS or any(not 0 < len(w) <= _MAX_LETTERS for w in wanted):
        raise Problem(
            400, f"needs ?object=, e.g. ?object=cup; up to {MAX_WORDS} of {_MAX_LETTERS} letters"
        )
    plan = await unless_gone(request, asyncio.ensure_future(_planned(serving, wanted)))
    try:
        return json_response(plan)
    except ValueError as error:
        raise Problem(
            422, "no plan: the length of a path is not finite; is the robot's position right?"
        ) from error


async def _planned(serving: AppState, wanted: list[str]) -> Mapping[str, object]:
    """Wait for the turn of a request and make its plan; Problem 503 if too many wait."""
    assert serving.planner is not None
    turns = serving.planning
    if turns.waiting >= MAX_WAITING:
        raise Problem(503, "too many requests for plans wait already", {"Retry-After": "5"})
    turns.waiting += 1
    try:
        await turns.lock.acquire()
    finally:
        turns.waiting -= 1
    # a plan that has begun is completed, even if the client leaves, before the next one begins
    plan = asyncio.ensure_future(run_in_threadpool(serving.planner, wanted))
    plan.add_done_callback(turns.end)
    return await asyncio.shield(plan)
