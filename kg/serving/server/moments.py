"""Representations of the map at one moment: ``?at=``, entity tags, one answer for all, compression.

An endpoint whose answer follows from a transaction and its own parameters gives `at_moment` the
function that makes it. The rest is the same for all (RFC 9110, sections 8.8.3, 13 and 15.4.5): the
answer is made once, one at a time of each kind, and clients take turns.
"""

from __future__ import annotations

import gzip
import hashlib
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from functools import partial

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response

from kg.serving.server.app_state import AppState
from kg.serving.server.http.bodies import RequestParameters, query_parameters
from kg.serving.server.http.event_stream import unless_gone
from kg.serving.server.http.problems import Problem, State, sequence_at
from kg.serving.workers.process import Answer
from kg.store.sparql_client import SEQUENCE


@dataclass(frozen=True, slots=True)
class Moment:
    """Moment of a request: its parameters, and the transaction that they name."""

    given: RequestParameters
    sequence: int
    past: int | None  # the same number if the client asks for a past state


async def moment_of(serving: AppState, request: Request) -> Moment:
    """The moment of a request: ``?at=``, ISO 8601 or the number of a transaction; without it, now.

    Raises Problem: 400 for another text, 404 if that past is not kept.
    """
    given, semantic_map = query_parameters(request), serving.semantic_map
    text = given.one("at")
    past = None if text is None else await sequence_at(semantic_map, text)
    return Moment(given, semantic_map.sequence if past is None else past, past)


def present_of(serving: AppState, request: Request) -> Moment:
    """The moment of a request for what has no past; Problem 400 for ``?at=``."""
    given = query_parameters(request)
    if "at" in given:
        raise Problem(400, f"{request.url.path} is about the present; leave out 'at'")
    return Moment(given, serving.semantic_map.sequence, None)


async def at_moment(
    serving: AppState,
    request: Request,
    moment: Moment,
    make: Callable[[], Awaitable[Answer]],
    *,
    version: tuple[object, ...] = (),
    vary: str = "Accept-Encoding",
) -> Response:
    """The answer of `make`, which `version` distinguishes from others of this path and moment.

    Raises PoolBusyError (503) if too many requests of the client wait, and as `make`.
    """
    kind = request.url.path
    key = (kind, moment.sequence, moment.past is None, *version)
    digest = hashlib.blake2s(repr(key[2:]).encode(), digest_size=6).hexdigest()
    state = State(moment.sequence, f"{serving.moments.mark}{digest}")
    headers = {**state.headers, "Vary": vary}
    if state.is_known_to(request):
        return Response(status_code=304, headers=headers)
    client = request.state.client
    making = serving.moments.get(key, client, partial(_packed, make))
    found = await unless_gone(request, making)
    if moment.past is None:
        serving.sessions.saw(client, found.sequence)
    headers[SEQUENCE] = str(found.sequence)
    return await packed_response(request, found.body, found.media_type, headers)


async def packed_response(
    request: Request, packed: bytes, media_type: str, headers: dict[str, str]
) -> Response:
    """The response of a body that is kept compressed by gzip, as the client takes it."""
    if "gzip" in request.headers.get("accept-encoding", ""):
        return Response(
            packed, media_type=media_type, headers={**headers, "Content-Encoding": "gzip"}
        )
    body = await run_in_threadpool(gzip.decompress, packed)
    return Response(body, media_type=media_type, headers=headers)


async def _packed(make: Callable[[], Awaitable[Answer]]) -> Answer:
    answer = await make()
    body = await run_in_threadpool(gzip.compress, answer.body, 6, mtime=0)
    return Answer(answer.media_type, body, answer.sequence)
