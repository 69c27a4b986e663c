"""The request header that confirms a large deletion."""

from __future__ import annotations

from starlette.requests import Request

from kg.serving.server.http.problems import Problem
from kg.store.sparql_client import CONFIRM, CONFIRMED


def is_confirmed(request: Request) -> bool:
    """Whether the client confirms deletions; Problem 400 for any other value of the header."""
    given = request.headers.get(CONFIRM)
    if given not in (None, CONFIRMED):
        raise Problem(400, f"{CONFIRM} must be {CONFIRMED!r}, got {given[:40]!r}")
    return given is not None
