"""The feed of changes: complete, in order, resumable, and cheap to those who do not follow it."""

from __future__ import annotations

import http.client
import socket
import threading
from typing import TYPE_CHECKING

import pytest
from pyoxigraph import Literal, NamedNode, Quad, RdfFormat, parse

from kg.model import vocabulary as v
from kg.model.transactions import Cause
from kg.serving.server import Limits
from tests.waiting import until

if TYPE_CHECKING:
    from collections.abc import Callable

    from conftest import Served, Stream

CUP = "https://example.org/maps/flat/object/1"


def quads(lines: object) -> set[object]:
    return set(parse("\n".join(lines), format=RdfFormat.N_QUADS))  # type: ignore[arg-type]


def test_commit_is_an_event_with_its_quads_and_its_cause(served: Served) -> None:
    heard = []
    served.map.subscriptions.listen(heard.append)
    with served.stream("changes") as stream:
        served.move(1, 3.0)
        number, kind, data = stream.next()
    (change,) = heard
    assert (number, kind) == (change.sequence, "change")
    assert data["sequence"] == number
    assert data["cause"] == {"kind": "frame", "by": None, "note": ""}
    assert quads(data["added"]) == set(change.added)
    assert quads(data["removed"]) == set(change.removed)


def mirror(graph: set[object], stream: Stream, until: int) -> int:
    number = 0
    while number < until:
        number, _, data = stream.next()
        graph -= quads(data["removed"])
        graph |= quads(data["added"])
    return number


def stored(served: Served) -> set[object]:
    return {quad for quad in served.map.engine if "#sequence" not in str(quad.predicate)}


@pytest.mark.parametrize("how", ["header", "parameter"])
def test_follower_that_comes_back_misses_nothing(served: Served, how: str) -> None:
    graph, at = stored(served), served.map.sequence
    for round_ in range(4):
        for step in range(10):
            served.move(1, round_ + step / 20)
        header = {"Last_Event_ID": str(at)} if how == "header" else {}
        given = {"since": at} if how == "parameter" else {}
        with served.stream("changes", given, **header) as stream:
            served.move(2, round_ + 0.33)
            at = mirror(graph, stream, served.map.sequence)
    assert graph == stored(served)


def test_follower_while_others_write_gets_each_commit_once_and_in_order(served: Served) -> None:
    start = served.map.sequence

    def write() -> None:
        for step in range(200):
            served.move(1, step / 50)

    writer = threading.Thread(target=write)
    writer.start()
    until(lambda: served.map.sequence > start)
    with served.stream("changes", params={"since": start}) as stream:
        writer.join()
        last = served.map.sequence
        numbers = [stream.next()[0] for _ in range(last - start)]
    assert numbers == list(range(start + 1, last + 1))


def test_past_beyond_the_memory_comes_from_the_history(serve: Callable[..., Served]) -> None:
    served = serve(limits=Limits(feed_memory=3))
    graph, start = stored(served), served.map.sequence
    for step in range(12):
        served.move(1, step / 10)
    with served.stream("changes", params={"since": start}) as stream:
        mirror(graph, stream, served.map.sequence)
    assert graph == stored(served)


@pytest.mark.parametrize(
    ("since", "status"), [("999999", 410), ("-1", 400), ("yesterday", 400), ("9" * 40, 400)]
)
def test_since_what_never_was_is_refused(lasting: Served, since: str, status: int) -> None:
    assert lasting.get("changes", params={"since": since}).status_code == status


def test_only_events_are_offered(lasting: Served) -> None:
    assert lasting.get("changes", headers={"Accept": "text/html"}).status_code == 406


def test_too_many_followers_are_refused_and_leaving_makes_room(serve):
    served = serve(limits=Limits(feed_clients=2))
    first, second = served.stream("changes"), served.stream("changes")
    refused = served.get("changes")
    assert refused.status_code == 503
    assert "Retry-After" in refused.headers
    first.close()
    until(lambda: served.server.serving.feed.followers == 1)
    with served.stream("changes"):
        served.move(1, 2.0)
    second.close()


def slow_reader(served: Served) -> socket.socket:
    """A client that asks for changes and then reads nothing, with little room in its socket."""
    client = socket.socket()
    client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    client.connect(("127.0.0.1", int(served.url.rstrip("/").rpartition(":")[2])))
    client.sendall(b"GET /changes HTTP/1.1\r\nHost: localhost\r\n\r\n")
    return client


def test_slow_follower_is_dropped_and_the_others_are_not(serve: Callable[..., Served]) -> None:
    served = serve(limits=Limits(feed_backlog=20))
    feed = served.server.serving.feed
    slow = slow_reader(served)
    until(lambda: feed.followers == 1)
    with served.stream("changes") as quick:
        # more than the sockets' buffers hold, whatever the system gives them; then a few more
        steps, more = iter(range(2000)), iter(range(3))
        for step in steps:
            texts = [Literal(f"{step} {part}{'x' * 90_000}") for part in "ab"]
            comment = NamedNode(v.RDFS_COMMENT)
            quads = [Quad(NamedNode(CUP), comment, text, v.MAP_GRAPH) for text in texts]
            served.map.store.commit([], quads, Cause("import"))
            assert quick.next()[0] == served.map.sequence
            if feed.dropped and next(more, None) is None:
                break
    assert feed.dropped == 1
    until(lambda: feed.followers == 0)
    slow.settimeout(120)
    with pytest.raises((ConnectionResetError, EOFError)):
        while slow.recv(1 << 16):
            pass
        raise EOFError
    slow.close()


def test_followers_end_when_the_server_ends(serve: Callable[..., Served]) -> None:
    served = serve()
    with served.stream("changes") as stream:
        served.server.stop()
        with pytest.raises((EOFError, OSError, http.client.HTTPException)) as ended:
            stream.next()
        assert not isinstance(ended.value, TimeoutError)
