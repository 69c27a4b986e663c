"""Clients that take more connections, memory or time than their share, over raw sockets."""

from __future__ import annotations

import select
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import pytest

from kg.serving.server import Limits
from tests.kg.serving.server.conftest import TOKEN
from tests.kg.serving.server.raw_answers import whole_answer

if TYPE_CHECKING:
    from tests.kg.serving.server.conftest import Served

PATIENCE = 40.0  # [s]
GREEDY, OTHER = "127.0.0.66", "127.0.0.2"
HEAD = b"GET /health HTTP/1.1\r\nHost: localhost\r\n"
POST = b"POST /sparql HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/sparql-query\r\n"
BEARER = f"Authorization: Bearer {TOKEN}\r\n".encode()
ASK = "sparql?query=ASK%20%7B%7D"
MOST = 20
LONG = Limits(client_connections=MOST, idle_seconds=PATIENCE, body_seconds=PATIENCE)


class Sockets:
    """Open sockets of the addresses of this machine; a context manager."""

    def __init__(self, served: Served) -> None:
        address = urlsplit(served.url)
        self._server = address.hostname, address.port
        self._stack = ExitStack()

    def open(self, sent: bytes = b"", address: str = GREEDY) -> socket.socket:
        made = self._stack.enter_context(socket.socket())
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 16)
        made.settimeout(PATIENCE)
        made.bind((address, 0))
        made.connect(self._server)
        made.sendall(sent)
        return made

    def __enter__(self) -> Sockets:
        return self

    def __exit__(self, *exception: object) -> None:
        self._stack.close()


@pytest.fixture
def sockets() -> Iterator[Callable[[Served], Sockets]]:
    with ExitStack() as stack:
        yield lambda served: stack.enter_context(Sockets(served))


def status(client: socket.socket, sent: bytes = HEAD + b"\r\n") -> bytes:
    """The status of the next response on a connection that stays open."""
    client.sendall(sent)
    with client.makefile("rb") as told:
        first, length = told.readline(), 0
        while (line := told.readline().lower()) not in (b"\r\n", b""):
            if line.startswith(b"content-length:"):
                length = int(line.partition(b":")[2])
        told.read(length)
    return first.split(b" ")[1]


SILENT, HALF, IDLE = b"", b"GET /hea", HEAD + b"\r\n"
BODY = POST + b"Content-Length: 9\r\n\r\nA"


def has_ended(client: socket.socket) -> bool:
    """Whether the server has closed a connection."""
    client.setblocking(False)
    try:
        while client.recv(1 << 16):
            pass
    except BlockingIOError:
        return False
    except OSError:
        pass
    return True


@pytest.mark.parametrize("begun", [SILENT, HALF, IDLE, BODY])
def test_an_address_has_a_number_of_connections_and_others_are_answered(serve, sockets, begun):
    open_ = sockets(serve(limits=LONG)).open
    kept = open_(address=OTHER)
    assert status(kept) == b"200"
    crowd = [open_(begun) for _ in range(3 * MOST)]
    assert status(open_(address="127.0.0.3")) == b"200"
    assert status(kept) == b"200"
    crowd = [client for client in crowd if not has_ended(client)]
    assert 0 < len(crowd) <= MOST
    told = whole_answer(open_(HEAD + b"Connection: close\r\n\r\n"))  # one more of the address
    if begun != BODY:  # the oldest of those that wait makes room for it
        assert told.startswith(b"HTTP/1.1 200 ")
        return
    assert told.startswith(b"HTTP/1.1 503 ")
    assert b"retry-after: 1\r\n" in told.lower() and b"connection: close\r\n" in told.lower()
    crowd.pop().close()
    crowd[0].settimeout(PATIENCE)
    assert status(crowd[0], b"SK {}   ") == b"200"
    assert status(open_()) == b"200"


def test_who_is_closed_for_others_is_told_so(serve, sockets):
    open_ = sockets(serve(limits=Limits(connections=20, idle_seconds=PATIENCE))).open
    crowd = [open_(b"GET /hea", f"127.0.0.{n + 1}") for n in range(21)]
    told = whole_answer(crowd[0])
    assert told.startswith(b"HTTP/1.1 503 ")
    assert b"Retry-After: 1\r\n" in told and b"Connection: close\r\n" in told


def test_a_trusted_proxy_has_connections_for_all_its_clients(serve, sockets):
    open_ = sockets(serve(limits=LONG, trusted_proxies=(GREEDY,))).open
    crowd = [open_(BODY) for _ in range(2 * MOST)]
    assert {status(client, b"SK {}   ") for client in crowd} == {b"200"}


def test_bodies_have_a_budget_for_each_client_and_small_ones_pass(serve, sockets):
    limits = Limits(client_bodies=300_000, bodies=500_000, body_seconds=PATIENCE)
    served = serve(limits=limits)
    open_ = sockets(served).open
    begun = POST + b"Content-Length: 200000\r\n\r\n" + b" " * 190_000
    both = [open_(begun), open_(begun)]
    (refused,), _, _ = select.select(both, [], [], PATIENCE)  # the one whose bytes came later
    assert whole_answer(refused).startswith(b"HTTP/1.1 503 ")
    (held,) = (one for one in both if one is not refused)
    other = open_(begun, OTHER)
    assert served.post("sparql", data={"query": "ASK {}"}).status_code == 200
    query = b"ASK {}".rjust(10_000)
    for client in (held, other):
        assert status(client, query) == b"200"  # the older ones were not lost
        assert status(client, begun + query) == b"200"  # and their room is free again


