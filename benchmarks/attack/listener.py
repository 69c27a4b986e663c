"""Listener on the loopback that counts the connections that arrive."""

from __future__ import annotations

import contextlib
import socket
import threading
from typing import Self


class Listener:
    """Accepts connections at a free port and replies with a text that must not be quoted."""

    SECRET = "an-internal-reply"  # what an error must not quote

    def __init__(self) -> None:
        self._socket = socket.create_server(("127.0.0.1", 0))
        self._lock = threading.Lock()
        self._arrived = 0
        self._thread = threading.Thread(target=self._accept, daemon=True)
        self._thread.start()

    @property
    def address(self) -> str:
        """Its URL, with a slash at the end."""
        return f"http://127.0.0.1:{self._socket.getsockname()[1]}/"

    def arrived(self) -> int:
        """Connections since the last call."""
        with self._lock:
            count, self._arrived = self._arrived, 0
            return count

    def _accept(self) -> None:
        body = self.SECRET.encode()
        head = f"HTTP/1.1 500 X\r\nContent-Length: {len(body)}\r\nConnection: close\r\n\r\n"
        while True:
            try:
                connection, _ = self._socket.accept()
            except OSError:
                return
            with self._lock:
                self._arrived += 1
            with connection, contextlib.suppress(OSError):
                connection.settimeout(1)
                connection.recv(1 << 16)
                connection.sendall(head.encode() + body)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self._socket.close()
