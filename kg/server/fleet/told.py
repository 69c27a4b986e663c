"""`/assertions`, `/log`, `/why` and `/diff` of a fleet: asked of the member whose thing it is.

A member is named by ``?member=``, or is the one whose map the IRI begins with; where that says
nothing, all are asked. Each answer is one map's: several are never mixed, but for the list of
assertions, which says whose each is.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Final
from urllib.parse import quote

from starlette.requests import Request
from starlette.responses import Response

from kg.errors import HereaboutsError, QueryParameterError
from kg.server.bodies import Parameters, query_parameters
from kg.server.fleet.members import Member, ask_all
from kg.server.fleet.queries import FleetServing, missing
from kg.server.past import JSON, TYPES
from kg.server.problems import Problem
from kg.workers.formats import negotiate

MEMBER: Final = "Here-Member"  # whose answer it is
PATHS: Final = ("/assertions", *(f"/{what}" for what in TYPES))

_Answers = dict[str, tuple[str, bytes]]
_Errors = dict[str, HereaboutsError]


async def told(fleet: FleetServing, request: Request) -> Response:
    """What the member says that the request is for; Problem where that is not clear, or nobody."""
    if request.method not in ("GET", "HEAD"):
        raise Problem(403, "a fleet only reads: write to the member it is for")
    what, given = request.url.path.strip("/"), query_parameters(request)
    media_type = negotiate(request.headers.get("accept"), TYPES.get(what, (JSON,)))
    members = _for(fleet, what, given)
    asked = Parameters(tuple(p for p in given.pairs if p[0] not in ("member", "partial")))
    answers, errors = await ask_all(members, lambda member: member.tell(what, asked, media_type))
    if what == "assertions":
        headers = missing(errors, answers, partly=given.flag("partial"))
        return _json(_all_said(answers), headers)
    return _one(fleet, what, answers, errors, len(members) == 1)


def _for(fleet: FleetServing, what: str, given: Parameters) -> tuple[Member, ...]:
    """The members to be asked."""
    names = ", ".join(member.name for member in fleet.members)
    if (name := given.one("member")) is not None:
        found = tuple(member for member in fleet.members if member.name == name)
        if not found:
            raise Problem(404, f"no member {name[:200]!r}; there are: {names}")
        return found
    if len(fleet.members) == 1:
        return fleet.members
    if what == "diff":
        raise Problem(400, f"each map has a past of its own: add member=, one of {names}")
    about = (given.one("iri") or given.one("what") or "").strip()
    if not about and what != "assertions":
        raise Problem(400, f"/{what} needs iri=, the whole IRI of a thing")
    if not about:
        return fleet.members
    iri = about.split()[0].strip("<>")
    if ":" not in iri:
        raise Problem(
            400, f"{iri[:200]!r} may be any map's: give its whole IRI, or member=, one of {names}"
        )
    return _owners(fleet.members, iri)


def _owners(members: tuple[Member, ...], iri: str) -> tuple[Member, ...]:
    """Those whose map the IRI begins with, the longest such; all where that is none's."""
    bases = {m.known[0] for m in members if m.known and iri.startswith(m.known[0])}
    if not bases:
        return members
    longest = max(bases, key=len)
    return tuple(m for m in members if m.known and m.known[0] == longest)


def _one(
    fleet: FleetServing, what: str, answers: _Answers, errors: _Errors, alone: bool
) -> Response:
    """The one answer there is."""
    # who does not know the thing has answered: only those that could not be asked are missing
    if alone and errors:
        raise next(iter(errors.values()))
    away = {n: e for n, e in errors.items() if not isinstance(e, QueryParameterError)}
    missing(away, answers, partly=len(answers) == 1)
    if len(answers) > 1:
        names = ", ".join(answers)
        raise Problem(400, f"several maps can tell /{what} of that: add member=, one of {names}")
    if not answers:
        raise Problem(404, f"no map of this fleet can tell /{what} of that")
    ((name, (media_type, body)),) = answers.items()
    headers = {"Vary": "Accept", MEMBER: quote(name, safe="/:.-_~@[]")}
    return Response(body, media_type=media_type, headers=headers)


def _all_said(answers: _Answers) -> list[Mapping[str, Any]]:
    return [
        {"member": name, **said}
        for name, (_, body) in answers.items()
        for said in json.loads(body)["assertions"]
    ]


def _json(said: list[Mapping[str, Any]], headers: Mapping[str, str]) -> Response:
    body = json.dumps({"assertions": said}, ensure_ascii=False) + "\n"
    return Response(body, media_type=JSON, headers={"Vary": "Accept", **headers})
