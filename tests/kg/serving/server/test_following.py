"""A served map followed from Python: its changes as they come, questions that stand."""

import queue
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from urllib.parse import urlsplit

import pytest

from kg.maps.query.evaluation import Table
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import GraphError, HistoryError
from kg.model.transactions import ChangeSet
from kg.serving.client.remote_map import RemoteMap
from kg.serving.opening import open_map
from kg.serving.server import Limits
from tests.kg.serving.server.conftest import PATIENCE, Served

CUPS = "SELECT ?cup ?x { ?cup a here:Cup ; here:x ?x }"


def open_far(url: str) -> RemoteMap:
    far = open_map(url)
    assert isinstance(far, RemoteMap)
    return far


class Line:
    """The way to a server, which can be cut."""

    def __init__(self, url: str) -> None:
        parts = urlsplit(url)
        self._there = (parts.hostname or "", parts.port or 0)
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.url = f"http://127.0.0.1:{self._listening.getsockname()[1]}"
        self._open: list[socket.socket] = []
        self._guard = threading.Lock()
        self._threads = [threading.Thread(target=self._accept)]
        self._threads[0].start()

    def cut(self) -> None:
        """Break every connection there is."""
        with self._guard:
            ends, self._open = self._open, []
        for end in ends:
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        self._listening.shutdown(socket.SHUT_RDWR)
        self._listening.close()
        self._threads[0].join()
        self.cut()
        for thread in self._threads:
            thread.join()

    def _accept(self) -> None:
        while True:
            try:
                here, _ = self._listening.accept()
            except OSError:
                return
            there = socket.create_connection(self._there)
            with self._guard:
                self._open += [here, there]
            for one, other in ((here, there), (there, here)):
                thread = threading.Thread(target=self._pass_on, args=(one, other))
                self._threads.append(thread)
                thread.start()

    def _pass_on(self, one: socket.socket, other: socket.socket) -> None:
        with suppress(OSError):
            while data := one.recv(1 << 16):
                other.sendall(data)
        for end in (one, other):
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            end.close()


@pytest.fixture
def line(served: Served) -> Iterator[Line]:
    line = Line(served.url)
    yield line
    line.close()


def moves(served: Served, numbers: range) -> None:
    for number in numbers:
        served.move(1, number / 10)


def test_changes_are_followed_from_a_number_on(served: Served) -> None:
    moves(served, range(11, 14))
    with open_far(served.url) as far:
        following = far.subscriptions.follow(2)
        told = [next(following) for _ in range(2)]
        moves(served, range(14, 16))
        told += [next(following) for _ in range(2)]
        kept = list(served.map.history.changes(2))
        assert [(c.sequence, c.time, c.cause) for c in told] == [
            (c.sequence, c.time, c.cause) for c in kept
        ]
        assert [set(c.added) for c in told] == [set(c.added) for c in kept]
        following.close()
        with pytest.raises(HistoryError, match="not at 999"):
            next(far.subscriptions.follow(999))


def test_a_connection_that_breaks_loses_and_repeats_nothing(served: Served, line: Line) -> None:
    moves(served, range(11, 14))
    with open_far(line.url) as far:
        following = far.subscriptions.follow(0)
        told = [next(following).sequence for _ in range(2)]
        line.cut()
        moves(served, range(14, 16))
        told += [next(following).sequence for _ in range(2)]
        line.cut()
        told += [next(following).sequence for _ in range(2)]
        assert told == [1, 2, 3, 4, 5, 6]
        following.close()


def test_who_waits_for_changes_is_woken_when_the_map_is_closed(served: Served) -> None:
    far = open_far(served.url)
    told: queue.Queue[object] = queue.Queue()

    def wait() -> None:
        for change in far.subscriptions.follow(0):
            told.put(change.sequence)
        told.put("over")

    waiting = threading.Thread(target=wait)
    waiting.start()
    assert told.get(timeout=PATIENCE) == 1
    far.close()
    assert told.get(timeout=PATIENCE) == "over"
    waiting.join()


Heard = Callable[[SemanticMap], "queue.Queue[tuple[Table, Table]]"]


@pytest.fixture
def heard() -> Heard:
    """Callable: a map -> what is heard of its cups."""

    def hear(semantic_map: SemanticMap) -> queue.Queue[tuple[Table, Table]]:
        told: queue.Queue[tuple[Table, Table]] = queue.Queue()
        semantic_map.subscriptions.on(CUPS, lambda *rows: told.put(rows))
        return told

    return hear


def changed(told: queue.Queue[tuple[Table, Table]]) -> tuple[list[object], list[object]]:
    added, removed = told.get(timeout=PATIENCE)
    return [row[1] for row in added.rows], [row[1] for row in removed.rows]


def test_a_question_stands_over_http(served: Served, heard: Heard) -> None:
    served.move(1, 1.5)  # before: not reported
    with open_far(served.url) as far:
        served.move(1, 1.6)
        told = heard(far)
        served.move(1, 1.7)
        assert changed(told) == ([1.7], [1.6])
        served.map.update("DELETE WHERE { <object/1> ?p ?o }")
        assert changed(told) == ([], [1.7])
    served.move(1, 1.8)
    assert told.empty(), "a closed map reports nothing"


def test_a_question_stands_through_a_broken_line(served: Served, line: Line, heard: Heard) -> None:
    with open_far(line.url) as far:
        told = heard(far)
        served.move(1, 1.5)
        assert changed(told) == ([1.5], [1.0])
        line.cut()
        served.move(1, 1.6)
        assert changed(told) == ([1.6], [1.5])


def test_who_listens_hears_each_change_once_whoever_makes_it(served, monkeypatch):
    monkeypatch.setenv("HEREABOUTS_TOKEN", served.bearer()["Authorization"].removeprefix("Bearer "))
    monkeypatch.setenv("HEREABOUTS_SERVER", served.url)
    told: queue.Queue[ChangeSet] = queue.Queue()
    with open_far(served.url) as far:
        stop = far.subscriptions.listen(told.put)
        served.move(1, 1.5)
        far.update("INSERT DATA { <object/1> rdfs:comment 'blue' }")
        served.move(1, 1.6)
        kinds = [told.get(timeout=PATIENCE).cause.kind for _ in range(3)]
        assert kinds == ["frame", "update", "frame"]
        stop()
        served.move(1, 1.7)
        far.subscriptions.catch_up()
    assert told.empty()


def test_a_past_that_is_not_kept_is_said(serve: Callable[..., Served]) -> None:
    served = serve(limits=Limits(query_seconds=PATIENCE, feed_memory=1))
    with open_far(served.url) as far:
        moves(served, range(11, 15))
        served.map.history.compact(0.0)
        with pytest.raises(GraphError, match="not kept"):
            far.subscriptions.catch_up()
        with pytest.raises(HistoryError, match="not kept"):
            next(far.subscriptions.follow(1))


def test_nobody_waits_on_a_map_that_is_closed(served: Served) -> None:
    far = open_far(served.url)
    changes = far.subscriptions.follow(far.sequence)
    far.close()
    assert list(changes) == []
