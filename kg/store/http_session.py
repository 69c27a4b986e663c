"""HTTP session: pooled connections to one server, with its bearer token."""

from __future__ import annotations

import contextlib
import socket
import time
from collections.abc import Callable
from functools import partial
from http.cookiejar import DefaultCookiePolicy
from typing import Any, Final
from urllib.parse import urlsplit
from weakref import WeakSet

import requests
from requests.adapters import HTTPAdapter
from urllib3 import HTTPConnectionPool, HTTPSConnectionPool, PoolManager
from urllib3.connection import HTTPConnection, HTTPSConnection
from urllib3.exceptions import ProtocolError

from kg.store.credentials import authorization, bearer

CONNECT_WITHIN = 5.0  # [s]
#: [s] lifetime of an idle connection. Servers close idle connections after 5 s or more, and a
#: request on a closing connection is lost.
IDLE: Final = 2.0


class HttpSession:
    """HTTP client of the server at `address`; safe to use from several threads.

    Each request carries `token`, or the token in the environment for its URL if `token` is None.
    """

    def __init__(self, address: str, token: str | None = None) -> None:
        self._token = token
        self._adapter = _Adapter()
        self._session = requests.Session()
        # a proxy would resolve a local address to its own machine
        self._session.trust_env = not is_local(address)
        self._session.cookies.set_policy(DefaultCookiePolicy(allowed_domains=()))
        for scheme in ("http://", "https://"):
            self._session.mount(scheme, self._adapter)

    def send(
        self,
        method: str,
        url: str,
        *,
        headers: dict[str, str],
        seconds: float,
        safe: bool,
        **content: Any,
    ) -> requests.Response:
        """Send a request and wait up to `seconds` for each part of the reply.

        A `safe` request (RFC 9110, 9.2.1) is repeated if the server closes an idle connection
        instead of replying; an unsafe one is not. `content` has further arguments of
        `requests.Session.request`. Raises requests.RequestException.
        """
        own = bearer(self._token) if self._token else authorization(url)
        send = partial(
            self._session.request,
            method,
            url,
            headers=headers | own,
            timeout=(min(CONNECT_WITHIN, seconds), seconds),
            **content,
        )
        try:
            return send()
        except requests.ConnectionError as error:
            if safe and error.args and isinstance(error.args[0], ProtocolError):
                return send()
            raise

    def interrupt(self) -> None:
        """Break all present and future connections, which wakes threads that wait for a reply."""
        self._adapter.interrupt()

    def close(self) -> None:
        """Close the idle connections; further requests open new ones."""
        self._session.close()


class _Adapter(HTTPAdapter):
    """Pools whose connections can be interrupted from another thread."""

    def __init__(self) -> None:
        self._sockets: WeakSet[socket.socket] = WeakSet()
        self._interrupted = False
        super().__init__()

    def init_poolmanager(self, *args: Any, **kwargs: Any) -> None:
        super().init_poolmanager(*args, **kwargs)
        self._register(self.poolmanager)

    def proxy_manager_for(self, *args: Any, **kwargs: Any) -> Any:
        manager = super().proxy_manager_for(*args, **kwargs)
        self._register(manager)
        return manager

    def interrupt(self) -> None:
        self._interrupted = True
        for opened in tuple(self._sockets):
            _shut_down(opened)

    def _register(self, manager: PoolManager) -> None:
        plain, secure = (_connection(kind, self._opened) for kind in _KINDS)
        manager.pool_classes_by_scheme = {
            "http": type("Pool", (HTTPConnectionPool,), {"ConnectionCls": plain}),
            "https": type("Pool", (HTTPSConnectionPool,), {"ConnectionCls": secure}),
        }

    def _opened(self, opened: socket.socket) -> None:
        self._sockets.add(opened)
        if self._interrupted:
            _shut_down(opened)


_KINDS: Final = (HTTPConnection, HTTPSConnection)


def _connection(
    kind: type[HTTPConnection], opened: Callable[[socket.socket], None]
) -> type[HTTPConnection]:
    """A connection class that reports its socket and counts as closed after `IDLE` seconds."""

    class ReusedConnection(kind):  # type: ignore[valid-type,misc]
        used = 0.0

        def connect(self) -> None:
            super().connect()
            opened(self.sock)

        def getresponse(self, *args: Any, **kwargs: Any) -> Any:
            try:
                return super().getresponse(*args, **kwargs)
            finally:
                self.used = time.monotonic()

        @property
        def is_connected(self) -> bool:
            return time.monotonic() - self.used < IDLE and bool(super().is_connected)

    return ReusedConnection


def _shut_down(opened: socket.socket) -> None:
    with contextlib.suppress(OSError):
        opened.shutdown(socket.SHUT_RDWR)


def is_local(address: str) -> bool:
    """Whether the address names this machine."""
    return urlsplit(address).hostname in ("127.0.0.1", "localhost", "::1")