def test_a_client_that_reads_nothing_loses_its_answer_when_they_fill_the_memory(serve, sockets):
    limits = Limits(client_unread=0, idle_seconds=PATIENCE)
    head = b"GET /graphs/ontology HTTP/1.1\r\nHost: localhost\r\n\r\n"
    client = sockets(serve(limits=limits)).open(head * 100)
    hung_up = select.poll()
    hung_up.register(client, 0)  # POLLERR and POLLHUP are always reported
    assert hung_up.poll(PATIENCE * 1000)


def test_a_body_that_nobody_asked_for_has_to_arrive_in_time(serve, sockets):
    served = serve(limits=Limits(idle_seconds=0.5))
    client = sockets(served).open(HEAD + b"Content-Length: 1000\r\n\r\n")
    with pytest.raises((BrokenPipeError, ConnectionResetError)):
        while True:
            client.sendall(b"x")
            threading.Event().wait(0.1)


@pytest.mark.parametrize(
    "head",
    [
        POST + b"Content-Length: 6\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\nG",
        POST.replace(b"1.1", b"1.0") + b"Transfer-Encoding: chunked\r\n\r\n0\r\n\r\n",
        POST + b"Content-Length: 5\r\nContent-Length: 6\r\n\r\nASK {}",
        POST + b"Content-Length: 5, 6\r\n\r\nASK {}",
        POST + b"Content-Length: +6\r\n\r\nASK {}",
        POST + b"Content-Length: 0x6\r\n\r\nASK {}",
        POST + b"Content-Length : 6\r\n\r\nASK {}",
        POST + b"Transfer-Encoding: chunked\r\n\r\nzz\r\nASK {}\r\n0\r\n\r\n",
        POST + b"Transfer-Encoding: chunked\r\n\r\n-6\r\nASK {}\r\n0\r\n\r\n",
        POST + b"Transfer-Encoding: chunked\r\n\r\n6\r\nASK {}xx0\r\n\r\n",
        POST + b"Transfer-Encoding: chunked\r\n\r\n6" + b"0" * 30 + b"\r\nASK {}\r\n0\r\n\r\n",
    ],
)
def test_a_body_of_doubtful_length_ends_the_connection(lasting, sockets, head):
    hidden = HEAD + b"\r\n"
    told = whole_answer(sockets(lasting).open(head + hidden))
    assert told.startswith(b"HTTP/1.1 400 ")
    assert told.count(b"HTTP/1.1 ") == 1
    assert b"connection: close" in told.lower()


def test_chunks_and_pipelined_requests_are_read(lasting, sockets):
    chunks = b"Transfer-Encoding: chunked\r\n\r\n1;a=b\r\nA\r\n5\r\nSK {}\r\n0\r\nx: y\r\n\r\n"
    last = HEAD + b"Connection: close\r\n\r\n"
    told = whole_answer(sockets(lasting).open((POST + chunks) * 20 + last))
    assert told.count(b"HTTP/1.1 200 ") == 21


@pytest.mark.parametrize("head", [b"a:\r\n" * 101, b"a: " + b"b" * 17_000 + b"\r\n"])
def test_a_head_of_many_or_long_lines_is_refused(lasting, sockets, head):
    told = whole_answer(sockets(lasting).open(HEAD + head + b"\r\n"))
    assert told == b"" or told.startswith(b"HTTP/1.1 431 ")


def test_an_upgrade_is_ignored(lasting: Served, sockets: Callable[[Served], Sockets]) -> None:
    upgrade = b"Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n\r\n"
    assert status(sockets(lasting).open(), HEAD + upgrade) == b"200"


@pytest.mark.parametrize(
    ("encoding", "status_code"), [("identity", 200), ("gzip", 415), ("deflate", 415), ("br", 415)]
)
def test_bodies_are_read_as_they_are(lasting: Served, encoding: str, status_code: int) -> None:
    kind = {"Content-Type": "application/sparql-query", "Content-Encoding": encoding}
    answer = lasting.post("sparql", data=b"ASK {}", headers=kind)
    assert answer.status_code == status_code
    assert answer.headers.get("Accept-Encoding") == (None if answer.ok else "identity")


def test_a_body_of_tiny_chunks_is_taken_in_smaller_turns(serve, sockets):
    served = serve()
    chunked = POST + BEARER + b"Transfer-Encoding: chunked\r\n\r\n"
    for chunks in (b"1\r\n \r\n" * 3000, b"a\r\n          \r\n" * 300):
        client = sockets(served).open(chunked + chunks + b"6\r\nASK {}\r\n0\r\n\r\n")
        assert status(client, b"") == b"200"
