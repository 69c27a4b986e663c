"""Lifecycle of a server: its socket, its thread and its shutdown."""

from __future__ import annotations

import math
import socket
import threading
from collections.abc import Callable
from functools import partial
from types import FrameType
from typing import Any, Self, cast

import uvicorn
from starlette.types import ASGIApp

from kg.model.errors import ServerError
from kg.model.platforms import open_files
from kg.serving.server.http.connection import ConnectionTable, LimitedConnection
from kg.serving.server.http.settings import Settings

START_WITHIN = 60.0  # [s]
END_WITHIN = 3  # [s] to complete responses when the server stops
ACCEPTED_AT_ONCE = 8  # connections, before those that exist have their turn
QUEUE = 4096  # connections that wait to be accepted


class ServerLifecycle:
    """Listens from its construction; `run` blocks, a context manager serves from a thread.

    A subclass passes its application to `_answer_with` and releases its resources in `_close`. The
    constructor raises ServerError if it cannot listen at the address.
    """

    def __init__(self, settings: Settings | None = None) -> None:
        self.settings = settings or Settings()
        self._socket = listen(self.settings.host, self.settings.port)
        self._address: tuple[str, int] = self._socket.getsockname()[:2]
        self._thread: threading.Thread | None = None

    def _answer_with(self, app: ASGIApp, end_streams: Callable[[], None]) -> None:
        self._server = _Uvicorn(_config(app, self.settings), end_streams)

    @property
    def url(self) -> str:
        """Address of the server, with a slash at the end."""
        host, port = self._address
        return f"http://{f'[{host}]' if ':' in host else host}:{port}/"

    def run(self, on_signal: Callable[[], None] = lambda: None) -> None:
        """Serve until interrupted, or until `stop` is called from another thread.

        `on_signal` is called when a signal that ends the server arrives.
        """
        self._server.on_signal = on_signal
        try:
            self._server.run(sockets=[self._socket])
        finally:
            self._close()

    def stop(self) -> None:
        """Stop the server, and wait for its thread."""
        self._server.should_exit = True
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        self._close()

    def _close(self) -> None:
        self._socket.close()

    def __enter__(self) -> Self:
        self._thread = threading.Thread(target=self.run, name="hereabouts-server", daemon=True)
        self._thread.start()
        if not self._server.ready.wait(START_WITHIN):
            raise ServerError(f"the server at {self.url} did not start in {START_WITHIN:g} s")
        return self

    def __exit__(self, *exception: object) -> None:
        self.stop()


class _Uvicorn(uvicorn.Server):
    """uvicorn that signals its start, and ends event streams before its shutdown."""

    def __init__(self, config: uvicorn.Config, end_streams: Callable[[], None]) -> None:
        super().__init__(config)
        self.ready = threading.Event()
        self.on_signal: Callable[[], None] = lambda: None
        self._end_streams = end_streams

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        self.on_signal()
        super().handle_exit(sig, frame)

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        for listening in sockets or ():
            listening.listen(QUEUE)  # uvicorn has set it to `ACCEPTED_AT_ONCE`
        self.ready.set()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._end_streams()
        await super().shutdown(sockets)


def _config(app: ASGIApp, settings: Settings) -> uvicorn.Config:
    table = ConnectionTable(settings, min(settings.limits.connections, open_files() // 2))
    return uvicorn.Config(
        app,
        http=cast(Any, partial(LimitedConnection, table)),
        ws="none",
        loop="asyncio",
        lifespan="on",
        log_config=None,
        log_level="error",
        access_log=False,
        server_header=False,
        proxy_headers=False,
        h11_max_incomplete_event_size=settings.limits.head,
        timeout_keep_alive=math.ceil(settings.limits.idle_seconds),
        backlog=ACCEPTED_AT_ONCE,
        timeout_graceful_shutdown=END_WITHIN,
    )


class _Listener(socket.socket):
    """A listening socket that passes over clients that hung up before they were accepted."""

    def __init__(self, plain: socket.socket) -> None:
        # names the protocol, so that asyncio sends the second part of a response without the 40 ms
        # of a delayed acknowledgement (TCP_NODELAY)
        kind = plain.family, socket.SOCK_STREAM, socket.IPPROTO_TCP
        super().__init__(*kind, fileno=plain.detach())

    def accept(self) -> tuple[socket.socket, Any]:
        """The next connection; raises BlockingIOError where none waits."""
        while True:
            connection, address = super().accept()
            try:
                connection.getpeername()
            except OSError:
                connection.close()
            else:
                return connection, address


def listen(host: str, port: int) -> socket.socket:
    """Socket that listens at an address; raises ServerError where it cannot."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        plain = socket.create_server((host, port), family=family, backlog=QUEUE)
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise ServerError(
            f"cannot listen at {host}, port {port}: {reason}; try another port (0 takes a free one)"
        ) from error
    return _Listener(plain)
