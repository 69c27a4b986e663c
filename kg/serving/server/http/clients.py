"""Clients of a server: who asks, what each has seen, and its share of threads and memory.

A client is the holder of a token, or else an address (for IPv6 its /64 network, which may belong to
one host). A client reads its own writes, and never an older state than before. Changes of others
arrive with the next snapshot.
"""

from __future__ import annotations

import ipaddress
from collections import Counter, OrderedDict
from collections.abc import Callable
from typing import Final, TypeVar

from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers

from kg.model.platforms import trim_heap
from kg.serving.server.http.problems import Problem
from kg.serving.server.http.settings import Limits, Settings
from kg.serving.workers.admission import FairQueue

T = TypeVar("T")
MAX_CLIENTS: Final = 4096  # remembered at once; one that is forgotten counts as new
THREADS: Final = 2  # that read at once; they share the interpreter's lock with the event loop
WRITERS: Final = 4  # writes at once: they are validated beside each other
WAITING: Final = 32  # requests of one client
SMALL: Final = 64 << 10  # [bytes] of a body that does not count; connections limit their number


def client_of(settings: Settings, headers: Headers, address: str) -> str:
    """The client of a request: the holder of its token, else its address."""
    authorization = headers.get("authorization")
    if authorization is not None:
        name = settings.tokens.find(authorization) or settings.read_tokens.find(authorization)
        if name is not None:
            return f"token {name}"
    return client_of_address(address)


def client_of_address(address: str) -> str:
    """The client at an address."""
    try:
        parsed = ipaddress.ip_address(address)
    except ValueError:
        return address
    if isinstance(parsed, ipaddress.IPv6Address) and parsed.ipv4_mapped is None:
        return str(ipaddress.ip_network((parsed, 64), strict=False))
    return address


class Sessions:
    """The last transaction that each client has seen or made; used on one event loop."""

    def __init__(self) -> None:
        self._last: OrderedDict[str, int] = OrderedDict()

    def saw(self, client: str, sequence: int) -> None:
        """Record that a client has seen, or made, a transaction."""
        self._last[client] = max(sequence, self._last.pop(client, 0))
        if len(self._last) > MAX_CLIENTS:
            self._last.popitem(last=False)

    def at_least(self, client: str) -> int:
        """The transaction that the client's next answer must not be older than."""
        return self._last.get(client, 0)


class ReadingThreads:
    """Threads for requests that read in the server's own process; clients take turns.

    The last free one is for a client without a running request.
    """

    def __init__(self, threads: int = THREADS) -> None:
        self._queue = FairQueue(threads, WAITING)

    async def run(self, client: str, act: Callable[[], T]) -> T:
        """The result of `act`; raises PoolBusyError if too many requests of this client wait."""
        async with self._queue.turn_async(client):
            return await run_in_threadpool(act)


class Upload:
    """Memory of the body of one request, within the limits of its client and of all.

    A body counts from its first byte until its request is answered. `held` [bytes] by client is
    that of all requests; used on one event loop.
    """

    def __init__(self, limits: Limits, held: Counter[str], client: str) -> None:
        self._limits, self._all, self._client = limits, held, client
        self._held = 0  # [bytes]

    def hold(self, size: int) -> None:
        """Hold so many bytes; raises Problem 503 if there is no room for more."""
        limits, held = self._limits, self._all
        more = (size if size > SMALL else 0) - self._held
        if more > 0 and (
            held[self._client] + more > limits.client_bodies or held.total() + more > limits.bodies
        ):
            raise Problem(
                503,
                f"bodies that wait for their answers may have {limits.client_bodies} bytes for "
                f"one client, {limits.bodies} for all; send one at a time",
                {"Retry-After": "1", "Connection": "close"},
            )
        held[self._client] += more
        self._held += more

    def release(self) -> None:
        """Hold nothing any more."""
        if not self._held:
            return
        self.hold(0)
        if not self._all[self._client]:
            del self._all[self._client]
        if not self._all:
            trim_heap()  # the C library keeps freed pages otherwise
