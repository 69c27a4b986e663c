"""The transactions of a running `hereabouts serve` as they happen: its `/changes`, as heard afar.

Each is told once, in order, without a gap: where the connection breaks, or the server is started
anew, it is taken up again behind the last one.
"""

from __future__ import annotations

import base64
import contextlib
import http.client
import json
import socket
import threading
from collections.abc import Iterator
from typing import Final
from urllib.parse import unquote, urlsplit

from kg.commits import ChangeSet
from kg.endpoint import without_secrets
from kg.errors import HistoryError, RemoteError
from kg.wire import change_of, understood

SILENCE: Final = 60.0  # [s] without so much as a heartbeat after which a connection is given up
PAUSES: Final = (0.1, 0.5, 2.0, 5.0)  # [s] before the 1st, 2nd, ... try after one that failed

_BUSY: Final = (429, 502, 503, 504)
_BROKEN: Final = (OSError, http.client.HTTPException, EOFError)


class Follower:
    """Iterates over the change sets numbered above `since`, waiting for those to come.

    It ends when `close` is called, from any thread. Raises HistoryError where the server does not
    keep what is to come next, RemoteError where none that tells changes answers.
    """

    def __init__(self, root: str, since: int) -> None:
        self._root, self.since = root.rstrip("/"), since
        self._over = threading.Event()
        self._guard = threading.Lock()
        self._socket: socket.socket | None = None

    def __iter__(self) -> Iterator[ChangeSet]:
        failed = 0
        while not self._over.is_set():
            try:
                for change in self._connected():
                    failed, self.since = 0, change.sequence
                    yield change
                    if self._over.is_set():
                        return
            except _BROKEN:
                pass
            self._over.wait(PAUSES[min(failed, len(PAUSES) - 1)])
            failed += 1

    def close(self) -> None:
        """End it: nothing more is told."""
        self._over.set()
        with self._guard:
            if self._socket is not None:
                with contextlib.suppress(OSError):
                    self._socket.shutdown(socket.SHUT_RDWR)  # wakes up who reads

    def _connected(self) -> Iterator[ChangeSet]:
        """The changes that one connection brings."""
        parts = urlsplit(self._root)
        kind: type[http.client.HTTPConnection] = http.client.HTTPConnection
        if parts.scheme == "https":
            kind = http.client.HTTPSConnection
        with contextlib.closing(kind(parts.hostname or "", parts.port, timeout=SILENCE)) as link:
            link.connect()
            with self._guard:
                self._socket = link.sock
            try:
                path = f"{parts.path}/changes?since={self.since}"
                link.request("GET", path, headers=self._headers())
                with contextlib.closing(link.getresponse()) as reply:
                    self._refuse(reply)
                    if not self._over.is_set():  # or nobody is there to wake it up
                        where = without_secrets(self._root)
                        for data in _data(reply):
                            yield understood(where, _change, data)
            finally:
                with self._guard:
                    self._socket = None

    def _headers(self) -> dict[str, str]:
        parts, told = urlsplit(self._root), {"Accept": "text/event-stream"}
        if parts.username is not None:
            name = f"{unquote(parts.username)}:{unquote(parts.password or '')}"
            told["Authorization"] = f"Basic {base64.b64encode(name.encode()).decode()}"
        return told

    def _refuse(self, reply: http.client.HTTPResponse) -> None:
        if reply.status == 200:
            return
        said = " ".join(reply.read(2000).decode("utf-8", "replace").split())
        if reply.status in _BUSY:
            raise EOFError(said)
        if reply.status == 410:
            raise HistoryError(said)
        raise RemoteError(
            f"{without_secrets(self._root)} tells no changes ({reply.status}): {said}"
        )


def _change(data: str) -> ChangeSet:
    return change_of(json.loads(data))


def _data(reply: http.client.HTTPResponse) -> Iterator[str]:
    """The data of each server-sent event."""
    data: list[str] = []
    while line := reply.readline():
        text = line.decode("utf-8", "replace").rstrip("\r\n")
        name, _, value = text.partition(":")
        if name == "data":
            data.append(value.removeprefix(" "))
        elif not text and data:
            yield "\n".join(data)
            data = []
