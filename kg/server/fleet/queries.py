"""`/sparql` of a fleet: one query, scattered to all members and gathered into one answer.

A query first runs on an empty map, in a worker: so it is known to parse, to keep to what strangers
may ask, and what form its answer has, before any member hears of it.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Final
from urllib.parse import quote

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response

from kg import vocabulary as v
from kg.errors import HereaboutsError, HistoryError, QueryError
from kg.fleet import MEMBER
from kg.history.instants import iso, moment
from kg.server import bodies
from kg.server.bodies import Parameters
from kg.server.fleet import gathering
from kg.server.fleet.members import ACCEPT, Asked, Member, ask_all, lines
from kg.server.fleet.totals import Totals, prologue_of, totals_of
from kg.server.media_types import SOLUTIONS
from kg.server.metrics import Metrics
from kg.server.problems import Problem, problem_of
from kg.server.protocol import QUERY, UPDATE, graphs_of, unless_gone
from kg.server.settings import Settings
from kg.sparql_text import Tail, tail_of
from kg.workers.formats import choose_format
from kg.workers.pool import QueryPool
from kg.workers.vetting import refuse_length

MISSING: Final = "Here-Missing"  # members whose answer is not in this one


@dataclass(slots=True)
class FleetServing:
    """What the parts of a fleet's server share; `scribe` works on an empty map."""

    members: tuple[Member, ...]
    settings: Settings
    scribe: QueryPool
    metrics: Metrics
    partial_answers: int = 0


@dataclass(frozen=True, slots=True)
class _Plan:
    """A query that may be asked, and what becomes of the answers."""

    sparql: str
    asked: Asked
    form: str  # select, ask, construct
    columns: tuple[str, ...]
    tail: Tail
    totals: Totals | None
    media_type: str  # of the answer


async def sparql(fleet: FleetServing, request: Request) -> Response | None:
    """Answer a query; None where the request has none, and wants the service described."""
    given = await _parameters(fleet, request)
    if given is None:
        return None
    work = asyncio.ensure_future(_answer(fleet, given, request.headers.get("accept")))
    return await unless_gone(request, work)


async def _parameters(fleet: FleetServing, request: Request) -> Parameters | None:
    url = bodies.query_parameters(request)
    if "update" in url:
        raise _only_reads()
    if request.method in ("GET", "HEAD"):
        return url if "query" in url else None
    kind = bodies.media_type(request)
    if kind == UPDATE:
        raise _only_reads()
    if kind not in (QUERY, bodies.FORM):
        raise Problem(415, f"a body of type {kind[:100] or '(none)'}; use {QUERY} or {bodies.FORM}")
    if "query" in url:
        raise Problem(400, "'query' stands in the URL of a POST with a body; give one of them")
    body = await bodies.read_body(request, fleet.settings.limits)
    if kind == QUERY:
        return Parameters((("query", bodies.text(body)),)) + url
    form = bodies.form_parameters(body)
    if "update" in form:
        raise _only_reads()
    if "query" not in form:
        raise Problem(400, "the form needs a 'query'")
    return form + url


def refuse_past(given: Parameters) -> None:
    """Raises Problem 400 where a moment is asked for: a thing's past is for its map to tell."""
    if "at" in given:
        raise Problem(400, "a fleet shows things as they are now: leave out 'at', or ask one map")


def _time(given: Parameters) -> str | None:
    """The time that is asked about; Problem 400 for what is none."""
    text = given.one("at")
    if text is None:
        return None
    try:
        return iso(moment(text.strip()))
    except HistoryError as error:
        raise Problem(
            400,
            f"a fleet is asked at a time, as in 2026-08-01T12:30:00Z, got {text[:60]!r}: "
            "transactions are counted by each map, ask one of them",
        ) from error


def _only_reads() -> Problem:
    return Problem(403, "a fleet only reads: send updates to the member they are for")


async def _answer(fleet: FleetServing, given: Parameters, accept: str | None) -> Response:
    plan = await _plan(fleet, given, accept)
    answers, errors = await ask_all(fleet.members, lambda member: member.ask(plan.asked))
    headers = missing(errors, answers, partly=given.flag("partial"))
    fleet.partial_answers += bool(errors)
    body = await run_in_threadpool(partial(_gathered, fleet, plan, answers))
    return Response(body, media_type=plan.media_type, headers={"Vary": "Accept", **headers})


async def _plan(fleet: FleetServing, given: Parameters, accept: str | None) -> _Plan:
    text = given.one("query") or ""
    refuse_length(text)
    at = _time(given)
    default, named = graphs_of(given, "default-graph-uri"), graphs_of(given, "named-graph-uri")
    tried = await fleet.scribe.run_async(
        text, accept=ACCEPT, default_graphs=default, named_graphs=named, base=v.HERE
    )
    told = json.loads(tried.body) if tried.media_type == SOLUTIONS else {}
    form = "ask" if "boolean" in told else "select" if told else "construct"
    columns = tuple(told.get("head", {}).get("vars", ()))
    tail = tail_of(text)
    totals = totals_of(text) if given.flag("total") else None
    if totals is None:
        _refuse_what_cannot_be_gathered(form, columns, tail)
    return _Plan(
        sparql=text,
        asked=Asked(totals.members if totals else text, default, named, at),
        form=form,
        columns=columns,
        tail=tail,
        totals=totals,
        media_type=choose_format(accept, "construct" if form == "construct" else "select"),
    )


def _refuse_what_cannot_be_gathered(form: str, columns: tuple[str, ...], tail: Tail) -> None:
    if MEMBER in columns:
        raise QueryError(f"?{MEMBER} is the fleet's own column: it names the map a row is from")
    if tail.offset:
        raise QueryError("OFFSET cannot be kept over several maps; use LIMIT, or ask one map")
    if form == "construct" and tail.limit is not None:
        raise QueryError("LIMIT of CONSTRUCT or DESCRIBE cannot be kept over several maps")


def _gathered(fleet: FleetServing, plan: _Plan, answers: Mapping[str, bytes]) -> bytes:
    if plan.form == "ask":
        return gathering.written_truth(gathering.any_true(answers), plan.media_type)
    if plan.form == "construct":
        return gathering.written_triples(gathering.triples_of(answers), plan.media_type)
    rows = gathering.rows_of(answers, plan.columns)
    if plan.totals is not None:
        return fleet.scribe.run(plan.totals.over(rows), accept=plan.media_type).body
    prologue = prologue_of(plan.sparql)
    rows = gathering.in_order(rows, plan.columns, plan.tail, prologue, fleet.scribe)
    return gathering.written_rows(rows, plan.columns, plan.media_type)


def missing(
    errors: Mapping[str, HereaboutsError], answers: Mapping[str, object], *, partly: bool
) -> dict[str, str]:
    """The header that names who is missing from an answer.

    Raises Problem, naming them and why, where somebody is missing and no part is wanted (`partly`),
    or nobody answered: 502, or what all of them say alike (400, 503, 504).
    """
    if not errors:
        return {}
    if answers and partly:
        return {MISSING: ", ".join(quote(name, safe="/:.-_~@[]") for name in errors)}
    told = "; ".join(f"no answer from {name}: {why}" for name, why in lines(errors).items())
    hint = "; ask with partial=1 for the answers of the others" if answers else ""
    problems = {problem_of(error).status for error in errors.values()}
    status = problems.pop() if len(problems) == 1 and not answers else 502
    headers = {"Retry-After": "1"} if status in (502, 503) else None
    raise Problem(status, told + hint, headers)
