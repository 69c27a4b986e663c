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
from kg.server.bodies import Parameters, query_parameters
from kg.server.moments import MOST_DIGITS, sequence_at
from kg.server.problems import Problem
from kg.server.protocol import unless_gone
from kg.server.serving import Serving
from kg.workers.formats import negotiate

_TYPES: Final = ("application/json", "text/plain")


async def log(serving: Serving, request: Request) -> Response:
    """Each transaction that changed the thing ``?iri=``; of those the ``&last=`` ones."""
    given = query_parameters(request)
    return await _told(
        serving, request, "log", _TYPES, iri=_needed(given, "iri"), last=_last(given)
    )


async def diff(serving: Serving, request: Request) -> Response:
    """What the map says at ``&to=`` and not at ``?from=``, and the other way round."""
    given = query_parameters(request)
    moments = [_needed(given, name) for name in ("from", "to")]
    before, after = [await sequence_at(serving, text) for text in moments]
    return await _told(serving, request, "diff", _TYPES, before=before, after=after)


async def why(serving: Serving, request: Request) -> Response:
    """Why the map says so, of the thing ``?iri=`` or of ``?what=``, a thing or a fact."""
    given = query_parameters(request)
    if ("iri" in given) == ("what" in given):
        raise Problem(400, "needs ?iri=, or ?what= with a fact: object/17 here:inPlace")
    about = given.one("iri") or _needed(given, "what")
    return await _told(serving, request, "why", (*_TYPES, "text/turtle"), about=about)


async def _told(
    serving: Serving, request: Request, what: str, types: tuple[str, ...], **asked: object
) -> Response:
    media_type = negotiate(request.headers.get("accept"), types)
    # what is told of facts is told of a snapshot: it must not be older than the history is
    least = serving.semantic_map.sequence if what == "why" else 0
    telling = serving.pool.tell_async(what, media_type, at_least=least, **asked)
    answer = await unless_gone(request, asyncio.ensure_future(telling))
    return Response(
        answer.body,
        media_type=answer.media_type,
        headers={"Vary": "Accept", SEQUENCE: str(answer.sequence)},
    )


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
