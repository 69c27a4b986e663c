"""Turns to read from connections: a limit of the time of the event loop that each client takes.

Bytes of a request can be expensive to parse: a body in chunks of one byte takes a second for each
600 kB. A client that takes more than its share of the time waits before more is read from it. A
usual request takes 0.2 ms of it, so that the share is enough for 250 requests a second.
"""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable
from typing import Final

from kg.serving.server.http.client_sessions import MAX_CLIENTS

SHARE: Final = 0.05  # of the event loop's time
BURST: Final = 0.05  # [s] of parsing beyond it


class TurnsToRead:
    """When the bytes of each client may be parsed again; used on one event loop."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._paid: OrderedDict[str, float] = OrderedDict()  # client -> [s] of the clock

    def spent(self, client: str, seconds: float) -> None:
        """Record the time that bytes of a client took."""
        paid = max(self._paid.pop(client, 0.0), self._clock())
        self._paid[client] = paid + seconds / SHARE
        if len(self._paid) > MAX_CLIENTS:
            self._paid.popitem(last=False)

    def wait(self, client: str) -> float:
        """Seconds until more bytes of the client may be parsed; 0 for now."""
        return max(0.0, self._paid.get(client, 0.0) - self._clock() - BURST / SHARE)
