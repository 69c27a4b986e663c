"""HTTP transport: commands are posted to the robot's address, messages are polled."""

from __future__ import annotations

import contextlib
import http.client
import json
import time
from collections import deque
from typing import Any, Final
from urllib.parse import urlsplit

from kg.model.errors import RobotError
from planner.execution.protocol import Command, Message, StopCommand, encoded
from planner.execution.robot import MessageQueue

ANSWER_WITHIN: Final = 10.0  # [s] for an answer, beyond the wait that a request asks for
MAX_ANSWER: Final = 4 << 20  # [bytes]
_POLL: Final = 5.0  # [s] longest poll for a message
_TRIES: Final = 3
_PAUSE: Final = 0.2  # [s] before an answer without messages is polled again


class HttpRobot:
    """``POST URL/command`` with a command; ``GET URL/messages?after=N&wait=S`` for its messages.

    The answer to the second is ``{"next": M, "messages": [...]}``: all messages from number N on,
    and M for the next request. A lost answer is requested again. Redirects are errors, and proxies
    are not used. Raises RobotError for a malformed address.
    """

    def __init__(self, url: str) -> None:
        parts = urlsplit(url)
        try:
            port = parts.port
        except ValueError as error:
            raise RobotError(f"{url} is no address of a robot: {error}") from error
        if parts.scheme not in ("http", "https") or not parts.hostname or parts.username:
            raise RobotError(f"{url} is no address of a robot; http://HOST:PORT/PATH would be")
        self.name = f"the robot at {parts.hostname}:{port or ''}".rstrip(":")
        self._kind = (
            http.client.HTTPSConnection if parts.scheme == "https" else http.client.HTTPConnection
        )
        self._host, self._port = parts.hostname, port
        self._path = parts.path.rstrip("/")
        self._next = 0
        self._waiting: deque[Message] = deque()
        self._inbox = MessageQueue(self.name)

    def send(self, command: Command) -> None:
        """Post the command; raises RobotError where the robot does not accept it."""
        self._ask("POST", "/command", json.dumps(encoded(command)).encode(), ANSWER_WITHIN)

    def receive(self, seconds: float) -> Message | None:
        """The next message; None where the robot had none within `seconds`."""
        deadline = time.monotonic() + seconds
        while not self._waiting:
            wait = min(_POLL, max(0.0, deadline - time.monotonic()))
            before = time.monotonic()
            self._poll(wait)
            if self._waiting:
                break
            left = deadline - time.monotonic()
            if left <= 0:
                return None
            if time.monotonic() - before < min(_PAUSE, wait):  # a robot that answers at once
                time.sleep(min(_PAUSE, left))
        return self._waiting.popleft()

    def close(self) -> None:
        """Send a stop command."""
        with contextlib.suppress(RobotError):
            self.send(StopCommand())

    def _poll(self, wait: float) -> None:
        target = f"/messages?after={self._next}&wait={wait:.2f}"
        body = self._ask("GET", target, None, wait + ANSWER_WITHIN, tries=_TRIES)
        try:
            answer = json.loads(body)
        except (ValueError, RecursionError):
            self._waiting.append(self._inbox.malformed("not JSON"))
            return
        fields: dict[str, Any] = answer if isinstance(answer, dict) else {}
        messages: Any = fields.get("messages")
        number: Any = fields.get("next")
        is_number = isinstance(number, int) and not isinstance(number, bool)
        if not is_number or number < self._next or not isinstance(messages, list):
            malformed = self._inbox.malformed('needs {"next": NUMBER, "messages": [...]}')
            self._waiting.append(malformed)
            return
        self._next = number
        for value in messages:
            if (message := self._inbox.take(value)) is not None:
                self._waiting.append(message)

    def _ask(
        self, method: str, target: str, body: bytes | None, within: float, tries: int = 1
    ) -> bytes:
        for attempt in range(tries):
            try:
                return self._request(method, target, body, within)
            except (OSError, http.client.HTTPException) as error:
                if attempt == tries - 1:
                    received = str(error) or type(error).__name__
                    raise RobotError(f"{self.name} does not answer: {received}") from error
                time.sleep(_PAUSE)
        raise AssertionError("the last attempt returns or raises")

    def _request(self, method: str, target: str, body: bytes | None, within: float) -> bytes:
        connection = self._kind(self._host, self._port, timeout=within)
        try:
            headers = {"Content-Type": "application/json"} if body is not None else {}
            connection.request(method, self._path + target, body, headers)
            response = connection.getresponse()
            answer = _whole(response, time.monotonic() + within)
        finally:
            connection.close()
        if not 200 <= response.status < 300:
            raise RobotError(f"{self.name} refuses {method} {target}: status {response.status}")
        if len(answer) > MAX_ANSWER:
            raise RobotError(f"{self.name} answers with more than {MAX_ANSWER} bytes")
        return answer


def _whole(response: http.client.HTTPResponse, deadline: float) -> bytes:
    """The body, up to a chunk beyond MAX_ANSWER; raises TimeoutError at the deadline."""
    body = bytearray()
    while len(body) <= MAX_ANSWER and (piece := response.read1(1 << 16)):
        body += piece
        if time.monotonic() > deadline:
            raise TimeoutError("its answer took too long")
    return bytes(body)
