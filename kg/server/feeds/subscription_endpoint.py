"""`/subscribe?query=`: a continuous query that reports added and removed bindings."""

from __future__ import annotations

import asyncio
import json
from collections import Counter
from collections.abc import AsyncIterator
from functools import partial

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.types import ASGIApp

from kg.server.app_state import AppState
from kg.server.endpoints.sparql_protocol import asker_of
from kg.server.feeds.event_stream import EventStream, event
from kg.server.feeds.query_dependencies import ANYTHING, reads_of
from kg.server.http.bodies import query_parameters
from kg.server.http.media_types import EVENTS, SOLUTIONS
from kg.server.http.problems import Problem
from kg.transactions import ChangeSet
from kg.workers.content_negotiation import negotiate
from kg.workers.process import Answer
from kg.workers.request import Asker

COALESCE = 0.2  # [s] after a commit in which further ones are waited for
LARGEST = 1 << 20  # [bytes] of an answer that can be followed


class Dirty:
    """A follower that only notes that, and up to where, something it reads has changed."""

    def __init__(self, client: str) -> None:
        self.client = client
        self.ended = asyncio.Event()
        self.changed = asyncio.Event()
        self.sequence = 0
        self.skipped = 0  # commits that could not matter
        self.reads = ANYTHING

    def offer(self, change: ChangeSet) -> None:
        """Note a commit, unless the query cannot depend on it."""
        if self.reads.concern(change.added) or self.reads.concern(change.removed):
            self.sequence = change.sequence
            self.changed.set()
        else:
            self.skipped += 1


async def subscribe(serving: AppState, request: Request) -> ASGIApp:
    """The query's bindings now, and those added and removed by each commit that concerns it.

    Raises Problem: 400 for what is no SELECT or ASK, 503 where there are too many already.
    """
    negotiate(request.headers.get("accept"), (EVENTS,))
    sparql = query_parameters(request).one("query")
    if not sparql:
        raise Problem(400, "needs ?query=, a SELECT or ASK")
    dirty = Dirty(asker_of(request).client)
    _refuse_many(serving, dirty.client)
    serving.subscriptions.add(dirty)
    try:
        dirty.reads = await run_in_threadpool(partial(reads_of, sparql, serving.semantic_map.base))
        serving.feed.add(dirty, dirty.client)
        asker = Asker(dirty.client)
        first = await _evaluate(serving, sparql, serving.semantic_map.sequence, asker)
        _rows(first)
    except BaseException:
        _leave(serving, dirty)
        raise
    return EventStream(
        _events(serving, sparql, dirty, first), dirty.ended, partial(_leave, serving, dirty)
    )


def _refuse_many(serving: AppState, client: str) -> None:
    """Raises Problem 503 where all together, or this client, subscribe to enough queries."""
    limits = serving.settings.limits
    count = len(serving.subscriptions)
    own = sum(subscription.client == client for subscription in serving.subscriptions)
    if count >= limits.standing_queries or own >= limits.client_standing_queries:
        raise Problem(
            503,
            f"{count} queries are subscribed to already, {own} of them by you; try later",
            {"Retry-After": "10"},
        )


def _leave(serving: AppState, dirty: Dirty) -> None:
    serving.feed.remove(dirty)
    serving.subscriptions.discard(dirty)


async def _events(
    serving: AppState, sparql: str, dirty: Dirty, answer: Answer
) -> AsyncIterator[bytes]:
    rows = _rows(answer)
    # the whole answer first, so that a client that comes back needs no memory of before
    yield _event("result", answer.sequence, rows, Counter())
    while True:
        await dirty.changed.wait()
        await asyncio.sleep(COALESCE)
        dirty.changed.clear()
        if dirty.sequence <= answer.sequence:
            continue
        behind_others = Asker(dirty.client, standing=True)
        answer = await _evaluate(serving, sparql, dirty.sequence, behind_others)
        before, rows = rows, _rows(answer)
        if rows != before:
            yield _event("bindings", answer.sequence, rows - before, before - rows)


async def _evaluate(serving: AppState, sparql: str, least: int, asker: Asker) -> Answer:
    """The answer to a state of the map that is not older than `least`."""
    base = serving.semantic_map.base
    answer = await serving.pool.run_async(
        sparql, accept=SOLUTIONS, at_least=least, base=base, asker=asker
    )
    if len(answer.body) > LARGEST:
        raise Problem(503, f"an answer over {LARGEST} bytes cannot be followed; narrow the query")
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
