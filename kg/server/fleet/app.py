"""The application of a fleet: which path is answered by what."""

from __future__ import annotations

import contextlib
import json
from collections.abc import AsyncIterator, Awaitable, Callable

from pyoxigraph import Triple
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp

from kg import vocabulary as v
from kg.engine import Engine
from kg.errors import HereaboutsError
from kg.server import bodies, metrics
from kg.server.app import file, not_this_way
from kg.server.fleet import pages
from kg.server.fleet.members import Asked, Member, ask_all, lines
from kg.server.fleet.queries import FleetServing, missing, refuse_past, sparql
from kg.server.fleet.told import PATHS, told
from kg.server.guard import Guard
from kg.server.media_types import GRAPH_FORMATS, HTML, document
from kg.server.pages import thing_page
from kg.server.problems import Problem, problem_of, problem_response
from kg.server.thing import Thing, look_up
from kg.workers.formats import negotiate

Answer = Callable[[FleetServing, Request], Awaitable[Response]]
#: what each map has and a fleet of them has not
_MEMBERS_OWN = ("/timemap", "/changes", "/subscribe")


def fleet_application(fleet: FleetServing) -> ASGIApp:
    """Everything a fleet's server answers, behind its guard."""
    _measure(fleet)
    table: list[tuple[str, Answer, list[str]]] = [
        ("/", _front, ["GET"]),
        ("/sparql", _sparql, ["GET", "POST"]),
        ("/sparql/", _sparql, ["GET", "POST"]),
        ("/.well-known/void", _description, ["GET"]),
        ("/health", _health, ["GET"]),
        ("/metrics", _metrics, ["GET"]),
        ("/files/{name:str}", _file, ["GET"]),
        ("/resource", _resource, ["GET"]),
        *((path, told, ["GET", "POST", "DELETE"]) for path in PATHS),
        *((path, _members_own, ["GET", "POST", "DELETE"]) for path in _MEMBERS_OWN),
    ]
    routes = [Route(path, _endpoint(fleet, answer), methods=how) for path, answer, how in table]

    @contextlib.asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        yield

    app = Starlette(
        routes=routes, lifespan=lifespan, exception_handlers={HTTPException: not_this_way}
    )
    app.router.redirect_slashes = False
    return Guard(app, fleet.settings, fleet.metrics)


def _endpoint(fleet: FleetServing, answer: Answer) -> Callable[[Request], Awaitable[Response]]:
    async def respond(request: Request) -> Response:
        try:
            return await answer(fleet, request)
        except HereaboutsError as error:
            return problem_response(problem_of(error), request.headers.get("accept"))

    return respond


async def _sparql(fleet: FleetServing, request: Request) -> Response:
    answer = await sparql(fleet, request)
    if answer is not None:
        return answer
    media_type = negotiate(request.headers.get("accept"), (*GRAPH_FORMATS, HTML))
    if media_type == HTML:
        return RedirectResponse("/#ask", status_code=303, headers={"Vary": "Accept"})
    return _document(pages.service(str(request.base_url)), media_type)


async def _description(fleet: FleetServing, request: Request) -> Response:
    media_type = negotiate(request.headers.get("accept"), tuple(GRAPH_FORMATS))
    await _states(fleet)
    return _document(pages.description(str(request.base_url), fleet.members), media_type)


async def _front(fleet: FleetServing, request: Request) -> Response:
    media_type = negotiate(request.headers.get("accept"), (*GRAPH_FORMATS, HTML))
    if media_type != HTML:
        return await _description(fleet, request)
    page = pages.front(await _states(fleet))
    return Response(page, media_type=HTML, headers={"Vary": "Accept"})


async def _health(fleet: FleetServing, request: Request) -> Response:
    states = await _states(fleet)
    there = sum(state["status"] == "ok" for state in states)
    status = "ok" if there == len(states) else "partial" if there else "down"
    body = json.dumps({"status": status, "members": states}, ensure_ascii=False) + "\n"
    return Response(body, status_code=200 if there else 503, media_type="application/json")


