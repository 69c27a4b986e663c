"""Query pool: evaluates untrusted queries in worker processes, on snapshots of a live map.

Workers read the history of the map as a file.
"""

from __future__ import annotations

import asyncio
import contextlib
import threading
import time
import uuid
import weakref
from collections.abc import AsyncIterator, Collection, Generator, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from typing import Any, Final, Self, Unpack

from kg.history.storage.log import HistoryLog
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import (
    EngineFailureError,
    GraphError,
    HistoryError,
    QueryError,
    WorkerDiedError,
)
from kg.model.sqlite_files import connect
from kg.rdf.sparql.vetting import has_allowed_service
from kg.serving.workers.admission import FairQueue
from kg.serving.workers.isolation import Confinement
from kg.serving.workers.ontology_worker import OntologyWorker
from kg.serving.workers.process import Answer, WorkerProcess, WorkerSet, settings_of
from kg.serving.workers.request import QueryOptions, WorkerCall, query_call
from kg.store.snapshots import Snapshots


class HistoryFile:
    """The history file of a map, or a copy in `home` of a history in memory.

    Safe from any thread.
    """

    def __init__(self, log: HistoryLog, base: str, home: Path | None) -> None:
        self._log, self._base, self._home = log, base, home
        self._guard = threading.Lock()
        self._copy: Path | None = None
        self._copied = -1  # the last transaction in the copy

    def request(self) -> dict[str, str]:
        """Path of the history and base of the map, as a part of a request."""
        return {"log": str(self._path()), "base": self._base}

    def _path(self) -> Path:
        if self._log.file is not None:
            return self._log.file.resolve()
        with self._guard, self._log.lock:
            if self._copy is None:
                assert self._home is not None, "a map in memory has a folder for snapshots"
                self._copy = self._home / "history.sqlite"
            if self._copied != self._log.last:
                fresh = self._copy.with_name(f"{uuid.uuid4()}.sqlite")
                with closing(connect(fresh)) as copy:
                    self._log.db.backup(copy)
                fresh.replace(self._copy)  # readers of the old file keep it open
                self._copied = self._log.last
            return self._copy


DUMPS = 2  # at once
DUMP_SECONDS = 600.0  # to wait for a dump, and again to write it
NO_LIMIT: Final = 1 << 62  # [bytes]
_WARM = 10.0  # [s] after the last query in which snapshots are refreshed in advance
_TICK = 0.05  # [s] minimum between checks whether a new snapshot is due


