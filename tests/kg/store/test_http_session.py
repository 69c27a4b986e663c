"""Credentials and sessions of HTTP."""

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest
import requests

from kg.model.errors import HereaboutsError, RemoteError
from kg.serving.client.change_stream import ChangeStream
from kg.serving.client.served_server import ServedClient
from kg.store import http_session
from kg.store.credentials import token_for
from kg.store.http_session import HttpSession
from kg.store.sparql_client import SparqlClient

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


def test_a_read_is_repeated_where_its_connection_ends_and_a_write_is_not(server, session):
    server.limit = 1
    send(session, server.url)
    assert send(session, server.url) == b"ok"
    assert server.requests == [[b"GET"] * 2, [b"GET"]]
    with pytest.raises(requests.ConnectionError):
        send(session, server.url, "POST")
    assert server.requests == [[b"GET"] * 2, [b"GET", b"POST"]]


def test_a_connection_idle_for_long_is_not_used_again(server, session, monkeypatch):
    monkeypatch.setattr(http_session, "IDLE", 0.0)
    for _ in range(2):
        send(session, server.url, "POST")
    assert server.requests == [[b"POST"], [b"POST"]]


def test_an_interrupt_wakes_a_thread_that_waits_for_a_reply(server, session):
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


TOKEN = "the-token-of-the-trusted-server"


class Listener(ThreadingHTTPServer):
    """Answers ASK and JSON, or sends elsewhere; `heard` are the Authorization headers it got."""

    def __init__(self, elsewhere: str = "") -> None:
        super().__init__(("127.0.0.1", 0), Answers)
        self.elsewhere = elsewhere
        self.heard: list[str | None] = []

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_address[1]}"


class Answers(BaseHTTPRequestHandler):
    def _answer(self) -> None:
        server = self.server
        assert isinstance(server, Listener)
        server.heard.append(self.headers["Authorization"])
        self.rfile.read(int(self.headers.get("Content-Length", 0)))
        body = b'{"head": {}, "boolean": true}'
        if server.elsewhere:
            self.send_response(307)
            self.send_header("Location", server.elsewhere + self.path)
            body = b""
        else:
            self.send_response(200)
            self.send_header("Content-Type", "application/sparql-results+json")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    do_GET = do_POST = do_DELETE = do_PUT = _answer  # noqa: N815  the library calls them so

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def listen() -> Iterator[Callable[..., Listener]]:
    """Callable: where to send who asks (nowhere) -> a running server."""
    with ExitStack() as stack:

        def start(elsewhere: str = "") -> Listener:
            server = stack.enter_context(Listener(elsewhere))
            thread = threading.Thread(target=server.serve_forever)
            thread.start()
            stack.callback(thread.join)
            stack.callback(server.shutdown)
            return server

        yield start


@pytest.fixture
def trusted(listen: Callable[..., Listener], monkeypatch: pytest.MonkeyPatch) -> Listener:
    server = listen()
    monkeypatch.setenv("HEREABOUTS_TOKEN", TOKEN)
    monkeypatch.setenv("HEREABOUTS_SERVER", server.url + "/")
    return server


def ask_once(url: str) -> None:
    served = ServedClient(url)
    with suppress(HereaboutsError):
        assert served.sequence
    with suppress(HereaboutsError):
        served.delete("assertions", iri="object/1", property="category")
    endpoint = SparqlClient(url, f"{url}/sparql", f"{url}/sparql")
    endpoint.ask("ASK {}")
    endpoint.update("INSERT DATA {}")
    endpoint.close()
    with suppress(HereaboutsError):
        served.fetch("sparql", (("query", "ASK {}"),), "*/*", seconds=9, max_bytes=999)
    follower = ChangeStream(url, 0)
    with suppress(HereaboutsError):
        list(follower._connected())
    follower.close()
    served.close()


def test_the_token_goes_to_its_server(trusted: Listener) -> None:
    ask_once(trusted.url)
    assert set(trusted.heard) == {f"Bearer {TOKEN}"}
    assert len(trusted.heard) >= 6


def test_no_other_server_gets_it(trusted: Listener, listen: Callable[..., Listener]) -> None:
    other = listen()
    ask_once(other.url)
    assert set(other.heard) == {None}
    assert len(other.heard) >= 6


def test_no_redirect_carries_it_elsewhere(listen, monkeypatch):
    other = listen()
    trusted = listen(other.url)
    monkeypatch.setenv("HEREABOUTS_TOKEN", TOKEN)
    monkeypatch.setenv("HEREABOUTS_SERVER", trusted.url)
    ask_once(trusted.url)
    assert set(trusted.heard) == {f"Bearer {TOKEN}"}
    assert set(other.heard) <= {None}


@pytest.mark.parametrize(
    "url",
    [
        "http://maps.example.org.evil.example:8008/",
        "http://maps.example.org@evil.example:8008/",
        "http://maps.example.org:80080/",
        "http://maps.example.org/",
        "https://maps.example.org:8008/",
        "maps.example.org:8008",
        "http://[maps.example.org:8008/",
        "http://evil.example/#@maps.example.org:8008",
    ],
)
def test_only_the_very_origin_is_its_server(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HEREABOUTS_TOKEN", TOKEN)
    monkeypatch.setenv("HEREABOUTS_SERVER", "http://maps.example.org:8008")
    assert token_for(url) is None
    assert token_for("http://user@MAPS.example.org:8008/sparql?query=x") == TOKEN
    monkeypatch.delenv("HEREABOUTS_SERVER")
    assert token_for("http://maps.example.org:8008/") is None


def test_a_file_has_tokens_of_several_servers(tmp_path, monkeypatch):
    file = tmp_path / "tokens"
    file.write_text("# ours\nhttp://a.example TOKEN-A\nhttps://b.example:8443/map TOKEN-B\n")
    monkeypatch.setenv("HEREABOUTS_TOKEN_FILE", str(file))
    monkeypatch.delenv("HEREABOUTS_SERVER", raising=False)
    assert token_for("http://a.example:80/x") == "TOKEN-A"
    assert token_for("https://b.example:8443/") == "TOKEN-B"
    assert token_for("https://a.example/") is None
    file.write_text("TOKEN-A\n")
    with pytest.raises(RemoteError, match="line 1: needs ADDRESS TOKEN"):
        token_for("http://a.example/")