async def _states(fleet: FleetServing) -> list[pages.MemberState]:
    """How each member is, asked now."""
    _, errors = await ask_all(fleet.members, lambda member: member.ask(Asked("ASK {}")))
    return [_state(member, lines(errors)) for member in fleet.members]


def _state(member: Member, errors: dict[str, str]) -> pages.MemberState:
    why = errors.get(member.name)
    base, title = member.known or (None, None)
    return {
        "member": member.name,
        "status": "away" if why else "ok",
        "map": title,
        "base": base,
        "error": why,
    }


async def _metrics(fleet: FleetServing, request: Request) -> Response:
    return Response(fleet.metrics.text(), headers={"Content-Type": metrics.MEDIA_TYPE})


async def _file(fleet: FleetServing, request: Request) -> Response:
    return file(request)


async def _members_own(fleet: FleetServing, request: Request) -> Response:
    """Refused: versions of things and what changes is for each map to tell."""
    if request.method in ("POST", "DELETE"):
        raise Problem(403, "a fleet only reads: write to the member it is for")
    names = ", ".join(member.name for member in fleet.members)
    raise Problem(404, f"a fleet has no {request.url.path}: ask the map it is about ({names})")


async def _resource(fleet: FleetServing, request: Request) -> Response:
    """Anything a member knows: the one whose map the IRI begins with is asked, else all are."""
    given = bodies.query_parameters(request)
    iri = given.one("iri")
    if not iri:
        raise Problem(400, "needs ?iri=, an absolute IRI")
    refuse_past(given)
    media_type = negotiate(request.headers.get("accept"), (*GRAPH_FORMATS, HTML))
    found, errors = await _facts(fleet, iri)
    # who does not know the thing has answered: only those that could not be asked are missing
    headers = {"Vary": "Accept", **missing(errors, found, partly=given.flag("partial"))}
    things = [thing for thing in found.values() if thing is not None]
    if not things:
        raise Problem(404, f"no map of this fleet knows of {iri[:200]}")
    thing = Thing(
        iri,
        tuple(dict.fromkeys(quad for one in things for quad in one.about)),
        tuple(dict.fromkeys(quad for one in things for quad in one.pointing)),
    )
    if media_type == HTML:
        page = await run_in_threadpool(thing_page, thing, pages.compact(iri), pages.link)
        return Response(page, media_type=HTML, headers=headers)
    triples = dict.fromkeys(quad.triple for quad in (*thing.about, *thing.pointing))
    return Response(
        document(triples, media_type, v.PREFIXES), media_type=media_type, headers=headers
    )


async def _facts(
    fleet: FleetServing, iri: str
) -> tuple[dict[str, Thing | None], dict[str, HereaboutsError]]:
    owners = [m for m in fleet.members if m.known and iri.startswith(m.known[0])]

    def ask(member: Member) -> Awaitable[Thing | None]:
        return member.look_up(lambda there: _known(there.engine, iri))

    return await ask_all(owners or fleet.members, ask)


def _known(engine: Engine, iri: str) -> Thing | None:
    try:
        return look_up(engine, iri)
    except Problem as problem:
        if problem.status == 404:
            return None
        raise


def _document(triples: list[Triple], media_type: str) -> Response:
    body = document(triples, media_type, v.PREFIXES)
    return Response(body, media_type=media_type, headers={"Vary": "Accept"})


def _measure(fleet: FleetServing) -> None:
    gauge = fleet.metrics.gauge
    gauge("hereabouts_members", "gauge", "Maps of the fleet.", lambda: len(fleet.members))
    gauge(
        "hereabouts_members_away",
        "gauge",
        "Members that did not answer the last time they were asked.",
        lambda: sum(bool(member.away) for member in fleet.members),
    )
    gauge(
        "hereabouts_partial_answers_total",
        "counter",
        "Answers given, as asked, without a member that was away.",
        lambda: fleet.partial_answers,
    )
