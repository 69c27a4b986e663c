"""Uploads: the memory of request bodies, limited for each client and for all together.

A body counts from its first byte until its request is answered. Bodies of up to `SMALL` bytes are
exempt: the number of connections limits them, and queries pass while others upload.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeVar

from kg.serving.server.http.limits.connection import PatientConnection
from kg.serving.server.http.limits.reading_threads import ReadingThreads
from kg.serving.server.http.limits.shares import greediest
from kg.serving.server.http.problems import Problem
from kg.serving.server.http.settings import Limits
from kg.store.process_memory import trim_heap

T = TypeVar("T")
SMALL = 64 << 10  # [bytes] of a body that does not count


class Upload:
    """The body of one request; used on the event loop."""

    def __init__(self, uploads: Uploads, connection: PatientConnection, client_name: str) -> None:
        self.connection, self.client_name = connection, client_name
        self.held = 0  # [bytes]
        self.complete = self.refused = False
        self._uploads = uploads

    @property
    def counted(self) -> int:
        """Bytes that count."""
        return self.held if self.held > SMALL else 0

    def take(self, size: int) -> None:
        """Hold more (or fewer) bytes of the body.

        Raises Problem 503 if there is no room for them, or was none for what is held already.
        """
        if self.refused:
            raise self._uploads.full()
        self.held += size
        if size > 0 and self.counted:
            self._uploads.make_room(self)

    async def run(self, act: Callable[[], T]) -> T:
        """The result of `act` in a thread, once it is this client's turn."""
        return await self._uploads.threads.run(self.client_name, act)


class Uploads:
    """The bodies that the server holds."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self.threads = ReadingThreads()
        self._all: dict[Upload, None] = {}  # oldest first

    def begin(self, connection: PatientConnection, client_name: str) -> Upload:
        """The upload of a new request, which `end` has to end."""
        upload = Upload(self, connection, client_name)
        self._all[upload] = None
        return upload

    def end(self, upload: Upload) -> None:
        """Release the body of a request."""
        self._all.pop(upload, None)
        if upload.counted and not any(other.counted for other in self._all):
            trim_heap()  # the C library keeps freed pages otherwise

    def make_room(self, growing: Upload) -> None:
        """End uploads until the limits hold; raises Problem 503 if `growing` is one of them."""
        own = [one for one in self._all if one.client_name == growing.client_name]
        self._reduce(own, self._limits.client_bodies, growing)
        self._reduce(self._all, self._limits.bodies, growing)

    def _reduce(self, uploads: Iterable[Upload], limit: int, growing: Upload) -> None:
        left = [one for one in uploads if one.counted]
        excess = sum(one.counted for one in left) - limit
        while excess > 0:
            # a complete body is in use; of the others the newest goes, so that older ones complete
            last = _newest_of_greediest(left)
            if last is growing:
                raise self.full()
            left.remove(last)
            excess -= last.counted
            self._all.pop(last, None)
            last.refused = True
            last.connection.refuse()

    def full(self) -> Problem:
        """The refusal of a body for which there is no room."""
        return Problem(
            503,
            f"bodies that wait for their answers may have {self._limits.client_bodies} "
            f"bytes for one client, {self._limits.bodies} for all; send one at a time",
            {"Retry-After": "1", "Connection": "close"},
        )


def _newest_of_greediest(uploads: list[Upload]) -> Upload:
    while candidates := greediest(uploads, lambda one: one.counted):
        incomplete = [one for one in candidates if not one.complete]
        if incomplete:
            return incomplete[-1]
        uploads = [one for one in uploads if one not in candidates]
    raise AssertionError("the growing body is incomplete")
