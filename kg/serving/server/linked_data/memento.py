"""Memento (RFC 7089): past versions of the resources of the map.

- The address of a resource is its own TimeGate (pattern 1.2): with `Accept-Datetime` the response
  is the version at that time. `Content-Location` is the address of the version, with ``?at=`` and
  the number of its transaction.
- `/timegate/ADDRESS` redirects to a version (pattern 2.1).
- `/timemap?iri=` lists the latest versions.
"""

from __future__ import annotations

from collections.abc import Iterable
from datetime import UTC, datetime
from email.utils import format_datetime
from functools import partial
from typing import Final
from urllib.parse import quote

from pyoxigraph import NamedNode, Quad
from starlette.requests import Request
from starlette.responses import Response

from kg.history.point_in_time import Version, first_version, state_of, version_at, versions
from kg.history.storage.log import BACKGROUND, HistoryLog
from kg.model.errors import HistoryError
from kg.serving.server.app_state import AppState
from kg.serving.server.http.bodies import query_parameters
from kg.serving.server.http.problems import Problem, http_date, sequence_at
from kg.serving.server.linked_data.descriptions import (
    ResourceDescription,
    iri_at,
    local_path,
)

LINKS: Final = "application/link-format"
MAX_VERSIONS: Final = 1000  # of one TimeMap
VARY: Final = "Accept, Accept-Datetime"
_WITHIN_A_SECOND = 0.9995  # [s] added to HTTP dates, which are whole seconds


def links(serving: AppState, request: Request, iri: str) -> dict[str, str]:
    """The header Link of a resource: original, TimeGate and TimeMap."""
    if not iri.startswith(serving.semantic_map.base) or not _has_history(serving):
        return {}
    here = _original(serving, request, iri)
    times = f"{request.base_url}timemap?iri={quote(iri, safe='')}"
    relations = f'<{here}>; rel="original"', f'<{here}>; rel="timegate"'
    return {"Link": ", ".join((*relations, f'<{times}>; rel="timemap"; type="{LINKS}"'))}


async def memento(
    serving: AppState, request: Request, iri: str
) -> tuple[ResourceDescription, dict[str, str]] | None:
    """State of `iri` at the requested datetime, and headers; None where none is requested.

    Raises Problem: 400 for an invalid datetime, 404 where no facts of then are kept.
    """
    moment = query_parameters(request).one("at")
    wanted = request.headers.get("accept-datetime")
    if moment is None and (wanted is None or not _has_history(serving)):
        return None
    log = serving.semantic_map.history.log
    if moment is None:
        time = _parsed(wanted or "")
        version = await serving.read(request, partial(_closest, log, iri, time))
        if version is None:  # a resource without versions is answered as it is
            return None
    else:
        sequence = await sequence_at(serving.semantic_map, moment)
        version = await serving.read(request, partial(version_at, log, iri, sequence))
    about = await serving.read(request, partial(_facts_of, log, iri, version))
    if version is None or not about:
        headers = {"Vary": VARY, **links(serving, request, iri)}
        raise Problem(404, f"the map had no facts about {iri[:200]} at that time", headers)
    return ResourceDescription(iri, about, ()), _headers(serving, request, iri, version)


async def timegate(serving: AppState, request: Request) -> Response:
    """TimeGate that redirects: ``/timegate/`` and the address or the IRI of a resource."""
    raw = request.scope.get("raw_path", b"").decode("ascii", "replace").partition("?")[0]
    query = request.scope["query_string"].decode("ascii", "replace")
    address = raw.partition("/timegate/")[2] + (f"?{query}" if query else "")
    iri = iri_at(serving.semantic_map.base, str(request.base_url), address)
    wanted = request.headers.get("accept-datetime")
    log = serving.semantic_map.history.log
    if wanted is None:
        find = partial(version_at, log, iri, log.last)
    else:
        find = partial(_closest, log, iri, _parsed(wanted))
    version = await serving.read(request, find)
    headers = {"Vary": "Accept-Datetime", **links(serving, request, iri)}
    if version is None or version.empty:
        raise Problem(404, f"no version of {iri[:200]} at that time is kept", headers)
    headers["Location"] = _address(serving, request, iri, version)
    return Response(status_code=302, headers=headers)


async def timemap(serving: AppState, request: Request) -> Response:
    """TimeMap of the resource ``?iri=``: its latest versions, in order of time."""
    try:
        iri = NamedNode(query_parameters(request).one("iri") or "").value
    except ValueError as error:
        raise Problem(400, "needs ?iri=, an absolute IRI") from error
    log = serving.semantic_map.history.log
    found = await serving.read(request, partial(versions, log, iri, max_count=MAX_VERSIONS))
    if not any(not version.empty for version in found):
        raise Problem(404, f"no versions of {iri[:200]} are kept")
    body = ",\n".join(_entries(serving, request, iri, found)) + "\n"
    return Response(body, media_type=LINKS)


def _entries(serving: AppState, request: Request, iri: str, found: list[Version]) -> Iterable[str]:
    here, mementos = _original(serving, request, iri), [v for v in found if not v.empty][::-1]
    span = f'; from="{_date(mementos[0].time)}"; until="{_date(mementos[-1].time)}"'
    yield f'<{here}>; rel="original"'
    yield f'<{here}>; rel="timegate"'
    yield f'<{request.url}>; rel="self"; type="{LINKS}"{span}'
    for version in mementos:
        address = _address(serving, request, iri, version)
        yield f'<{address}>; rel="memento"; datetime="{_date(version.time)}"'


def _closest(log: HistoryLog, iri: str, time: float) -> Version | None:
    """The version at a time; the first version for earlier times (RFC 7089, section 4.5.3)."""
    found = None
    if time + _WITHIN_A_SECOND >= log.floor_time:
        found = version_at(log, iri, log.sequence_at(time + _WITHIN_A_SECOND))
    return first_version(log, iri) if found is None else found


def _facts_of(log: HistoryLog, iri: str, version: Version | None) -> tuple[Quad, ...]:
    """Facts of a version; empty if it is not kept any more."""
    if version is None or version.empty:
        return ()
    state_quads = state_of(log, iri, version.sequence)
    kept = log.floor <= version.sequence
    return tuple(quad for quad in state_quads if kept and quad.graph_name not in BACKGROUND)


def _headers(serving: AppState, request: Request, iri: str, version: Version) -> dict[str, str]:
    return {
        "Memento-Datetime": _date(version.time),
        "Content-Location": _address(serving, request, iri, version),
        "Vary": VARY,
        **links(serving, request, iri),
        "Cache-Control": "no-cache",
    }


def _address(serving: AppState, request: Request, iri: str, version: Version) -> str:
    here = _original(serving, request, iri)
    return f"{here}{'&' if '?' in here else '?'}at={version.sequence}"


def _original(serving: AppState, request: Request, iri: str) -> str:
    return str(request.base_url).rstrip("/") + local_path(serving.semantic_map.base, iri)


def _has_history(serving: AppState) -> bool:
    try:
        return serving.semantic_map.history.log.begun
    except HistoryError:
        return False


def _parsed(text: str) -> float:
    try:
        return http_date(text)
    except ValueError as error:
        raise Problem(
            400,
            f"Accept-Datetime must be an HTTP date, as Sat, 01 Aug 2026 12:30:00 GMT; "
            f"got {text[:60]!r}",
        ) from error


def _date(time: float) -> str:
    return format_datetime(datetime.fromtimestamp(int(time), UTC), usegmt=True)
