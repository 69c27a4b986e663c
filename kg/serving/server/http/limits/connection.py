"""HTTP connections with limits of time, number and memory; the greediest client loses.

uvicorn accepts any number of clients and waits for them without a limit, so that a few hundred slow
clients could occupy all connections. Here a client has to send and to read in time. If there are
more than `max_connections`, one of the client with the most is closed: of those that were inactive
longest, the first that waits for its client, else the first.
"""

from __future__ import annotations

import asyncio
import re
import socket
import struct
import sys
import time
from collections.abc import Callable
from itertools import islice
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import STATUS_PHRASES, H11Protocol

from kg.serving.server.http.client_sessions import client_of_address
from kg.serving.server.http.limits.shares import Shares, greediest
from kg.serving.server.http.limits.turns_to_read import TurnsToRead

IDLE_SECONDS = 10.0
AT_ONCE = 16 << 10  # [bytes] that are parsed before others have their turn
MAX_CANDIDATES = 32  # connections of a client that are compared before one is closed
MAX_HEADERS = 200  # lines of a request's head; h11 takes 2 ms for a thousand
_TOKEN = re.compile(rb"\nauthorization:[ \t]*([^\r\n]+)\r?\n", re.IGNORECASE)
_FULL = b"the server is full, and you have most of its connections; come back in a second\n"
_REFUSAL = (
    b"HTTP/1.1 503 Service Unavailable\r\nContent-Type: text/plain; charset=utf-8\r\n"
    b"Retry-After: 1\r\nConnection: close\r\nContent-Length: %d\r\n\r\n%s" % (len(_FULL), _FULL)
)


