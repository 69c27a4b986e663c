"""`/changes`: each transaction as a server-sent event, resumed from a sequence number.

As JSON the response is a page of past transactions.
"""

from __future__ import annotations

import json
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
from kg.serving.server.http.bodies import JSON, query_parameters
from kg.serving.server.http.event_stream import EventStream, event
from kg.serving.server.http.media_types import EVENTS, accept_of
from kg.serving.server.http.problems import Problem
from kg.serving.workers.content_negotiation import negotiate

PAGE: Final = 256  # changes of one JSON response
PAGE_BYTES: Final = 4 << 20  # a longer response gets no further change


async def changes(serving: AppState, request: Request) -> ASGIApp:
    """Commits after `Last-Event-ID` or ``?since=``, else from now on.

    Raises Problem: 410 if they are not kept, 503 if there are too many followers.
    """
    kind = negotiate(accept_of(request, query_parameters(request)), (EVENTS, JSON))
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
    events = _events(feed, queue, past, since or 0)
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


async def _events(
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
    if text is None:
        return None
    if not (text.isascii() and text.isdigit() and len(text) < 19):
        raise Problem(400, f"since must be a sequence number, got {text[:40]!r}")
    return int(text)
