"""`POST /rooms`: splits, merges, draws and names rooms, as the holder of the token."""

from __future__ import annotations

import math
from functools import partial
from typing import Any, Final

from starlette.requests import Request
from starlette.responses import Response

from kg.model.room_edit import RoomEdit
from kg.serving.server.app_state import AppState
from kg.serving.server.endpoints.sparql_protocol import written
from kg.serving.server.http.bodies import read_json
from kg.serving.server.http.client_departure import completed
from kg.serving.server.http.problems import Problem

_MEMBERS: Final = ("kind", "places", "points", "name")


async def rooms(serving: AppState, request: Request) -> Response:
    """Apply the edit in the body: a JSON object with the members of `RoomEdit`."""
    by = serving.author_of(request)
    edit = _edit(**await read_json(request, serving.settings.limits, _MEMBERS))
    change = await completed(partial(serving.semantic_map.rooms.edit, edit, by=by))
    return written(serving, change, request)


def _edit(kind: Any, places: Any, points: Any, name: Any) -> RoomEdit:
    if not isinstance(kind, str) or not isinstance(name, str):
        raise Problem(400, "'kind' and 'name' must be texts")
    if not isinstance(places, list) or not all(isinstance(place, str) for place in places):
        raise Problem(400, "'places' must be a list of texts, as in [\"place/2\"]")
    if not isinstance(points, list) or not all(map(_is_point, points)):
        raise Problem(400, "'points' must be a list of [x, y] in metres")
    pairs = tuple((float(x), float(y)) for x, y in points)
    return RoomEdit(kind, tuple(places), pairs, name)  # type: ignore[arg-type]


def _is_point(given: Any) -> bool:
    return (
        isinstance(given, list)
        and len(given) == 2
        and all(isinstance(n, int | float) and not isinstance(n, bool) for n in given)
        and all(abs(n) <= 1e6 and math.isfinite(n) for n in given)
    )
