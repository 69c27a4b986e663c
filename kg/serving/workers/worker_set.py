"""Worker set: the processes of a query pool and the snapshots that they read."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator
from typing import Any

from kg.model.errors import GraphError, PoolBusyError
from kg.serving.workers.process import WorkerProcess
from kg.store.snapshots import Snapshot, Snapshots


class WorkerSet:
    """`size` worker processes, each replaced when it dies; safe to use from several threads.

    `timeout` [s] limits the time to open a snapshot in advance.
    """

    def __init__(
        self, settings: dict[str, Any], size: int, snapshots: Snapshots, timeout: float
    ) -> None:
        self.size = size
        self._settings, self._snapshots, self._timeout = settings, snapshots, timeout
        self._changed = threading.Condition()
        self._idle: list[WorkerProcess] = []
        self._all: set[WorkerProcess] = set()
        self._starting = 0
        self._killed = False
        for _ in range(size):
            self._start_worker()

    @property
    def pids(self) -> tuple[int, ...]:
        """Process ids of the workers."""
        with self._changed:
            return tuple(sorted(worker.pid for worker in self._all))

    @property
    def busy(self) -> int:
        """Number of workers that are lent."""
        with self._changed:
            return len(self._all) - len(self._idle)

    @contextlib.contextmanager
    def lent(self, patience: float, at: int | None = None) -> Iterator[WorkerProcess]:
        """Lend a worker for a block, if possible one with the past state `at` in memory.

        Raises PoolBusyError if none is free within `patience` seconds, GraphError after `kill`.
        """
        worker = self._take(patience, at)
        try:
            yield worker
        finally:
            self._give_back(worker)

    def assign(self, worker: WorkerProcess, at_least: int) -> Snapshot:
        """Assign a snapshot with transaction `at_least` to a lent worker."""
        snapshot = self._snapshots.lease(at_least, worker.snapshot)
        self._reads(worker, snapshot)
        return snapshot

    def refresh(self) -> None:
        """Take a new snapshot if one is due; idle workers open it."""
        self._snapshots.refresh()
        for worker in self._idle_now():
            if not self._snapshots.is_newest(worker.snapshot) and self._borrow(worker):
                try:
                    self._prepare(worker)
                    worker.wait_ready()
                finally:
                    self._give_back(worker)

    def replace_slow(self) -> None:
        """Replace workers with a lowered priority, which needs privileges to undo."""
        for worker in self._idle_now():
            if worker.slow and self._borrow(worker):
                worker.kill()
                self._give_back(worker)

    def kill(self) -> None:
        """Kill the processes, and start no more."""
        with self._changed:
            self._killed = True
            for worker in self._all:
                worker.kill()
            self._changed.notify_all()

    def close(self) -> None:
        """Wait, after `kill`, until no worker is lent any more, and close them."""
        with self._changed:
            self._changed.wait_for(lambda: len(self._idle) == len(self._all))
            for worker in self._idle:
                worker.close()
            self._all.clear()
            self._idle.clear()

    def _idle_now(self) -> tuple[WorkerProcess, ...]:
        with self._changed:
            return tuple(self._idle)

    def _borrow(self, worker: WorkerProcess) -> bool:
        """Take an idle worker; False if it was taken meanwhile."""
        with self._changed:
            if worker not in self._idle or self._killed:
                return False
            self._idle.remove(worker)
            return True

    def _take(self, patience: float, at: int | None) -> WorkerProcess:
        deadline = time.monotonic() + patience
        while True:
            worker = self._next(deadline, at)
            if worker is None:
                return self._new_worker()
            if worker.alive:
                return worker
            self._give_back(worker)  # it died while idle and is replaced

    def _next(self, deadline: float, at: int | None) -> WorkerProcess | None:
        """An idle worker, dead or alive; None if a new one may be started.

        A worker is preferred that has the past state `at` in memory.
        """
        with self._changed:
            while not self._idle and len(self._all) + self._starting >= self.size:
                self._check_open()
                if not self._changed.wait(deadline - time.monotonic()):
                    raise all_busy()
            self._check_open()
            if self._idle:
                best = max(self._idle, key=lambda idle: _readiness(idle, at))
                self._idle.remove(best)
                return best
            self._starting += 1
            return None

    def _give_back(self, worker: WorkerProcess) -> None:
        if not worker.alive:
            self._bury(worker)
            with contextlib.suppress(GraphError):  # the next query tries again and reports it
                self._start_worker()
            return
        with self._changed:
            self._idle.append(worker)
            self._changed.notify_all()

    def _bury(self, worker: WorkerProcess) -> None:
        worker.close()
        if worker.snapshot is not None:
            self._snapshots.release(worker.snapshot)
        with self._changed:
            self._all.discard(worker)
            self._changed.notify_all()

    def _start_worker(self) -> None:
        """Start an idle worker if one is missing."""
        with self._changed:
            if self._killed or len(self._all) + self._starting >= self.size:
                return
            self._starting += 1
        self._give_back(self._new_worker())

    def _new_worker(self) -> WorkerProcess:
        worker = None
        try:
            worker = WorkerProcess(self._settings)
            self._prepare(worker)
        except BaseException:
            if worker is not None:
                worker.close()
            raise
        finally:
            with self._changed:
                self._starting -= 1
                if worker is not None and worker.snapshot is not None:
                    self._all.add(worker)
                    if self._killed:
                        worker.kill()
                self._changed.notify_all()
        return worker

    def _prepare(self, worker: WorkerProcess) -> None:
        snapshot = self._snapshots.lease()
        self._reads(worker, snapshot)
        worker.prepare(snapshot, self._timeout)

    def _reads(self, worker: WorkerProcess, snapshot: Snapshot) -> None:
        worker.snapshot, before = snapshot, worker.snapshot
        if before is not None:
            self._snapshots.release(before)

    def _check_open(self) -> None:
        if self._killed:
            raise GraphError("the query pool is closed; make a new one")


def _readiness(worker: WorkerProcess, at: int | None) -> tuple[bool, bool, int]:
    """Rank of an idle worker: priority, its past state, its snapshot."""
    opened = worker.snapshot.sequence if worker.snapshot else -1
    return not worker.slow, worker.past == at, opened


def all_busy() -> PoolBusyError:
    """The error if no worker becomes free in time."""
    return PoolBusyError("all query workers are busy; try again later")