class PatientConnection(H11Protocol):
    """Closes if a head stays incomplete, or the client reads nothing, for `idle_seconds`."""

    idle_seconds = IDLE_SECONDS
    max_connections = 512
    max_unread = 256 << 20  # [bytes] of answers that wait for their clients
    turns = TurnsToRead()
    shares: Shares[PatientConnection] = Shares()
    holder: Callable[[str | None], str | None] = staticmethod(lambda authorization: None)

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self.conn = _LimitedHead(h11.SERVER, self.config.h11_max_incomplete_event_size or 1 << 16)
        # lets an endpoint end the connection, even while a write is blocked
        self.app_state = {**self.app_state, "connection": self}
        self._client_name = ""
        self._request_timer: asyncio.TimerHandle | None = None
        self._reader_timer: asyncio.TimerHandle | None = None
        self._received = bytearray()  # and not parsed yet
        self._turn: asyncio.TimerHandle | None = None  # when more of it is parsed

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Start the time limit for the first head; make room if there are too many."""
        super().connection_made(transport)
        # asyncio does not set it on sockets that name no protocol; the second part of a response
        # would wait 40 ms for the client's delayed acknowledgement
        accepted = transport.get_extra_info("socket")
        accepted.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._client_name = client_of_address(self.client[0] if self.client else "")
        self.shares.renew(self)
        self._request_timer = self.loop.call_later(self.idle_seconds, self._request_is_late)
        if len(self.connections) > self.max_connections:
            crowd = tuple(islice(self.shares.of_most(), MAX_CANDIDATES))
            next((one for one in crowd if one._awaits_client), crowd[0]).refuse()

    @property
    def client_name(self) -> str:
        """Client by its address; from the first request on by its token if it has one."""
        return self._client_name

    @client_name.setter
    def client_name(self, name: str) -> None:
        if name != self._client_name:
            self.shares.remove(self)
            self._client_name = name
            self._renew()

    def connection_lost(self, exc: Exception | None) -> None:
        """Cancel the time limits of a lost connection."""
        for timer in (self._request_timer, self._reader_timer, self._turn):
            if timer is not None:
                timer.cancel()
        self.shares.remove(self)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Receive bytes, to be parsed in the client's turn."""
        self._received += data
        if self._turn is None:
            self._parse()

    def _parse(self) -> None:
        self._turn = None
        if self.transport.is_closing():
            return
        if self.cycle is None and (name := self.holder(self._token())):
            self.client_name = name  # has turns of its own
        wait = self.turns.wait(self.client_name)
        if not wait and not self._is_busy:
            begun = time.thread_time()
            super().data_received(self._next_part())
            self.turns.spent(self.client_name, time.thread_time() - begun)
            self._time_request()
        if self._received and not self.transport.is_closing():
            self.transport.pause_reading()
            if not self._is_busy:
                self._turn = self.loop.call_later(wait, self._parse)
        elif not self.flow.read_paused:
            self.transport.resume_reading()

    def _next_part(self) -> bytes:
        """A head alone, since others may follow, or some bytes."""
        end = self._received.find(b"\r\n\r\n", 0, AT_ONCE) if self._awaits_head else -1
        size = AT_ONCE if end < 0 else end + 4
        part = bytes(self._received[:size])
        del self._received[:size]
        return part

    def on_response_complete(self) -> None:
        """Continue with the next request; the rest of an unread body has to arrive in time."""
        self._renew()
        super().on_response_complete()
        if not self._awaits_head:
            self._time_request()
        if self._received and self._turn is None:
            self._turn = self.loop.call_later(0, self._parse)

    def _token(self) -> str | None:
        """The Authorization of the first head that arrived."""
        found = _TOKEN.search(self._received, 0, AT_ONCE)
        return None if found is None else found[1].decode("latin-1").strip()

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
        """Start the time limit of a client that reads too slowly; drop the largest backlogs."""
        super().pause_writing()
        self._watch_reader()
        while sum(one.unread for one in _patient(self.connections)) > self.max_unread:
            backlogs = greediest(_patient(self.connections), lambda one: one.unread)
            max(backlogs, key=lambda one: one.unread)._reset()

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

    def abort(self) -> None:
        """Close the connection at once, without sending the rest."""
        self._leave()
        if not self.transport.is_closing() or self.unread:
            self.transport.abort()

    def _reset(self) -> None:
        """Close the connection, and free what the kernel still holds for the client."""
        accepted = self.transport.get_extra_info("socket")
        accepted.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self.abort()

    def _renew(self) -> None:
        if self in self.connections:
            self.shares.renew(self)

    def _leave(self) -> None:
        self.connections.discard(self)
        self.shares.remove(self)

    def refuse(self) -> None:
        """Close the connection, with 503 for a request that was not received completely."""
        answered = self._answering and (
            self.cycle.response_started or self.conn.their_state is not h11.SEND_BODY
        )
        if answered or self.unread:
            self.abort()
            return
        self._leave()
        self.transport.write(_REFUSAL)
        self.transport.close()

    @property
    def _answering(self) -> bool:
        return self.cycle is not None and not self.cycle.response_complete

    @property
    def _is_busy(self) -> bool:
        """Whether a complete request is being answered, after which the next one is parsed."""
        return self._answering and self.conn.their_state is h11.DONE

    @property
    def _awaits_head(self) -> bool:
        return self.conn.their_state is h11.IDLE

    @property
    def _awaits_client(self) -> bool:
        """Whether the client has to send, or to read, before anything happens."""
        sending = not self._answering or self.conn.their_state is h11.SEND_BODY
        return sending or self.flow.write_paused

    @property
    def _awaits_request(self) -> bool:
        """Whether no endpoint waits for what the client has to send: a head, or an unread body."""
        unread_body = self.conn.our_state is h11.DONE and self.conn.their_state is h11.SEND_BODY
        return self._awaits_head or unread_body

    def _time_request(self) -> None:
        if not self._awaits_request:
            if self._request_timer is not None:
                self._renew()
                self._request_timer.cancel()
                self._request_timer = None
        elif self._request_timer is None:
            self._request_timer = self.loop.call_later(self.idle_seconds, self._request_is_late)

    def _request_is_late(self) -> None:
        self._request_timer = None
        if self._awaits_request:
            self.abort()

    def _watch_reader(self) -> None:
        self._reader_timer = self.loop.call_later(
            self.idle_seconds, self._reader_is_late, self.unread
        )

    def _reader_is_late(self, before: int) -> None:
        if self.unread >= before:
            self._reset()
        else:
            self._watch_reader()


class _LimitedHead(h11.Connection):
    """Refuses heads that are long or have many lines before h11 parses them."""

    def __init__(self, role: type[h11.SERVER], max_head: int) -> None:
        super().__init__(role, max_head)
        self._max_head = max_head

    def next_event(self) -> Any:
        """The next event; raises RemoteProtocolError 431 for such a head."""
        if self.their_state is h11.IDLE:
            head, _, _ = self.trailing_data[0].partition(b"\r\n\r\n")
            if len(head) > self._max_head or head.count(b"\n") > MAX_HEADERS:
                raise h11.RemoteProtocolError(
                    f"a head may have {self._max_head} bytes and {MAX_HEADERS} headers",
                    error_status_hint=431,
                )
        return super().next_event()


def _patient(connections: set[Any]) -> tuple[PatientConnection, ...]:
    return tuple(connections)
