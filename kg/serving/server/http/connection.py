"""HTTP connections with plain limits: of an address, in all, of a head, of waiting for a client.

uvicorn accepts any number of connections, waits for their clients without a limit, and parses what
arrived at once. A reverse proxy does all of this better (docs/how-to/serve.md); these limits keep a
server without one alive. RFC 9110, section 15.6.4, is the status of what is refused.
"""

from __future__ import annotations

import asyncio
import socket
import struct
import sys
import time
from collections.abc import Iterable
from typing import Any, Final

import h11
from uvicorn.protocols.http.h11_impl import STATUS_PHRASES, H11Protocol

from kg.serving.server.http.clients import client_of_address
from kg.serving.server.http.settings import Settings

MAX_LINES: Final = 100  # of a request's head; h11 takes 2 ms for a thousand
#: [bytes] of a connection that are parsed before others have their turn. Chunks of one byte take a
#: thousand times as long as one chunk, so fewer bytes are taken where the last ones took too long.
AT_ONCE, FIRST, LEAST = 4 << 10, 512, 16
TURN: Final = 0.0002  # [s] that parsing may take at once
_FULL = b"too many connections; come back in a second\n"
_REFUSAL = (
    b"HTTP/1.1 503 Service Unavailable\r\nContent-Type: text/plain; charset=utf-8\r\n"
    b"Retry-After: 1\r\nConnection: close\r\nContent-Length: %d\r\n\r\n%s" % (len(_FULL), _FULL)
)


class ConnectionTable:
    """The open connections of one server, oldest first; used on its event loop.

    An address may have `client_connections`, a trusted proxy all of them.
    """

    def __init__(self, settings: Settings, most: int) -> None:
        self.limits, self._most = settings.limits, most
        self._proxies = frozenset(map(client_of_address, settings.trusted_proxies))
        self._all: dict[LimitedConnection, None] = {}

    def add(self, one: LimitedConnection) -> None:
        """Take in a new connection; close the oldest that waits, or else this one, for its room."""
        self._all[one] = None
        own = () if one.address in self._proxies else self.of(one.address)
        if len(own) > self.limits.client_connections:
            _first_waiting(own, one).refuse()
        if len(self._all) > self._most:
            _first_waiting(self._all, one).refuse()

    def remove(self, one: LimitedConnection) -> None:
        """Forget a connection."""
        self._all.pop(one, None)

    def of(self, address: str) -> list[LimitedConnection]:
        """The connections of an address."""
        return [one for one in self._all if one.address == address]


def _first_waiting(
    connections: Iterable[LimitedConnection], last: LimitedConnection
) -> LimitedConnection:
    return next((one for one in connections if not one.is_busy), last)


