"""Feeds as server-sent events: `/changes`, each transaction, and `/subscribe`, a query's bindings.

A feed of changes resumes from a sequence number; as JSON it is a page of past transactions. The
query of a subscription is evaluated again after each commit, at most once in `COALESCE` seconds;
the feed reports the bindings that commits add and remove.
"""

from __future__ import annotations

import asyncio
import json
from collections import Counter
from collections.abc import AsyncIterator, Iterable
from functools import partial
from typing import Final

from starlette.concurrency import iterate_in_threadpool
from starlette.requests import Request
from starlette.responses import Response
from starlette.types import ASGIApp

from kg.model.transactions import ChangeSet
from kg.serving.client.record_codec import change_to_json
from kg.serving.server.app_state import AppState
from kg.serving.server.change_broadcast import ChangeBroadcast, Queue
from kg.serving.server.http.bodies import JSON, number_in, query_parameters
from kg.serving.server.http.event_stream import EventStream, event
from kg.serving.server.http.media_types import EVENTS, SOLUTIONS, negotiated
from kg.serving.server.http.problems import Problem
from kg.serving.workers.content_negotiation import negotiate
from kg.serving.workers.process import Answer
from kg.serving.workers.request import query_call

PAGE: Final = 256  # changes of one JSON response
PAGE_BYTES: Final = 4 << 20  # a longer response gets no further change


async def changes(serving: AppState, request: Request) -> ASGIApp:
    """Commits after `Last-Event-ID` or ``?since=``, else from now on.

    Raises Problem: 410 if they are not kept, 503 if there are too many followers.
    """
    kind = negotiated(request, (EVENTS, JSON))
    since = _since(request)
    feed = serving.feed
    if kind == JSON:
        if since is None:
            raise Problem(400, "changes as JSON need ?since=, a sequence number")
        body = await serving.read(request, partial(_page_of, feed.since(since), since))
        return Response(body, media_type=JSON, headers={"Cache-Control": "no-store"})
    queue = Queue(serving.settings.limits.feed_backlog)
    feed.add(queue, request.state.client)
    try:
        past = () if since is None else feed.since(since)
    except BaseException:
        feed.remove(queue)
        raise
    events = _commits(feed, queue, past, since or 0)
    return EventStream(events, queue.ended, partial(feed.remove, queue))


def _page_of(past: Iterable[ChangeSet], since: int) -> bytes:
    """A page of changes; `sequence` is the number of the last, `more` whether others follow."""
    rows: list[str] = []
    last, size, more = since, 0, False
    for change in past:
        if more := (len(rows) >= PAGE or size > PAGE_BYTES):
            break
        rows.append(json.dumps(change_to_json(change), ensure_ascii=False))
        last, size = change.sequence, size + len(rows[-1])
    head = f'{{"sequence": {last}, "more": {json.dumps(more)}, "changes": ['
    return f"{head}{', '.join(rows)}]}}\n".encode()


async def _commits(
    feed: ChangeBroadcast, queue: Queue, past: Iterable[ChangeSet], sent: int
) -> AsyncIterator[bytes]:
    async for change in iterate_in_threadpool(past):
        sent = change.sequence
        yield event(sent, "change", change_to_json(change))
    while True:
        change = await queue.take()
        # changes that were committed while the past was read are in the queue too
        if change.sequence > sent:
            sent = change.sequence
            yield feed.event_of(change)


def _since(request: Request) -> int | None:
    text = request.headers.get("last-event-id") or query_parameters(request).one("since")
    return None if text is None else number_in(text, "since")


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
    follower = QueryFollower(request.state.client)
    _check_number(serving, follower.client)
    serving.subscriptions.append(follower.client)
    try:
        serving.feed.add(follower, follower.client)
        now = serving.semantic_map.sequence
        first = await _evaluate(serving, sparql, now, follower.client)
        _rows(first)
    except BaseException:
        _unsubscribe(serving, follower)
        raise
    return EventStream(
        _bindings(serving, sparql, follower, first),
        follower.ended,
        partial(_unsubscribe, serving, follower),
    )


def _check_number(serving: AppState, client: str) -> None:
    """Raises Problem 503 where all clients, or this one, have as many subscriptions as allowed."""
    limits = serving.settings.limits
    count, own = len(serving.subscriptions), serving.subscriptions.count(client)
    if count >= limits.standing_queries or own >= limits.client_standing_queries:
        raise Problem(
            503,
            f"{count} queries are subscribed to already, {own} of them by you; try later",
            {"Retry-After": "10"},
        )


def _unsubscribe(serving: AppState, follower: QueryFollower) -> None:
    serving.feed.remove(follower)
    serving.subscriptions.remove(follower.client)


async def _bindings(
    serving: AppState, sparql: str, follower: QueryFollower, answer: Answer
) -> AsyncIterator[bytes]:
    rows = _rows(answer)
    # the whole answer comes first, so that a client that reconnects needs no earlier state
    yield _binding_event("result", answer.sequence, rows, Counter())
    while True:
        await follower.changed.wait()
        await asyncio.sleep(COALESCE)
        follower.changed.clear()
        if follower.sequence <= answer.sequence:
            continue
        number, client = follower.sequence, follower.client
        answer = await _evaluate(serving, sparql, number, client, standing=True)
        before, rows = rows, _rows(answer)
        if rows != before:
            yield _binding_event("bindings", answer.sequence, rows - before, before - rows)


async def _evaluate(
    serving: AppState, sparql: str, at_least: int, client: str, *, standing: bool = False
) -> Answer:
    """The answer on a state of the map that holds transaction `at_least`."""
    call = query_call(
        sparql,
        accept=SOLUTIONS,
        base=serving.semantic_map.base,
        at_least=at_least,
        client=client,
        standing=standing,
    )
    answer = await serving.pool.answer_async(call)
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


def _binding_event(kind: str, number: int, added: Counter[str], removed: Counter[str]) -> bytes:
    data = {
        "sequence": number,
        "added": [json.loads(row) for row in added.elements()],
        "removed": [json.loads(row) for row in removed.elements()],
    }
    return event(number, kind, data)
