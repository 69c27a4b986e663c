"""Connections of an HTTP session, seen by a server that notes each one."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import suppress

import pytest
import requests

from kg.store import http_session
from kg.store.http_session import HttpSession

REPLY = b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\nok"
PATIENCE = 60.0  # [s]


class Server:
    """Replies to the requests of its connections; `limit` is how many each is replied to."""

    def __init__(self) -> None:
        self.limit = 99
        self.requests: list[list[bytes]] = []  # of each connection
        self.received = threading.Event()
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.url = f"http://127.0.0.1:{self._listening.getsockname()[1]}"
        self._threads = [threading.Thread(target=self._accept)]
        self._threads[0].start()

    def close(self) -> None:
        self._listening.shutdown(socket.SHUT_RDWR)
        self._listening.close()
        for thread in self._threads:
            thread.join()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                connection, _ = self._listening.accept()
                self.requests.append([])
                thread = threading.Thread(target=self._reply, args=(connection, self.requests[-1]))
                self._threads.append(thread)
                thread.start()

    def _reply(self, connection: socket.socket, received: list[bytes]) -> None:
        with connection, suppress(OSError):
            while head := connection.recv(4096):
                received.append(head.split()[0])
                self.received.set()
                if b"/silent" in head:
                    connection.recv(1)  # until the client goes
                    return
                if len(received) > self.limit:
                    return
                connection.sendall(REPLY)


@pytest.fixture
def server() -> Iterator[Server]:
    server = Server()
    yield server
    server.close()


@pytest.fixture
def session(server: Server) -> Iterator[HttpSession]:
    session = HttpSession(server.url)
    yield session
    session.close()


def send(session: HttpSession, url: str, method: str = "GET") -> bytes:
    safe = method == "GET"
    return session.send(method, url, headers={}, seconds=PATIENCE, safe=safe).content


def test_a_connection_is_kept_for_the_next_request(server: Server, session: HttpSession) -> None:
    for method in ("GET", "POST", "GET"):
        assert send(session, server.url, method) == b"ok"
    assert server.requests == [[b"GET", b"POST", b"GET"]]


def test_threads_share_the_connections(server: Server, session: HttpSession) -> None:
    for _ in range(3):
        thread = threading.Thread(target=send, args=(session, server.url))
        thread.start()
        thread.join()
    assert server.requests == [[b"GET"] * 3]


def test_a_read_is_repeated_where_its_connection_ends_and_a_write_is_not(
    server: Server, session: HttpSession
) -> None:
    server.limit = 1
    send(session, server.url)
    assert send(session, server.url) == b"ok"
    assert server.requests == [[b"GET"] * 2, [b"GET"]]
    with pytest.raises(requests.ConnectionError):
        send(session, server.url, "POST")
    assert server.requests == [[b"GET"] * 2, [b"GET", b"POST"]]


def test_a_connection_idle_for_long_is_not_used_again(
    server: Server, session: HttpSession, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(http_session, "IDLE", 0.0)
    for _ in range(2):
        send(session, server.url, "POST")
    assert server.requests == [[b"POST"], [b"POST"]]


def test_an_interrupt_wakes_a_thread_that_waits_for_a_reply(
    server: Server, session: HttpSession
) -> None:
    failures: list[Exception] = []

    def wait() -> None:
        try:
            send(session, f"{server.url}/silent", "POST")
        except requests.RequestException as error:
            failures.append(error)

    waiting = threading.Thread(target=wait)
    waiting.start()
    assert server.received.wait(PATIENCE)
    session.interrupt()
    waiting.join(PATIENCE / 2)
    assert len(failures) == 1
    with pytest.raises(requests.ConnectionError):
        send(session, server.url)
