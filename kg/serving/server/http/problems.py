"""Error responses: a status and one line, as text or as problem details (RFC 9457)."""

from __future__ import annotations

import http
import json
from collections.abc import Iterable, Mapping
from pathlib import Path

from starlette.responses import Response

from kg.model.errors import (
    ConflictError,
    DiskFullError,
    EngineFailureError,
    GraphError,
    HereaboutsError,
    HistoryError,
    InvalidFactError,
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
