"""`POST /restore`: restores a past state of the map in one new transaction."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import asdict
from functools import partial
from typing import Any, Final

from starlette.requests import Request
from starlette.responses import Response

from kg.serving.server.app_state import AppState
from kg.serving.server.http.bodies import json_response, read_json
from kg.serving.server.http.client_departure import completed
from kg.serving.server.http.client_sessions import asker_of
from kg.serving.server.http.problems import Problem
from kg.serving.server.http.request_checks import is_confirmed
from kg.serving.server.http.time_parameters import sequence_at
from kg.store.sparql_client import SEQUENCE

_MAX_THINGS: Final = 1000  # things of one request


async def restore(serving: AppState, request: Request) -> Response:
    """Restore the state at `to`; the response has the counts of `Restored`.

    The body is a JSON object: `to` a time or number of a transaction, `only` a list of scopes and
    things (empty: everything), `dry_run` a boolean.
    """
    by = serving.author_of(request)
    given = await read_json(request, serving.settings.limits, ("to", "only", "dry_run"))
    if not isinstance(given["to"], str) or not isinstance(given["dry_run"], bool):
        raise Problem(
            400,
            "'to' must be a text, as in #42 or 2026-08-01T12:30:00Z, and 'dry_run' true or false",
        )
    restoration = partial(
        serving.semantic_map.restore,
        await sequence_at(serving.semantic_map, given["to"]),
        only=_scopes(given["only"]),
        by=by,
        confirmed=is_confirmed(request),
        dry_run=given["dry_run"],
    )
    done = await completed(restoration)
    sequence = done.sequence or serving.semantic_map.sequence
    serving.sessions.saw(asker_of(request).client, sequence)
    return json_response(asdict(done), {SEQUENCE: str(sequence)})


def _scopes(given: Any) -> Collection[str]:
    is_list = isinstance(given, list) and len(given) <= _MAX_THINGS
    if not is_list or not all(isinstance(name, str) for name in given):
        raise Problem(
            400, f"'only' must be a list of up to {_MAX_THINGS} texts, as in [\"object/17\"]"
        )
    return tuple(given)
