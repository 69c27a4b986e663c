"""`/subscribe?query=`: a query that stays, and tells which bindings come and go."""

from __future__ import annotations

import asyncio
import json
from collections import Counter
from collections.abc import AsyncIterator
from functools import partial

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.types import ASGIApp

from kg.commits import ChangeSet
from kg.server.bodies import query_parameters
from kg.server.event_stream import EventStream, event
from kg.server.media_types import EVENTS, SOLUTIONS
from kg.server.problems import Problem
from kg.server.reads import ANYTHING, reads_of
from kg.server.serving import Serving
from kg.workers.formats import negotiate
from kg.workers.process import Answer

COALESCE = 0.2  # [s] after a commit in which further ones are waited for
LARGEST = 1 << 20  # [bytes] of an answer that can be followed


class Dirty:
    """A follower that only notes that, and up to where, something it reads has changed."""

    def __init__(self) -> None:
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


async def subscribe(serving: Serving, request: Request) -> ASGIApp:
    """The query's bindings now, and those added and removed by each commit that concerns it.

    Raises Problem: 400 for what is no SELECT or ASK, 503 where there are too many already.
    """
    negotiate(request.headers.get("accept"), (EVENTS,))
    sparql = query_parameters(request).one("query")
    if not sparql:
        raise Problem(400, "needs ?query=, a SELECT or ASK")
    most = serving.settings.limits.standing_queries
    if len(serving.standing) >= most:
        raise Problem(503, f"{most} queries stand already; try later", {"Retry-After": "10"})
    dirty = Dirty()
    serving.standing.add(dirty)
    try:
        dirty.reads = await run_in_threadpool(partial(reads_of, sparql, serving.semantic_map.base))
        serving.feed.add(dirty)
        first = await _evaluate(serving, sparql, serving.semantic_map.sequence)
        _rows(first)
    except BaseException:
        _leave(serving, dirty)
        raise
    return EventStream(
        _events(serving, sparql, dirty, first), dirty.ended, partial(_leave, serving, dirty)
    )


def _leave(serving: Serving, dirty: Dirty) -> None:
    serving.feed.remove(dirty)
    serving.standing.discard(dirty)


async def _events(
    serving: Serving, sparql: str, dirty: Dirty, answer: Answer
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
        answer = await _evaluate(serving, sparql, dirty.sequence)
        before, rows = rows, _rows(answer)
        if rows != before:
            yield _event("bindings", answer.sequence, rows - before, before - rows)


async def _evaluate(serving: Serving, sparql: str, least: int) -> Answer:
    """The answer to a state of the map that is not older than `least`."""
    base = serving.semantic_map.base
    answer = await serving.pool.run_async(sparql, accept=SOLUTIONS, at_least=least, base=base)
    if len(answer.body) > LARGEST:
        raise Problem(503, f"an answer over {LARGEST} bytes cannot be followed; narrow the query")
    return answer


def _rows(answer: Answer) -> Counter[str]:
    """How often each row stands in an answer; rows as JSON texts."""
    if answer.media_type != SOLUTIONS:
        raise Problem(400, "only SELECT and ASK can be followed")
    told = json.loads(answer.body)
    if "boolean" in told:
        return Counter([json.dumps({"boolean": told["boolean"]})])
    return Counter(json.dumps(row, sort_keys=True) for row in told["results"]["bindings"])


def _event(kind: str, number: int, added: Counter[str], removed: Counter[str]) -> bytes:
    data = {
        "sequence": number,
        "added": [json.loads(row) for row in added.elements()],
        "removed": [json.loads(row) for row in removed.elements()],
    }
    return event(number, kind, data)
