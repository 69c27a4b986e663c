"""`/subscribe?query=`: a continuous query; reports the bindings that commits add and remove.

The query is evaluated again after each commit, at most once in `COALESCE` seconds.
"""

from __future__ import annotations

import asyncio
import json
from collections import Counter
from collections.abc import AsyncIterator
from functools import partial

from starlette.requests import Request
from starlette.types import ASGIApp

from kg.model.transactions import ChangeSet
from kg.serving.server.app_state import AppState
from kg.serving.server.http.bodies import query_parameters
from kg.serving.server.http.clients import asker_of
from kg.serving.server.http.event_stream import EventStream, event
from kg.serving.server.http.media_types import EVENTS, SOLUTIONS
from kg.serving.server.http.problems import Problem
from kg.serving.workers.content_negotiation import negotiate
from kg.serving.workers.process import Answer
from kg.serving.workers.request import Asker

COALESCE = 0.2  # [s] to wait for further commits after a commit
MAX_ANSWER = 1 << 20  # [bytes] of an answer that can be followed


class QueryFollower:
    """Follower that remembers the number of the last commit, not the commits."""

    def __init__(self, client: str) -> None:
        self.client = client
        self.ended = asyncio.Event()
        self.changed = asyncio.Event()
        self.sequence = 0

    def offer(self, change: ChangeSet) -> None:
        """Remember the number of a commit."""
        self.sequence = change.sequence
        self.changed.set()


async def subscribe(serving: AppState, request: Request) -> ASGIApp:
    """The present bindings of a query, then the bindings that commits add and remove.

    Raises Problem: 400 for a query other than SELECT and ASK, 503 for too many subscriptions.
    """
    negotiate(request.headers.get("accept"), (EVENTS,))
    sparql = query_parameters(request).one("query")
    if not sparql:
        raise Problem(400, "needs ?query=, a SELECT or ASK")
    follower = QueryFollower(asker_of(request).client)
    _check_number(serving, follower.client)
    serving.subscriptions.add(follower)
    try:
        serving.feed.add(follower, follower.client)
        asker = Asker(follower.client)
        first = await _evaluate(serving, sparql, serving.semantic_map.sequence, asker)
        _rows(first)
    except BaseException:
        _unsubscribe(serving, follower)
        raise
    return EventStream(
        _events(serving, sparql, follower, first),
        follower.ended,
        partial(_unsubscribe, serving, follower),
    )


def _check_number(serving: AppState, client: str) -> None:
    """Raises Problem 503 where all clients, or this one, have as many subscriptions as allowed."""
    limits = serving.settings.limits
    count = len(serving.subscriptions)
    own = sum(subscription.client == client for subscription in serving.subscriptions)
    if count >= limits.standing_queries or own >= limits.client_standing_queries:
        raise Problem(
            503,
            f"{count} queries are subscribed to already, {own} of them by you; try later",
            {"Retry-After": "10"},
        )


def _unsubscribe(serving: AppState, follower: QueryFollower) -> None:
    serving.feed.remove(follower)
    serving.subscriptions.discard(follower)


async def _events(
    serving: AppState, sparql: str, follower: QueryFollower, answer: Answer
) -> AsyncIterator[bytes]:
    rows = _rows(answer)
    # the whole answer comes first, so that a client that reconnects needs no earlier state
    yield _event("result", answer.sequence, rows, Counter())
    while True:
        await follower.changed.wait()
        await asyncio.sleep(COALESCE)
        follower.changed.clear()
        if follower.sequence <= answer.sequence:
            continue
        asker = Asker(follower.client, standing=True)
        answer = await _evaluate(serving, sparql, follower.sequence, asker)
        before, rows = rows, _rows(answer)
        if rows != before:
            yield _event("bindings", answer.sequence, rows - before, before - rows)


async def _evaluate(serving: AppState, sparql: str, at_least: int, asker: Asker) -> Answer:
    """The answer on a state of the map that holds transaction `at_least`."""
    base = serving.semantic_map.base
    answer = await serving.pool.run_async(
        sparql, accept=SOLUTIONS, at_least=at_least, base=base, asker=asker
    )
    if len(answer.body) > MAX_ANSWER:
        raise Problem(
            503, f"an answer over {MAX_ANSWER} bytes cannot be followed; narrow the query"
        )
    return answer


def _rows(answer: Answer) -> Counter[str]:
    """Multiplicity of each row of a result; rows as JSON texts."""
    if answer.media_type != SOLUTIONS:
        raise Problem(400, "only SELECT and ASK can be followed")
    result = json.loads(answer.body)
    if "boolean" in result:
        return Counter([json.dumps({"boolean": result["boolean"]})])
    return Counter(json.dumps(row, sort_keys=True) for row in result["results"]["bindings"])


def _event(kind: str, number: int, added: Counter[str], removed: Counter[str]) -> bytes:
    data = {
        "sequence": number,
        "added": [json.loads(row) for row in added.elements()],
        "removed": [json.loads(row) for row in removed.elements()],
    }
    return event(number, kind, data)