class QueryPool:
    """Worker processes that evaluate untrusted queries; a context manager.

    Safe from several threads, and from an event loop through `answer_async`. Clients share the
    workers by fair queueing (`kg.serving.workers.admission`). Answers come from snapshots, which
    are refreshed in the background.

    - `timeout` [s]: the time limit of one query
    - `memory_mb`: the memory of a worker beyond its memory at the start
    - `refresh` [s]: the largest delay of an answer behind the map
    - `queue`: the number of queries of one client that may wait
    - `services`: the endpoints that SERVICE may name. A query that names one is evaluated in a
      process of its own; to all other workers the kernel denies the network.
    """

    def __init__(
        self,
        semantic_map: SemanticMap,
        *,
        workers: int = 3,
        timeout: float = 10.0,
        memory_mb: int = 1024,
        max_result_bytes: int = 64 << 20,
        refresh: float = 1.0,
        queue: int = 32,
        services: Collection[str] = (),
    ) -> None:
        self.timeout = timeout
        self.max_result_bytes = max_result_bytes
        self._services = frozenset(services)
        self._queue, self._dumps = FairQueue(workers, queue), FairQueue(DUMPS, queue)
        self._last_query = time.monotonic()
        self._closed = threading.Event()
        self._snapshots = Snapshots(semantic_map.store, refresh=refresh)
        self._settings = settings_of(
            memory_mb, services, self._snapshots.readable, self._snapshots.writable
        )
        self._history = _history_of(semantic_map, self._snapshots.home)
        #: plans replacements of the ontology
        self.ontologies = OntologyWorker(self._settings, self._snapshots, queue, max_result_bytes)
        self._threads = ThreadPoolExecutor(workers, thread_name_prefix="query")
        self._workers = WorkerSet(self._settings, workers)
        self._keeper = threading.Thread(
            target=_keep_fresh,
            args=(weakref.ref(self), self._closed, max(refresh / 2, _TICK)),
            daemon=True,
        )
        self._keeper.start()

    @property
    def pids(self) -> tuple[int, ...]:
        """Process ids of the workers."""
        return self._workers.pids

    @property
    def busy(self) -> int:
        """Number of workers with a query."""
        return self._workers.busy

    @property
    def confinement(self) -> Confinement:
        """Confinement of the workers by the kernel.

        Waits until a worker has started. Raises QueryError if no worker starts.
        """
        with self._workers.lent() as worker:
            worker.wait_ready()
            return worker.confinement

    def run(self, sparql: str, **options: Unpack[QueryOptions]) -> Answer:
        """The serialised answer to a query; raises as `query_call` and `answer`."""
        return self.answer(query_call(sparql, **options))

    def answer(self, call: WorkerCall) -> Answer:
        """The answer to a request of any kind, when its turn comes.

        Raises QueryRefusedError, QueryTimeoutError, QueryTooLargeError, NotAcceptableError,
        PoolBusyError, QueryError for a query that does not parse, HistoryError for a past that is
        not kept, GraphError if the pool is closed.
        """
        with self._queue.turn(call.client, call.lane, self._patience):
            return self._run(call)

    async def answer_async(self, call: WorkerCall) -> Answer:
        """`answer` without blocking the event loop; cancelling it kills the query."""
        async with self._queue.turn_async(call.client, call.lane, self._patience):
            try:
                return await asyncio.wrap_future(self._threads.submit(self._run, call))
            except asyncio.CancelledError:
                call.cancel()
                raise

    @contextlib.asynccontextmanager
    async def dump(
        self, request: dict[str, Any], client: str = ""
    ) -> AsyncIterator[Iterator[bytes]]:
        """The parts of a dump of all graphs, from a process of its own, when its turn comes.

        Few dumps run at once, and one per client. Raises PoolBusyError if too many wait; reading a
        part raises as `WorkerProcess.ask`.
        """
        async with self._dumps.turn_async(client, "present", DUMP_SECONDS):
            with closing(self._parts_of_dump(request)) as parts:
                yield parts

    def _parts_of_dump(self, request: dict[str, Any]) -> Generator[bytes, None, None]:
        with (
            self._snapshots.leased() as snapshot,
            closing(WorkerProcess(self._settings)) as worker,  # denied the network, like the others
        ):
            body = request | {"folder": str(snapshot.folder), "max_bytes": NO_LIMIT}
            yield from worker.stream(body, DUMP_SECONDS, b"G")

    def close(self) -> None:
        """Kill the workers and remove the snapshots; a second call does nothing."""
        self._closed.set()
        self._queue.close()
        self._dumps.close()
        self.ontologies.close()
        self._workers.kill()
        self._threads.shutdown(wait=True, cancel_futures=True)
        self._keeper.join()
        self._workers.close()
        self._snapshots.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def freshen(self) -> None:
        """Take a new snapshot if one is due."""
        if time.monotonic() - self._last_query <= _WARM:
            self._snapshots.refresh()

    def _run(self, call: WorkerCall) -> Answer:
        try:
            return self._run_somewhere(call)
        except EngineFailureError:
            # ORDER BY over mixed values failed: a second attempt sorts by a total order
            if call.kind not in b"QU":
                raise
            call.body = call.body | {"total_order": True}
            return self._run_somewhere(call)

    def _run_somewhere(self, call: WorkerCall) -> Answer:
        for _ in range(self._workers.size):
            try:
                return self._try(call)
            except WorkerDiedError:  # killed from outside: a second attempt on another worker
                if call.cancelled:
                    raise
        # the other workers may have been killed too; this one is new
        return self._try(call)

    @property
    def _patience(self) -> float:
        """[s] to wait for a worker; longer than the time limit of a query."""
        return 2 * self.timeout

    def _try(self, call: WorkerCall) -> Answer:
        self._last_query = time.monotonic()
        with (
            self._snapshots.naming_full_disk(),
            self._workers.lent(call.at) as worker,
            call.on(worker),
            self._snapshots.leased(call.at_least) as snapshot,
        ):
            where = {"folder": str(snapshot.folder), "max_bytes": self.max_result_bytes}
            return self._ask(worker, call, call.body | where)

    def _ask(self, worker: WorkerProcess, call: WorkerCall, request: dict[str, Any]) -> Answer:
        seconds = self.timeout
        if call.timeout is not None:
            seconds = max(0.001, min(call.timeout, self.timeout))
        if call.is_of_past:
            if self._history is None:
                raise HistoryError("this map keeps no history")
            request |= self._history.request() | {"at": call.at}
        if call.kind == b"U":
            with self._snapshots.scratch() as scratch:
                return worker.ask(request | {"scratch": str(scratch)}, seconds, b"U")
        with contextlib.ExitStack() as stack:
            if call.kind == b"Q" and has_allowed_service(request["sparql"], self._services):
                federated = WorkerProcess(self._settings, network=True)
                worker = stack.enter_context(closing(federated))
                stack.enter_context(call.on(worker))
            if call.kind == b"Q" and call.at is not None:
                # the past state is replayed first, with a time limit of its own
                worker.ask(request | {"max_bytes": 0}, seconds, b"P")
                worker.past = call.at
            return worker.ask(request, seconds, call.kind)


def _keep_fresh(reference: weakref.ref[QueryPool], closed: threading.Event, refresh: float) -> None:
    # a weak reference, so that an unreferenced pool is released without `close`
    while not closed.wait(refresh):
        pool = reference()
        if pool is None:
            return
        with contextlib.suppress(GraphError, QueryError):  # the next query reports it
            pool.freshen()
        del pool


def _history_of(semantic_map: SemanticMap, home: Path | None) -> HistoryFile | None:
    try:
        return HistoryFile(semantic_map.history.log, semantic_map.base, home)
    except HistoryError:
        return None
