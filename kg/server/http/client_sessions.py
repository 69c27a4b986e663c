"""Sessions: which client a request is of, and how recent its answers must be.

A client is the holder of a token, else an address (of IPv6 its /64 network, which one host may have
all of). It reads its own writes, and never an older state than it has seen; what others wrote
comes to it with the next snapshot.
"""

from __future__ import annotations

import ipaddress
from collections import OrderedDict
from typing import Final

CLIENTS: Final = 4096  # remembered at once; who is forgotten sees snapshots like a new one


def client_of_address(address: str) -> str:
    """The client that requests from an address are of."""
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
        """Note that an answer showed a client the map as of a transaction, or its own write."""
        self._last[client] = max(sequence, self._last.pop(client, 0))
        if len(self._last) > CLIENTS:
            self._last.popitem(last=False)

    def at_least(self, client: str) -> int:
        """The transaction that the client's next answer must not be older than."""
        return self._last.get(client, 0)
