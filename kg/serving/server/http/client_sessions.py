"""Sessions: the client of a request, and how recent its answers must be.

A client is the holder of a token, or else an address (for IPv6 its /64 network, which may belong to
one host). A client reads its own writes, and never an older state than before. Changes of others
arrive with the next snapshot.
"""

from __future__ import annotations

import ipaddress
from collections import OrderedDict
from typing import Final

from starlette.requests import Request

from kg.serving.workers.request import Asker

MAX_CLIENTS: Final = 4096  # remembered at once; one that is forgotten counts as new


def client_of_address(address: str) -> str:
    """The client at an address."""
    try:
        parsed = ipaddress.ip_address(address)
    except ValueError:
        return address
    if isinstance(parsed, ipaddress.IPv6Address) and parsed.ipv4_mapped is None:
        return str(ipaddress.ip_network((parsed, 64), strict=False))
    return address


def asker_of(request: Request) -> Asker:
    """The client in whose share of the workers the queries of a request run."""
    return Asker(request.state.client)


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
