"""Endpoints that read: state and plans for pages, the history of a thing, files, shipped questions.

`/state`, `/surface`, `/timeline` and `/find` are of one moment. Workers compute `/log`, `/diff` and
`/why` within the limits of queries, since a history can be long.
"""

from __future__ import annotations

import gzip
import json
import math
import time
from collections.abc import Mapping
from functools import cache, lru_cache, partial
from hashlib import sha256
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import Final

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response

from kg.history.reports.comparison import FAR
from kg.maps.query.parameter_resolution import preferred_languages
from kg.maps.query.query_files import ParameterizedQuery, find_query, shipped_queries
from kg.maps.semantic_map import SemanticMap
from kg.maps.surface.voxels import MEDIA_TYPE, Surface, encoded
from kg.model import vocabulary as v
from kg.model.errors import HistoryError, QueryParameterError, UnknownQueryError
from kg.model.iris import whole_number
from kg.serving.server.app_state import AppState
from kg.serving.server.endpoints.sparql_protocol import QUERY
from kg.serving.server.http.bodies import JSON, RequestParameters, json_response, query_parameters
from kg.serving.server.http.event_stream import unless_gone
from kg.serving.server.http.problems import Problem, sequence_at
from kg.serving.server.moments import at_moment, moment_of, packed_response, present_of
from kg.serving.workers.content_negotiation import negotiate
from kg.serving.workers.process import Answer
from kg.serving.workers.request import WorkerCall
from kg.store.sparql_client import SEQUENCE

_TYPES: Final = {"css": "text/css", "js": "text/javascript", "svg": "image/svg+xml"}


async def page_file(serving: AppState, request: Request) -> Response:
    """A file of the pages; Problem 404 for an unknown name."""
    name, known = request.path_params["name"], _files()
    if name not in known:
        raise Problem(404, f"no file {name[:100]!r}; there are: {', '.join(known)}")
    body = known[name].read_bytes()
    # revalidated each time: modules of two versions do not fit together
    headers = {"ETag": f'"{sha256(body).hexdigest()[:16]}"', "Cache-Control": "no-cache"}
    if headers["ETag"] in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers=headers)
    headers["Vary"] = "Accept-Encoding"
    packed = await run_in_threadpool(_packed, body)
    return await packed_response(request, packed, _TYPES[name.rpartition(".")[2]], headers)


@lru_cache(maxsize=64)
def _packed(body: bytes) -> bytes:
    return gzip.compress(body, mtime=0)


@cache
def _files() -> dict[str, Traversable]:
    folder = files("kg.serving.server").joinpath("files")
    found = {one.name: one for one in folder.iterdir()}
    found |= {f"vendor/{one.name}": one for one in folder.joinpath("vendor").iterdir()}
    return {name: found[name] for name in sorted(found) if name.rpartition(".")[2] in _TYPES}


async def picture(serving: AppState, request: Request) -> Response:
    """The JPEG of `/object/NUMBER`."""
    number, semantic_map = str(request.path_params["number"]), serving.semantic_map
    data = None
    if whole_number(number) is not None:
        iri = f"{semantic_map.base}object/{number}"
        data = await run_in_threadpool(semantic_map.picture, iri)
    if data is None:
        return Response(status_code=204)
    return Response(data, media_type="image/jpeg", headers={"Cache-Control": "no-cache"})


async def questions(serving: AppState, request: Request) -> Response:
    """Predeclared prefixes and the shipped questions with their parameters, as JSON."""
    return json_response(await run_in_threadpool(_content))


@cache
def _content() -> dict[str, object]:
    described = [_described(question) for question in shipped_queries()]
    return {"prefixes": dict(v.PREFIXES), "queries": described}


def _described(question: ParameterizedQuery) -> dict[str, object]:
    parameters = [
        {"name": one.name, "type": one.type, "default": one.default, "about": one.about}
        for one in question.parameters
    ]
    return {
        "name": question.name,
        "summary": question.summary,
        "asked": list(question.asked),
        "parameters": parameters,
        "columns": list(question.columns),
    }


async def question(serving: AppState, request: Request) -> Response:
    """A shipped question as SPARQL; raises QueryParameterError for invalid values.

    Raises Problem: 404 where there is no such question, 400 where a parameter is given twice.
    """
    try:
        found = find_query(request.path_params["name"])
    except UnknownQueryError as error:
        raise Problem(404, str(error), kind=type(error).__name__) from error
    given = query_parameters(request)
    values = {name: given.one(name) for name in dict(given.pairs)}
    language = values.pop("language", None) or _accepted(request)
    text = await run_in_threadpool(found.bind, values, serving.semantic_map.resolve, language)
    body = "\n".join(line for line in text.split("\n") if not line.startswith("#+"))
    headers = {"Vary": "Accept-Language"}
    return Response(f"{body.strip()}\n", media_type=QUERY, headers=headers)


def _accepted(request: Request) -> str:
    """The languages that a client accepts; none where its header has another form."""
    text = request.headers.get("accept-language", "")
    try:
        preferred_languages(text)
    except QueryParameterError:
        return ""
    return text


MAX_COUNT: Final = 999  # frames, of `/surface`
MAX_WORDS: Final = 5  # objects of one search
_MAX_LETTERS: Final = 100  # letters of one
_PLAN_AGE: Final = 60.0  # [s] in which a plan for an unchanged map is made once
#: all pages are one client of the query pool, so that they use one worker at a time
_PAGES: Final = "the pages of this server"


async def state(serving: AppState, request: Request) -> Response:
    """The state at ``?at=``, or now, in the pieces of `kg.history.map_state`.

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


_HISTORY_TYPES: Final = (JSON, "text/plain")


async def log(serving: AppState, request: Request) -> Response:
    """The transactions that changed the thing ``?iri=``; with ``&last=`` the last ones.

    With ``&told=1`` only those that its summary tells: no changes of counters.
    """
    given = query_parameters(request)
    wanted = {
        "iri": _needed(given, "iri"),
        "last": given.number("last"),
        "told": given.flag("told"),
    }
    return await _report(serving, request, "log", wanted)


async def diff(serving: AppState, request: Request) -> Response:
    """Changes of objects between ``?from=`` and ``&to=`` (now), moved at least ``&far=`` metres.

    With ``&facts=1`` all facts instead.
    """
    given, semantic_map = query_parameters(request), serving.semantic_map
    before = await sequence_at(semantic_map, _needed(given, "from"), since=True)
    to = given.one("to")
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
    return await _report(serving, request, "why", wanted, (*_HISTORY_TYPES, "text/turtle"), least)


async def _report(
    serving: AppState,
    request: Request,
    what: str,
    wanted: Mapping[str, object],
    types: tuple[str, ...] = _HISTORY_TYPES,
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
