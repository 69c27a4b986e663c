"""HTTP connections with time limits, for the head of a request and for a client that does not read.

uvicorn has no such limits and accepts any number of clients, so that a few hundred slow clients
could occupy all connections. Up to `max_clients` clients are served, half as many more get 503
(`kg.serving.server.http.middleware`), and further connections are closed.
"""

from __future__ import annotations

import asyncio
import socket
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

IDLE_SECONDS = 10.0


class PatientConnection(H11Protocol):
    """Closes if a head stays incomplete, or the client reads nothing, for `idle_seconds`."""

    idle_seconds = IDLE_SECONDS
    max_clients = 512

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        # lets an endpoint end the connection, even while a write is blocked
        self.app_state = {**self.app_state, "connection": self}
        self._head_timer: asyncio.TimerHandle | None = None
        self._reader_timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Start the time limit for the first head of a new connection."""
        super().connection_made(transport)
        # asyncio does not set it on sockets that name no protocol; the second part of a response
        # would wait 40 ms for the client's delayed acknowledgement
        accepted = transport.get_extra_info("socket")
        accepted.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if len(self.connections) > self.max_clients + self.max_clients // 2:
            transport.abort()
            return
        self._head_timer = self.loop.call_later(self.idle_seconds, self._head_is_late)

    def connection_lost(self, exc: Exception | None) -> None:
        """Cancel the time limits of a lost connection."""
        for timer in (self._head_timer, self._reader_timer):
            if timer is not None:
                timer.cancel()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Receive bytes; the first of a head start its time limit, its end stops it."""
        super().data_received(data)
        waiting = self.conn.their_state is h11.IDLE
        if not waiting and self._head_timer is not None:
            self._head_timer.cancel()
            self._head_timer = None
        elif waiting and self._head_timer is None:
            self._head_timer = self.loop.call_later(self.idle_seconds, self._head_is_late)

    def pause_writing(self) -> None:
        """Start the time limit of a client that reads too slowly."""
        super().pause_writing()
        self._watch_reader()

    def resume_writing(self) -> None:
        """Stop the time limit of the reading client."""
        if self._reader_timer is not None:
            self._reader_timer.cancel()
            self._reader_timer = None
        super().resume_writing()

    @property
    def crowded(self) -> bool:
        """Whether there are more clients than `max_clients`."""
        return len(self.connections) > self.max_clients

    def abort(self) -> None:
        """Close the connection at once, without sending the rest."""
        if not self.transport.is_closing() or self.transport.get_write_buffer_size():
            self.transport.abort()

    def _head_is_late(self) -> None:
        self._head_timer = None
        if self.conn.their_state is h11.IDLE:
            self.abort()

    def _watch_reader(self) -> None:
        left = self.transport.get_write_buffer_size()
        self._reader_timer = self.loop.call_later(self.idle_seconds, self._reader_is_late, left)

    def _reader_is_late(self, before: int) -> None:
        if self.transport.get_write_buffer_size() >= before:
            self.abort()
        else:
            self._watch_reader()
