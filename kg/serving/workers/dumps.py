"""Dumps of a map, written from a snapshot by a separate process and streamed."""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Any, Final

from kg.serving.workers.process import WorkerProcess
from kg.store.snapshots import Snapshot, Snapshots

NO_LIMIT: Final = 1 << 62  # [bytes]


class Dump:
    """A dump in progress: call `read` until it returns nothing, then `close`.

    The dump begins with the first `read`; a failure of that call can still become an error
    response. Raises as `WorkerProcess.ask`.
    """

    def __init__(
        self,
        settings: dict[str, Any],
        snapshots: Snapshots,
        request: dict[str, Any],
        seconds: float,
        left: Callable[[], None],
    ) -> None:
        self._snapshots, self._left = snapshots, left
        self._worker: WorkerProcess | None = None
        self._snapshot: Snapshot | None = None
        self._parts = self._written(settings, request, seconds)

    def read(self) -> bytes:
        """The next part; empty at the end."""
        return next(self._parts, b"")

    def close(self) -> None:
        """End the process, and release the snapshot."""
        self._parts.close()
        if self._worker is not None:
            self._worker.close()
            self._worker = None
        if self._snapshot is not None:
            self._snapshots.release(self._snapshot)
            self._snapshot = None
        left, self._left = self._left, lambda: None
        left()

    def _written(
        self, settings: dict[str, Any], request: dict[str, Any], seconds: float
    ) -> Generator[bytes, None, None]:
        self._snapshot = self._snapshots.lease()
        self._worker = WorkerProcess(settings)  # denied the network, like the others
        self._worker.lower_priority()
        message = request | {"folder": str(self._snapshot.folder), "max_bytes": NO_LIMIT}
        yield from self._worker.stream(message, seconds, b"G")
