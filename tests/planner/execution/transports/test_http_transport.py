"""A robot behind an address: a real server on loopback, and ones that are hostile."""

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

import pytest

from kg.model.errors import RobotError
from kg.serving.opening import in_memory_map
from planner.execution.options import SearchOptions
from planner.execution.protocol import Hello, StopCommand
from planner.execution.search_loop import search
from planner.execution.transports.http_transport import HttpRobot
from tests.planner.point_robot import PointRobot
from tests.planner.robots import APPLE, ring


class _Served(BaseHTTPRequestHandler):
    """A point robot over HTTP; every other answer to GET is lost and must be asked for again."""

    robot: PointRobot
    said: list[dict[str, Any]]
    asked: list[str]
    loses = False

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"]))
        command = json.loads(body)
        self.asked.append(command["type"])
        self.said.extend(self.robot.handle(command))
        self.answer(b"")

    def do_GET(self) -> None:
        after = int(parse_qs(urlsplit(self.path).query)["after"][0])
        self.asked.append("GET")
        if self.loses and self.asked.count("GET") % 2:
            self.close_connection = True
            return
        whole = {"next": len(self.said), "messages": self.said[after:]}
        self.answer(json.dumps(whole).encode())

    def answer(self, body: bytes, status: int = 200) -> None:
        self.send_response(status)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *arguments: object) -> None:
        pass


@contextmanager
def _serving(handler: type[BaseHTTPRequestHandler]) -> Iterator[str]:
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    thread = threading.Thread(target=server.serve_forever, args=(0.01,))
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}"
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def _point(**settings: Any) -> type[_Served]:
    loses = settings.pop("loses", False)
    own = {"robot": PointRobot(settings), "said": [], "asked": [], "loses": loses}
    return type("Served", (_Served,), own)


@pytest.mark.parametrize("loses", [False, True])
def test_a_robot_behind_an_address_finds(loses: bool) -> None:
    served = _point(objects=[APPLE], loses=loses)
    with in_memory_map() as semantic_map, _serving(served) as url:
        ring(semantic_map)
        outcome = search(semantic_map, ["apple"], HttpRobot(url), SearchOptions(timeout=120.0))
    assert outcome.state == "found"
    assert served.asked[0] == "hello"
    assert "stop" in served.asked  # it is told to stand still at the end


def _answering(body: bytes, status: int = 200, **headers: str) -> type[BaseHTTPRequestHandler]:
    class Answer(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(status)
            for name, value in {"Content-Length": str(len(body)), **headers}.items():
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(body)

        def do_POST(self) -> None:
            self.rfile.read(int(self.headers["Content-Length"]))
            self.do_GET()

        def log_message(self, *arguments: object) -> None:
            pass

    return Answer


def _receive(robot: HttpRobot) -> None:
    for _ in range(100):
        robot.receive(0.0)


@pytest.mark.parametrize(
    ("body", "status", "headers", "said"),
    [
        (b"no such page", 404, {}, "status 404"),
        (b"", 302, {"Location": "http://127.0.0.1:1/messages"}, "status 302"),
        (b"hello", 200, {}, "messages in a row"),
        (b"[" * 50_000, 200, {}, "messages in a row"),
        (b'{"next": -1, "messages": []}', 200, {}, "messages in a row"),
        (b'{"next": 0, "messages": [1]}', 200, {}, "messages in a row"),
        (b" " * ((4 << 20) + 1), 200, {}, "more than 4194304 bytes"),
    ],
)
def test_hostile_answers_are_one_error(body, status, headers, said):
    hostile = _answering(body, status, **headers)
    with _serving(hostile) as url, pytest.raises(RobotError, match=said):
        _receive(HttpRobot(url))


def test_nobody_there_is_one_error_and_stopping_is_none() -> None:
    with _serving(_answering(b"")) as url:
        pass
    robot = HttpRobot(url)
    with pytest.raises(RobotError, match="does not answer"):
        robot.send(Hello())
    with pytest.raises(RobotError, match="does not answer"):
        robot.send(StopCommand())
    robot.close()


@pytest.mark.parametrize(
    "url", ["ftp://robot", "http://", "http://a:b@robot", "http://robot:99999"]
)
def test_what_is_no_address_is_refused(url: str) -> None:
    with pytest.raises(RobotError, match="no address of a robot"):
        HttpRobot(url)
