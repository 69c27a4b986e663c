"""`/log`, `/diff`, `/why`: a thing's history, what differs between two moments, and why.

Workers tell it, within the limits of queries: the history of a robot can be long.
"""

from __future__ import annotations

import asyncio
import re
from typing import Final

from starlette.requests import Request
from starlette.responses import Response

from kg.endpoint import SEQUENCE
from kg.semantic_map import SemanticMap
from kg.server.bodies import Parameters, query_parameters
from kg.server.moments import MOST_DIGITS, sequence_at
from kg.server.problems import Problem
from kg.server.protocol import unless_gone
from kg.server.serving import Serving
from kg.workers.formats import negotiate
from kg.workers.pool import QueryPool
from kg.workers.process import Answer

JSON: Final = "application/json"
#: what can be told, as what
TYPES: Final[dict[str, tuple[str, ...]]] = {
    "log": (JSON, "text/plain"),
    "diff": (JSON, "text/plain"),
    "why": (JSON, "text/plain", "text/turtle"),
}


async def log(serving: Serving, request: Request) -> Response:
    """Each transaction that changed the thing ``?iri=``; of those the ``&last=`` ones."""
    return await _told(serving, request, "log")


async def diff(serving: Serving, request: Request) -> Response:
    """What the map says at ``&to=`` and not at ``?from=``, and the other way round."""
    return await _told(serving, request, "diff")


async def why(serving: Serving, request: Request) -> Response:
    """Why the map says so, of the thing ``?iri=`` or of ``?what=``, a thing or a fact."""
    return await _told(serving, request, "why")


async def tell(
    pool: QueryPool, semantic_map: SemanticMap, what: str, given: Parameters, media_type: str
) -> Answer:
    """The log, diff or why that a request is for, told by a worker; Problem 400 for no request."""
    asked = await _asked(semantic_map, what, given)
    # what is told of facts is told of a snapshot: it must not be older than the history is
    least = semantic_map.sequence if what == "why" else 0
    return await pool.tell_async(what, media_type, at_least=least, **asked)


async def _told(serving: Serving, request: Request, what: str) -> Response:
    given = query_parameters(request)
    media_type = negotiate(request.headers.get("accept"), TYPES[what])
    telling = tell(serving.pool, serving.semantic_map, what, given, media_type)
    answer = await unless_gone(request, asyncio.ensure_future(telling))
    return Response(
        answer.body,
        media_type=answer.media_type,
        headers={"Vary": "Accept", SEQUENCE: str(answer.sequence)},
    )


async def _asked(semantic_map: SemanticMap, what: str, given: Parameters) -> dict[str, object]:
    if what == "log":
        return {"iri": _needed(given, "iri"), "last": _last(given)}
    if what == "diff":
        moments = [_needed(given, name) for name in ("from", "to")]
        before, after = [await sequence_at(semantic_map, text) for text in moments]
        return {"before": before, "after": after}
    if ("iri" in given) == ("what" in given):
        raise Problem(400, "needs ?iri=, or ?what= with a fact: object/17 here:inPlace")
    return {"about": given.one("iri") or _needed(given, "what")}


def _needed(given: Parameters, name: str) -> str:
    value = given.one(name)
    if not value:
        raise Problem(400, f"needs {name}=")
    return value


def _last(given: Parameters) -> int | None:
    text = given.one("last")
    if text is not None and not re.fullmatch(rf"[0-9]{{1,{MOST_DIGITS}}}", text):
        raise Problem(400, f"last must be a number, got {text[:40]!r}")
    return None if text is None else int(text)
