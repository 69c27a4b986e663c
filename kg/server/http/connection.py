"""HTTP connections that do not wait for ever: for the rest of a request, or for a slow reader.

uvicorn gives a client all the time it likes to finish a request's head and to read an answer, and
takes any number of clients; a few hundred would hold every connection there is. Up to `most` are
served, half as many more get 503 (`kg.server.http.middleware`), and the rest is hung
up
on.
"""

from __future__ import annotations

import asyncio
import socket
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

IDLE_SECONDS = 10.0


class PatientConnection(H11Protocol):
    """Closes where a head stays incomplete, or a reader takes nothing, for `idle_seconds`."""

    idle_seconds = IDLE_SECONDS
    most = 512

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        # so that whoever answers can end it, also while a write is stuck
        self.app_state = {**self.app_state, "connection": self}
        self._head_timer: asyncio.TimerHandle | None = None
        self._reader_timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """A client connected: its first request's head is due."""
        super().connection_made(transport)
        # asyncio overlooks sockets made without naming the protocol; an answer goes out in two
        # pieces, and the second would wait 40 ms for the client's delayed acknowledgement
        accepted = transport.get_extra_info("socket")
        accepted.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if len(self.connections) > self.most + self.most // 2:
            transport.abort()
            return
        self._head_timer = self.loop.call_later(self.idle_seconds, self._head_is_late)

    def connection_lost(self, exc: Exception | None) -> None:
        """The client left."""
        for timer in (self._head_timer, self._reader_timer):
            if timer is not None:
                timer.cancel()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Bytes of a request: the first of a head start its clock, its end stops it."""
        super().data_received(data)
        waiting = self.conn.their_state is h11.IDLE
        if not waiting and self._head_timer is not None:
            self._head_timer.cancel()
            self._head_timer = None
        elif waiting and self._head_timer is None:
            self._head_timer = self.loop.call_later(self.idle_seconds, self._head_is_late)

    def pause_writing(self) -> None:
        """The reader does not keep up: watch whether it reads at all."""
        super().pause_writing()
        self._watch_reader()

    def resume_writing(self) -> None:
        """The reader has caught up."""
        if self._reader_timer is not None:
            self._reader_timer.cancel()
            self._reader_timer = None
        super().resume_writing()

    @property
    def crowded(self) -> bool:
        """Whether there are more clients than are served."""
        return len(self.connections) > self.most

    def abort(self) -> None:
        """End the connection now, whatever is still to be sent."""
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
