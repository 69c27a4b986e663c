"""Change stream: the transactions of a running `hereabouts serve`, as server-sent events.

Each transaction is delivered once, in order, without a gap. After a broken connection or a restart
of the server the stream continues after the last one.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from typing import Final

import requests
from urllib3.exceptions import HTTPError

from kg.model.errors import HistoryError, RemoteError
from kg.model.transactions import ChangeSet
from kg.serving.client.record_codec import change_from_json, decoded_reply
from kg.store.http_session import HttpSession
from kg.store.sparql_client import without_secrets

SILENCE: Final = 60.0  # [s] without event or heartbeat until a connection is closed
PAUSES: Final = (0.1, 0.5, 2.0, 5.0)  # [s] before the 1st, 2nd, ... attempt after a failed one

_BUSY: Final = (429, 502, 503, 504)
_BROKEN: Final = (OSError, HTTPError, EOFError)
_CHUNK: Final = 1 << 16


class ChangeStream:
    """Iterates over the change sets numbered above `since`, and waits for later ones.

    `close`, from any thread, ends the iteration. Raises HistoryError if the server does not keep
    the next change set any more, RemoteError if it refuses the stream.
    """

    def __init__(self, root: str, since: int) -> None:
        self._root, self.since = root.rstrip("/"), since
        self._over = threading.Event()
        self._http = HttpSession(root)

    def __iter__(self) -> Iterator[ChangeSet]:
        failed = 0
        try:
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
        finally:
            self._http.close()

    def close(self) -> None:
        """End the iteration."""
        self._over.set()
        self._http.interrupt()
        self._http.close()

    def _connected(self) -> Iterator[ChangeSet]:
        """The change sets of one connection."""
        with self._http.send(
            "GET",
            f"{self._root}/changes",
            headers={"Accept": "text/event-stream", "Accept-Encoding": "identity"},
            seconds=SILENCE,
            safe=True,
            params={"since": str(self.since)},
            stream=True,
        ) as reply:
            self._check_status(reply)
            where = without_secrets(self._root)
            for data in _data(reply):
                yield decoded_reply(where, lambda data: change_from_json(json.loads(data)), data)

    def _check_status(self, reply: requests.Response) -> None:
        if reply.status_code == 200:
            return
        detail = " ".join(reply.raw.read(2000).decode("utf-8", "replace").split())
        if reply.status_code in _BUSY:
            raise EOFError(detail)
        if reply.status_code == 410:
            raise HistoryError(detail)
        where, status = without_secrets(self._root), reply.status_code
        raise RemoteError(f"{where} refused the change stream ({status}): {detail}")


def _data(reply: requests.Response) -> Iterator[str]:
    """The data of each server-sent event."""
    data: list[str] = []
    for line in _lines(reply):
        name, _, value = line.partition(":")
        if name == "data":
            data.append(value.removeprefix(" "))
        elif not line and data:
            yield "\n".join(data)
            data = []


def _lines(reply: requests.Response) -> Iterator[str]:
    """The lines of a reply, each as soon as it is complete."""
    rest = b""
    while part := reply.raw.read1(_CHUNK):
        *lines, rest = (rest + part).split(b"\n")
        for line in lines:
            yield line.decode("utf-8", "replace").rstrip("\r")
