"""`/log`, `/diff`, `/why`: history of a thing, comparison of two states, explanation.

Workers compute them within the limits of queries, since a history can be long.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response

from kg.history.reports.comparison import FAR
from kg.maps.semantic_map import SemanticMap
from kg.serving.server.app_state import AppState
from kg.serving.server.http.bodies import JSON, RequestParameters, query_parameters
from kg.serving.server.http.event_stream import unless_gone
from kg.serving.server.http.problems import Problem, sequence_at
from kg.serving.workers.content_negotiation import negotiate
from kg.serving.workers.request import WorkerCall
from kg.store.sparql_client import SEQUENCE

_TYPES: Final = (JSON, "text/plain")


async def log(serving: AppState, request: Request) -> Response:
    """The transactions that changed the thing ``?iri=``; with ``&last=`` the last ones."""
    given = query_parameters(request)
    wanted = {"iri": _needed(given, "iri"), "last": given.number("last")}
    return await _report(serving, request, "log", wanted)


async def diff(serving: AppState, request: Request) -> Response:
    """Changes of objects between ``?from=`` and ``&to=`` (now), moved at least ``&far=`` metres.

    With ``&facts=1`` all facts instead.
    """
    given, semantic_map = query_parameters(request), serving.semantic_map
    before, to = await sequence_at(semantic_map, _needed(given, "from")), given.one("to")
    after = semantic_map.sequence if to is None else await sequence_at(semantic_map, to)
    wanted = {
        "before": before,
        "after": after,
        "facts": given.flag("facts"),
        "far": _far(given.one("far")),
        "surface": await run_in_threadpool(_areas, semantic_map, before, after),
    }
    return await _report(serving, request, "diff", wanted)


async def why(serving: AppState, request: Request) -> Response:
    """Explanation of the resource ``?iri=``, or of the resource or fact ``?what=``."""
    given = query_parameters(request)
    if ("iri" in given) == ("what" in given):
        raise Problem(400, "needs ?iri=, or ?what= with a fact: object/17 here:inPlace")
    wanted = {"about": given.one("iri") or _needed(given, "what")}
    # the snapshot must not be older than the history
    least = serving.semantic_map.sequence
    return await _report(serving, request, "why", wanted, (*_TYPES, "text/turtle"), least)


async def _report(
    serving: AppState,
    request: Request,
    what: str,
    wanted: Mapping[str, object],
    types: tuple[str, ...] = _TYPES,
    least: int = 0,
) -> Response:
    media_type = negotiate(request.headers.get("accept"), types)
    body = {"what": what, "media_type": media_type, **wanted}
    call = WorkerCall(b"T", body, at_least=least, client=request.state.client)
    answer = await unless_gone(request, serving.pool.answer_async(call))
    return Response(
        answer.body,
        media_type=answer.media_type,
        headers={"Vary": "Accept", SEQUENCE: str(answer.sequence)},
    )


def _areas(semantic_map: SemanticMap, *sequences: int) -> list[float]:
    """[m^2] of the map's surface after transactions."""
    store = semantic_map.surface_store
    return [0.0 if store is None else store.area(number) for number in sequences]


def _needed(given: RequestParameters, name: str) -> str:
    value = given.one(name)
    if not value:
        raise Problem(400, f"needs {name}=")
    return value


def _far(text: str | None) -> float:
    try:
        far = FAR if text is None else float(text)
    except ValueError:
        far = -1.0
    if not 0 <= far < math.inf:
        raise Problem(400, f"far must be a distance in metres, such as 0.3, got {text!r:.40}")
    return far