class LimitedConnection(H11Protocol, asyncio.BufferedProtocol):
    """Closes if a head stays incomplete, or the client reads nothing, for `idle_seconds`."""

    def __init__(self, table: ConnectionTable, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self.conn = _LimitedHead(h11.SERVER, table.limits.head)
        # lets an endpoint end the connection, even while a write is blocked
        self.app_state = {**self.app_state, "connection": self}
        self.address = ""
        self._table, self._limits = table, table.limits
        self._received, self._turn = memoryview(bytearray(AT_ONCE)), FIRST
        self._head_timer: asyncio.TimerHandle | None = None
        self._reader_timer: asyncio.TimerHandle | None = None

    @property
    def is_busy(self) -> bool:
        """Whether a request is being answered; else the client has to send one."""
        return self.cycle is not None and not self.cycle.response_complete

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Start the time limit for the first head, and make room."""
        super().connection_made(transport)
        self.address = client_of_address(self.client[0] if self.client else "")
        self._table.add(self)
        self._time_head()

    def connection_lost(self, exc: Exception | None) -> None:
        """Cancel the time limits of a lost connection."""
        for timer in (self._head_timer, self._reader_timer):
            if timer is not None:
                timer.cancel()
        self._table.remove(self)
        super().connection_lost(exc)

    def get_buffer(self, sizehint: int) -> memoryview:
        """The buffer into which asyncio receives, as long as can be parsed in one turn."""
        return self._received[: self._turn]

    def buffer_updated(self, nbytes: int) -> None:
        """Parse what was received."""
        begin = time.perf_counter()
        self.data_received(bytes(self._received[:nbytes]))
        late = time.perf_counter() - begin > TURN
        self._turn = max(LEAST, self._turn // 2) if late else min(AT_ONCE, self._turn * 2)
        self._time_head()

    def on_response_complete(self) -> None:
        """Continue with the next request; the rest of an unread body has to arrive in time."""
        super().on_response_complete()
        self._time_head()

    def send_400_response(self, msg: str) -> None:
        """Refuse what is not HTTP; after the begin of a response, hang up."""
        if self.conn.our_state not in (h11.IDLE, h11.SEND_RESPONSE):
            self.abort()
            return
        error = sys.exc_info()[1]
        hint = error.error_status_hint if isinstance(error, h11.RemoteProtocolError) else 400
        body = f"not a valid request: {str(error or msg)[:200]}\n".encode("ascii", "replace")
        headers = [
            ("Content-Type", "text/plain; charset=utf-8"),
            ("Content-Length", str(len(body))),
            ("Connection", "close"),
        ]
        head = h11.Response(status_code=hint, headers=headers, reason=STATUS_PHRASES[hint])
        for event in (head, h11.Data(data=body), h11.EndOfMessage()):
            self.transport.write(self.conn.send(event) or b"")
        self.transport.close()

    def pause_writing(self) -> None:
        """Start the time limit of a client that reads too slowly; drop what is too much."""
        super().pause_writing()
        self._time_reader()
        own = self._table.of(self.address)
        if sum(one.unread for one in own) > self._limits.client_unread:
            self._reset()

    def resume_writing(self) -> None:
        """Stop the time limit of the reading client."""
        if self._reader_timer is not None:
            self._reader_timer.cancel()
            self._reader_timer = None
        super().resume_writing()

    @property
    def unread(self) -> int:
        """Bytes of the response that wait for the client."""
        return self.transport.get_write_buffer_size()

    def refuse(self) -> None:
        """Close a connection that waits for its client's request, with 503."""
        self._table.remove(self)
        if self.unread:
            self.abort()
            return
        self.transport.write(_REFUSAL)
        self.transport.close()

    def abort(self) -> None:
        """Close the connection at once, without sending the rest."""
        self._table.remove(self)
        self.transport.abort()

    def _reset(self) -> None:
        """Close the connection, and free what the kernel still holds for the client."""
        accepted = self.transport.get_extra_info("socket")
        accepted.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self.abort()

    def _time_head(self) -> None:
        if self.is_busy and self._head_timer is not None:
            self._head_timer.cancel()
            self._head_timer = None
        elif not self.is_busy and self._head_timer is None:
            self._head_timer = self.loop.call_later(self._limits.idle_seconds, self.abort)

    def _time_reader(self) -> None:
        self._reader_timer = self.loop.call_later(
            self._limits.idle_seconds, self._reader_is_late, self.unread
        )

    def _reader_is_late(self, before: int) -> None:
        if self.unread >= before:
            self._reset()
        else:
            self._time_reader()


class _LimitedHead(h11.Connection):
    """Refuses heads that are long or have many lines before h11 parses them."""

    def __init__(self, role: type[h11.SERVER], max_head: int) -> None:
        super().__init__(role, max_head)
        self._max_head = max_head

    def next_event(self) -> Any:
        """The next event; raises RemoteProtocolError 431 for such a head."""
        if self.their_state is h11.IDLE:
            head, _, _ = self.trailing_data[0].partition(b"\r\n\r\n")
            if len(head) > self._max_head or head.count(b"\n") > MAX_LINES:
                raise h11.RemoteProtocolError(
                    f"a head may have {self._max_head} bytes and {MAX_LINES} headers",
                    error_status_hint=431,
                )
        return super().next_event()
