"""`/find?object=`: a search plan for an object, by the planner that the server was given.

`object` may be repeated. One plan is made at a time: planning takes a processor for about a second.
"""

from __future__ import annotations

import json
from typing import Final

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response

from kg.server.app_state import AppState
from kg.server.http.problems import Problem

MOST_WORDS: Final = 5  # objects of one search
_LONGEST: Final = 100  # letters of one


async def find(serving: AppState, request: Request) -> Response:
    """The plan as JSON, as `hereabouts find --json` prints it."""
    wanted = request.query_params.getlist("object")
    if serving.planner is None:
        raise Problem(404, "this server has no planner; `hereabouts serve` has one")
    if not 0 < len(wanted) <= MOST_WORDS or any(not 0 < len(w) <= _LONGEST for w in wanted):
        raise Problem(
            400, f"needs ?object=, e.g. ?object=cup; up to {MOST_WORDS} of {_LONGEST} letters"
        )
    if not serving.planning.acquire(blocking=False):
        raise Problem(503, "another plan is being made; try again", {"Retry-After": "1"})
    try:
        plan = await run_in_threadpool(serving.planner, wanted)
    finally:
        serving.planning.release()
    try:
        text = json.dumps(plan, ensure_ascii=False, allow_nan=False)
    except ValueError as error:
        raise Problem(
            422, "no plan: a way is of no finite length; is the robot's position right?"
        ) from error
    return Response(f"{text}\n", media_type="application/json")
