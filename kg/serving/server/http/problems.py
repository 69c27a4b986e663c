"""Problem details (RFC 9457) for errors, and conditional requests (RFC 9110, section 13)."""

from __future__ import annotations

import http
import json
import re
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC
from email.utils import parsedate_to_datetime
from functools import partial
from pathlib import Path
from typing import Final

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response

from kg.history.timestamps import instant, sequence_of
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import (
    ConflictError,
    DiskFullError,
    EngineFailureError,
    GraphError,
    HereaboutsError,
    HistoryError,
    InvalidFactError,
    ModelError,
    NotAcceptableError,
    OntologyError,
    PoolBusyError,
    ProtectedError,
    QueryError,
    QueryTimeoutError,
    QueryTooLargeError,
    ServerError,
    UnconfirmedDeletionError,
)

MAX_MESSAGE = 2000  # characters of a message, which may quote a client
MAX_THINGS = 1000  # in the response to a conflict
#: HTTP status of each error of `kg.model.errors`; the first match counts
_STATUS: tuple[tuple[type[HereaboutsError], int], ...] = (
    (NotAcceptableError, 406),
    (QueryTimeoutError, 504),
    (QueryTooLargeError, 503),
    (PoolBusyError, 503),
    (EngineFailureError, 500),
    (QueryError, 400),
    (ProtectedError, 403),
    (UnconfirmedDeletionError, 428),
    (InvalidFactError, 422),
    (OntologyError, 422),
    (ModelError, 422),  # a text that an encoder does not know
    (HistoryError, 404),
    (ConflictError, 409),
    (DiskFullError, 507),
    (GraphError, 503),
)


_PASSING = (PoolBusyError, GraphError)  # a retry may succeed


class Problem(ServerError):  # noqa: N818  RFC 9457 calls it so
    """Refusal of a request, with its HTTP status."""

    def __init__(
        self,
        status: int,
        message: str,
        headers: Mapping[str, str] | None = None,
        *,
        kind: str | None = None,
        things: Iterable[str] = (),
    ) -> None:
        super().__init__(message)
        self.status = status
        self.headers = dict(headers or {})
        self.kind = kind  # name of the error of `kg.model.errors`, so that a client can raise it
        self.things = tuple(things)  # IRIs of a ConflictError


def problem_of(error: HereaboutsError) -> Problem:
    """The problem for an error of `kg.model.errors`."""
    if isinstance(error, Problem):
        return error
    status = next((status for kind, status in _STATUS if isinstance(error, kind)), 500)
    passing = isinstance(error, _PASSING) and status == 503
    later = "5" if isinstance(error, PoolBusyError) else "1"
    headers = {"Retry-After": later} if passing else None
    things = error.things[:MAX_THINGS] if isinstance(error, ConflictError) else ()
    return Problem(status, str(error), headers, kind=type(error).__name__, things=things)


def without_paths(problem: Problem, folders: Iterable[Path]) -> Problem:
    """The problem without the paths of the server's folders."""
    message = str(problem)
    for folder in sorted(map(str, folders), key=len, reverse=True):
        message = message.replace(f"{folder}/", "").replace(folder, "the map")
    problem.args = (message,)
    return problem


def problem_response(problem: Problem, accept: str | None) -> Response:
    """One line of text, or JSON problem details if the client accepts JSON."""
    message = " ".join(str(problem).split())[:MAX_MESSAGE]
    if accept and "json" in accept:
        body = {
            "title": http.HTTPStatus(problem.status).phrase,
            "status": problem.status,
            "detail": message,
            **({} if problem.kind is None else {"error": problem.kind}),
            **({"things": problem.things} if problem.things else {}),
        }
        return Response(
            json.dumps(body, ensure_ascii=False) + "\n",
            status_code=problem.status,
            headers=problem.headers,
            media_type="application/problem+json",
        )
    return Response(
        message + "\n",
        status_code=problem.status,
        headers=problem.headers,
        media_type="text/plain",
    )


MAX_DATE: Final = 60  # letters


@dataclass(frozen=True, slots=True)
class State:
    """The state of the map in a response."""

    sequence: int
    form: str = ""  # format, if all responses of a state in this format are the same

    @property
    def tag(self) -> str:
        """Entity tag; weak if responses in other formats have the same tag."""
        return f'"{self.sequence}-{self.form}"' if self.form else f'W/"{self.sequence}"'

    @property
    def headers(self) -> dict[str, str]:
        """Response headers."""
        return {"ETag": self.tag, "Cache-Control": "no-cache"}

    def is_known_to(self, request: Request) -> bool:
        """Whether the client has this state already."""
        given = {tag.removeprefix("W/") for tag in _tags(request, "if-none-match")}
        return "*" in given or self.tag.removeprefix("W/") in given


def check_preconditions(request: Request, state: State, *, exists: bool) -> None:
    """Raise Problem 412 if the precondition of a write names another state.

    The format of the state does not matter. A weak tag never matches in If-Match.
    """
    match = _tags(request, "if-match")
    if match and not (exists and any(_is_of(tag, state) for tag in match)):
        raise Problem(
            412, f"the map is at {state.sequence}, which If-Match does not name; read it again"
        )
    none = [tag.removeprefix("W/") for tag in _tags(request, "if-none-match")]
    if exists and any(_is_of(tag, state) for tag in none):
        raise Problem(412, "it exists, against If-None-Match")


def _is_of(tag: str, state: State) -> bool:
    return tag == "*" or re.fullmatch(rf'"{state.sequence}(-\w+)?"', tag) is not None


def _tags(request: Request, header: str) -> list[str]:
    """The entity tags in a header; none without it."""
    given = request.headers.get(header)
    return [] if given is None else [tag.strip() for tag in given.split(",")]


async def sequence_at(semantic_map: SemanticMap, text: str, *, since: bool = False) -> int:
    """The transaction of a moment (`sequence_of`), which is text as of `instant`.

    Raises Problem: 400 for an invalid moment, 404 if that past is not kept.
    """
    try:
        when = instant(text, time.time())
    except HistoryError as error:
        raise Problem(400, str(error)) from error
    log = semantic_map.history.log
    return await run_in_threadpool(partial(sequence_of, log, when, since=since))


def http_date(text: str) -> float:
    """A date of HTTP (RFC 9110, section 5.6.7) in seconds since 1970; raises ValueError."""
    if len(text) > MAX_DATE:
        raise ValueError(f"a date of {len(text)} letters")
    try:
        given = parsedate_to_datetime(text)
        return (given if given.tzinfo else given.replace(tzinfo=UTC)).timestamp()
    except OverflowError as error:
        raise ValueError(str(error)) from error
