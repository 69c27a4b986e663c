"""Worker set: the processes of a query pool."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator
from typing import Any

from kg.model.errors import GraphError
from kg.serving.workers.admission import closed
from kg.serving.workers.process import WorkerProcess


class WorkerSet:
    """Processes that evaluate one request at a time; safe to use from several threads.

    `size` of them run in advance. The queue of the pool lends no more at once, except while one
    that was killed ends.
    """

    def __init__(self, settings: dict[str, Any], size: int) -> None:
        self.size = size
        self._settings = settings
        self._changed = threading.Condition()
        self._idle = [WorkerProcess(settings) for _ in range(size)]
        self._lent: set[WorkerProcess] = set()
        self._killed = False

    @property
    def pids(self) -> tuple[int, ...]:
        """Process ids of the workers."""
        with self._changed:
            return tuple(sorted(worker.pid for worker in (*self._idle, *self._lent)))

    @property
    def busy(self) -> int:
        """Number of workers that are lent."""
        with self._changed:
            return len(self._lent)

    @contextlib.contextmanager
    def lent(self, at: int | None = None) -> Iterator[WorkerProcess]:
        """Lend a worker for a block, if possible one with the past state `at` in memory.

        Raises GraphError after `kill`, or if no process can be started.
        """
        worker = self._take(at)
        try:
            yield worker
        finally:
            self._give_back(worker)

    def kill(self) -> None:
        """Kill the processes, and start no more."""
        with self._changed:
            self._killed = True
            for worker in (*self._idle, *self._lent):
                worker.kill()

    def close(self) -> None:
        """Wait, after `kill`, until no worker is lent any more, and close them."""
        with self._changed:
            self._changed.wait_for(lambda: not self._lent)
            for worker in self._idle:
                worker.close()
            self._idle.clear()

    def _take(self, at: int | None) -> WorkerProcess:
        with self._changed:
            if self._killed:
                raise closed()
            self._close_dead()
            # of equals the one that was used last, which has probably opened the newest snapshot
            found = max(reversed(self._idle), key=lambda idle: idle.past == at, default=None)
            if found is not None:
                self._idle.remove(found)
            worker = found or WorkerProcess(self._settings)
            self._lent.add(worker)
            return worker

    def _give_back(self, worker: WorkerProcess) -> None:
        with self._changed:
            self._lent.remove(worker)
            self._idle.append(worker)
            self._close_dead()
            if len(self._idle) + len(self._lent) > self.size:
                self._idle.pop().close()
            with contextlib.suppress(GraphError):  # the next query tries again and reports it
                while not self._killed and len(self._idle) + len(self._lent) < self.size:
                    self._idle.insert(0, WorkerProcess(self._settings))
            self._changed.notify_all()

    def _close_dead(self) -> None:
        for worker in [worker for worker in self._idle if not worker.alive]:
            self._idle.remove(worker)
            worker.close()
