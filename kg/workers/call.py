"""One query on its way through the pool, from the asking thread to a worker."""

from __future__ import annotations

import threading
from typing import Any

from kg.errors import QueryError
from kg.workers.process import WorkerProcess


class Call:
    """One query on its way through the pool, which another thread may cancel."""

    def __init__(
        self,
        request: dict[str, Any],
        timeout: float,
        at_least: int,
        at: int | None = None,
        kind: bytes = b"Q",
    ) -> None:
        self.request, self.timeout, self.at_least = request, timeout, at_least
        self.at, self.kind = at, kind
        self.cancelled = False
        self._worker: WorkerProcess | None = None
        self._guard = threading.Lock()

    @property
    def is_of_past(self) -> bool:
        """Whether it is about what was: a state of the past, or the history."""
        return self.at is not None or self.kind == b"T"

    def begin(self, worker: WorkerProcess) -> None:
        """It is `worker`'s now. Raises QueryError where it was cancelled before."""
        with self._guard:
            if self.cancelled:
                raise QueryError("the query was cancelled")
            self._worker = worker

    def end(self) -> None:
        """No worker has it any more."""
        with self._guard:
            self._worker = None

    def cancel(self) -> None:
        """Have it end at once, its worker too."""
        with self._guard:
            self.cancelled = True
            if self._worker is not None:
                self._worker.kill()
