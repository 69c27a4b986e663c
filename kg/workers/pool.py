"""Untrusted queries, evaluated side by side in killable processes on snapshots of a live map."""

from __future__ import annotations

import asyncio
import contextlib
import threading
import time
import weakref
from collections.abc import Collection, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from typing import Any, Self

from kg.errors import GraphError, HistoryError, NotAcceptableError, PoolBusyError
from kg.semantic_map import SemanticMap
from kg.store import MapStore
from kg.workers.call import Call
from kg.workers.formats import Form, choose_format
from kg.workers.pasts import Pasts
from kg.workers.process import Answer, WorkerDiedError, WorkerProcess, settings_of
from kg.workers.snapshots import Snapshot, Snapshots
from kg.workers.turns import Turns
from kg.workers.vetting import MAX_LENGTH, refuse_length, refuse_surrogates

_WARM = 10.0  # [s] without a query until the snapshot is no longer kept fresh ahead of questions
_TICK = 0.05  # [s] between looks at whether the snapshot is due, at the least


class QueryPool:
    """Worker processes that answer queries nobody vouches for; a context manager.

    Safe from several threads, and from an event loop through `run_async`. `timeout` [s] is each
    query's, `memory_mb` what a worker may need beyond its start, `queue` how many queries may wait,
    `services` the endpoints SERVICE may name. Questions about the past leave one worker free, where
    there are several. An answer is at most `refresh` seconds behind the map
    (twice that while writing never pauses).
    """

    def __init__(
        self,
        source: SemanticMap | MapStore,
        *,
        workers: int = 2,
        timeout: float = 10.0,
        memory_mb: int = 1024,
        max_result_bytes: int = 64 << 20,
        refresh: float = 1.0,
        queue: int = 32,
        max_query_length: int = MAX_LENGTH,
        services: Collection[str] = (),
    ) -> None:
        self.timeout = timeout
        self.max_result_bytes = max_result_bytes
        self.max_query_length = max_query_length
        self._settings = settings_of(memory_mb, services)
        self._places = threading.BoundedSemaphore(workers + queue)
        self._changed = threading.Condition()
        self._idle: list[WorkerProcess] = []
        self._all: set[WorkerProcess] = set()
        self._workers, self._starting = workers, 0
        self._turns = Turns(workers, queue)
        self._last_query = time.monotonic()
        self._closed = threading.Event()
        store = source if isinstance(source, MapStore) else source.store
        self._snapshots = Snapshots(store, refresh=refresh)
        self._pasts = None if isinstance(source, MapStore) else _pasts_of(source)
        self._threads = ThreadPoolExecutor(workers + queue, thread_name_prefix="query")
        for _ in range(workers):
            self._start_worker()
        self._keeper = threading.Thread(
            target=_keep_fresh,
            args=(weakref.ref(self), self._closed, max(refresh, _TICK)),
            daemon=True,
        )
        self._keeper.start()

    @property
    def pids(self) -> tuple[int, ...]:
        """The worker processes there are now."""
        with self._changed:
            return tuple(sorted(worker.pid for worker in self._all))

    @property
    def busy(self) -> int:
        """How many of them are not waiting for a query."""
        with self._changed:
            return len(self._all) - len(self._idle)

    def run(
        self,
        sparql: str,
        *,
        accept: str | None = None,
        default_graphs: Sequence[str] = (),
        named_graphs: Sequence[str] = (),
        timeout: float | None = None,
        at_least: int = 0,
        at: int | None = None,
        base: str | None = None,
    ) -> Answer:
        """The serialised answer to a query, in the best format an Accept header asks for.

        The graphs override FROM and FROM NAMED (SPARQL 1.1 Protocol, section 2.1.4); without either
        the default graph is the union of all. Relative IRIs are of `base`. `timeout` [s] counts
        from when a worker is ready, and cannot exceed the pool's. The answer has seen transaction
        `at_least`; with `at` it is that of the map right after that transaction, which of a large
        map may have to be made first, within as much time again.

        Raises QueryRefusedError, QueryTimeoutError, QueryTooLargeError, NotAcceptableError,
        PoolBusyError, QueryError for what does not parse, HistoryError for a past that is not kept,
        GraphError where the pool is closed.
        """
        request = self._request(sparql, accept, default_graphs, named_graphs, base)
        call = Call(request, self._limit(timeout), at_least, at)
        with self._place(call):
            return self._run(call)

    async def run_async(
        self,
        sparql: str,
        *,
        accept: str | None = None,
        default_graphs: Sequence[str] = (),
        named_graphs: Sequence[str] = (),
        timeout: float | None = None,
        at_least: int = 0,
        at: int | None = None,
        base: str | None = None,
    ) -> Answer:
        """`run` without blocking the event loop; cancelling it kills the query."""
        request = self._request(sparql, accept, default_graphs, named_graphs, base)
        return await self._in_thread(Call(request, self._limit(timeout), at_least, at))

    async def tell_async(
        self, what: str, media_type: str, *, at_least: int = 0, **asked: object
    ) -> Answer:
        """What a worker tells of the past: "log", "diff" or "why" (`kg.workers.past`).

        Raises as `run_async`; HistoryError where the map keeps no history.
        """
        request = {
            "what": what,
            "media_type": media_type,
            "max_bytes": self.max_result_bytes,
            **asked,
        }
        return await self._in_thread(Call(request, self.timeout, at_least, None, b"T"))

    async def _in_thread(self, call: Call) -> Answer:
        place = self._place(call)

        def evaluate() -> Answer:
            with place:
                return self._run(call)

        try:
            future = self._threads.submit(evaluate)
        except BaseException:
            place.close()
            raise
        try:
            return await asyncio.wrap_future(future)
        except asyncio.CancelledError:
            call.cancel()
            if future.cancel():
                place.close()
            raise

    def close(self) -> None:
        """Kill the workers and remove the snapshots; closing twice is fine."""
        with self._changed:
            self._closed.set()
            for worker in self._all:
                worker.kill()
            self._changed.notify_all()
        self._threads.shutdown(wait=True, cancel_futures=True)
        self._keeper.join()
        with self._changed:
            self._changed.wait_for(lambda: len(self._idle) == len(self._all))
            for worker in self._idle:
                worker.close()
            self._all.clear()
            self._idle.clear()
        self._snapshots.close()
        if self._pasts is not None:
            self._pasts.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def freshen(self) -> None:
        """Take a new snapshot if one is due, and have idle workers open it ahead of questions."""
        if time.monotonic() - self._last_query > _WARM:
            return
        snapshot = self._snapshots.lease()
        try:
            with self._changed:
                for worker in self._idle:
                    if worker.snapshot is not snapshot:
                        self._prepare(worker)
        finally:
            self._snapshots.release(snapshot)

    def _request(
        self,
        sparql: str,
        accept: str | None,
        default: Sequence[str],
        named: Sequence[str],
        base: str | None,
    ) -> dict[str, Any]:
        refuse_length(sparql, self.max_query_length)
        for text in (sparql, *default, *named):
            refuse_surrogates(text)
        result_type, graph_type = _acceptable(accept, "select"), _acceptable(accept, "construct")
        if result_type is None and graph_type is None:
            choose_format(accept, "select")
        return {
            "sparql": sparql,
            "base_iri": base,
            "default_graphs": list(default),
            "named_graphs": list(named),
            "result_type": result_type,
            "graph_type": graph_type,
            "max_bytes": self.max_result_bytes,
        }

    def _limit(self, timeout: float | None) -> float:
        return self.timeout if timeout is None else max(0.001, min(timeout, self.timeout))

    def _place(self, call: Call) -> ExitStack:
        """A place in the queue, given back when the stack closes."""
        with ExitStack() as stack:
            stack.enter_context(self._turns.place(call))
            if not self._places.acquire(blocking=False):
                raise PoolBusyError(
                    "all query workers are busy and the queue is full; ask again later"
                )
            stack.callback(self._places.release)
            return stack.pop_all()

    def _run(self, call: Call) -> Answer:
        with self._turns.turn(call, self._patience):
            for _ in range(self._workers):
                try:
                    return self._try(call)
                except WorkerDiedError:  # ended by somebody else: once more, on another worker
                    if call.cancelled:
                        raise
            # all there were may have been killed together, before they were asked: this one is new
            return self._try(call)

    @property
    def _patience(self) -> float:
        """[s] to wait for a worker: one that runs into its limit is outlasted."""
        return 2 * self.timeout

    def _try(self, call: Call) -> Answer:
        self._last_query = time.monotonic()
        worker = self._take()
        try:
            call.begin(worker)
            snapshot = self._state(worker, call)
            self._reads(worker, snapshot)
            request = call.request | {"folder": str(snapshot.folder)}
            if call.kind == b"T" or self._folds(call):
                request |= self._past_of_map().history() | {"at": call.at}
            return worker.ask(request, call.timeout, call.kind)
        finally:
            call.end()
            self._give_back(worker)

    def _state(self, worker: WorkerProcess, call: Call) -> Snapshot:
        """The state of the map that the call is about, leased."""
        if call.at is None or self._folds(call):
            return self._snapshots.lease(max(call.at_least, call.at or 0))

        def make(request: dict[str, Any]) -> None:
            worker.ask(request | {"max_bytes": 0}, call.timeout, b"P")

        return self._past_of_map().lease(call.at, make)

    def _folds(self, call: Call) -> bool:
        """Whether the worker makes what it needs of the past itself."""
        return call.at is not None and self._past_of_map().small

    def _past_of_map(self) -> Pasts:
        if self._pasts is None:
            raise HistoryError("this map keeps no history")
        return self._pasts

    def _take(self) -> WorkerProcess:
        deadline = time.monotonic() + self._patience
        while True:
            worker = self._next(deadline)
            if worker is None:
                return self._new_worker()
            if worker.alive:
                return worker
            self._give_back(worker)  # it died while idle: have it replaced

    def _next(self, deadline: float) -> WorkerProcess | None:
        """An idle worker, dead or alive; None where a new one may be started."""
        with self._changed:
            while not self._idle and len(self._all) + self._starting >= self._workers:
                self._refuse_closed()
                if not self._changed.wait(deadline - time.monotonic()):
                    raise PoolBusyError("all query workers are busy; ask again later")
            self._refuse_closed()
            if self._idle:
                return self._idle.pop()
            self._starting += 1
            return None

    def _give_back(self, worker: WorkerProcess) -> None:
        if not worker.alive:
            self._bury(worker)
            with contextlib.suppress(GraphError):  # the next question tries again, and reports it
                self._start_worker()
            return
        with self._changed:
            self._idle.append(worker)
            self._changed.notify_all()

    def _bury(self, worker: WorkerProcess) -> None:
        worker.close()
        if worker.snapshot is not None:
            self._release(worker.snapshot)
        with self._changed:
            self._all.discard(worker)
            self._changed.notify_all()

    def _start_worker(self) -> None:
        """Have one more idle worker, where one is missing."""
        with self._changed:
            if self._closed.is_set() or len(self._all) + self._starting >= self._workers:
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
                    if self._closed.is_set():
                        worker.kill()
                self._changed.notify_all()
        return worker

    def _prepare(self, worker: WorkerProcess) -> None:
        snapshot = self._snapshots.lease()
        self._reads(worker, snapshot)
        worker.prepare(snapshot, self.timeout)

    def _reads(self, worker: WorkerProcess, snapshot: Snapshot) -> None:
        worker.snapshot, before = snapshot, worker.snapshot
        if before is not None:
            self._release(before)

    def _release(self, snapshot: Snapshot) -> None:
        self._snapshots.release(snapshot)
        if self._pasts is not None:
            self._pasts.release(snapshot)

    def _refuse_closed(self) -> None:
        if self._closed.is_set():
            raise GraphError("the query pool is closed; make a new one")


def _keep_fresh(reference: weakref.ref[QueryPool], closed: threading.Event, refresh: float) -> None:
    # a weak reference, so that a pool nobody holds any more is let go although never closed
    while not closed.wait(refresh):
        pool = reference()
        if pool is None:
            return
        with contextlib.suppress(GraphError):  # the next question reports it
            pool.freshen()
        del pool


def _pasts_of(semantic_map: SemanticMap) -> Pasts | None:
    try:
        return Pasts(semantic_map.store, semantic_map.history, semantic_map.base)
    except HistoryError:
        return None


def _acceptable(accept: str | None, form: Form) -> str | None:
    try:
        return choose_format(accept, form)
    except NotAcceptableError:
        return None
