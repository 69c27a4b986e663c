"""Query workers, measured beside evaluation in the same process, on synthetic maps.

    python -m benchmarks.workers [OBJECTS ...]        (from the repository's root; 1000 100000)

Prints, for each size: a snapshot's time, a worker's start and respawn, the delay of an ASK alone,
beside a runaway query and beside a writer, and how far answers lag behind the map.
"""

from __future__ import annotations

import sys
import tempfile
import threading
import time
from pathlib import Path

from benchmarks.made_maps import ASK, RUNAWAY, commit, fill, milliseconds, seconds, writer
from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.errors import QueryTimeoutError, QueryTooLargeError
from kg.serving.opening import create_map
from kg.serving.workers.pool import QueryPool
from kg.serving.workers.process import WorkerProcess, settings_of
from kg.serving.workers.request import query_call
from kg.store.snapshots import Snapshots
from lab.command_line import parser_of

TABLE = "SELECT ?o ?x {?o a here:Chair ; here:x ?x} LIMIT 1000"


def main() -> None:
    """Measure each size given, or a thousand and a hundred thousand objects."""
    parser = parser_of("benchmarks.workers", __doc__)
    parser.add_argument("objects", nargs="*", type=int, default=[1_000, 100_000])
    for objects in parser.parse_args().objects:
        with (
            tempfile.TemporaryDirectory() as folder,
            create_map(Path(folder) / "home") as live,
        ):
            fill(live, objects)
            sys.stdout.write(f"\n{objects:,} objects\n")
            _measure(live)


def _measure(live: SemanticMap) -> None:
    _snapshots(live)
    prefix = f"PREFIX here: <{v.HERE}> "
    here = [seconds(lambda: live.query(prefix + ASK)) for _ in range(100)]
    _report("ASK in this process", here)
    here = [seconds(lambda: live.query(prefix + TABLE)) for _ in range(100)]
    _report("1,000 rows in this process", here)
    with QueryPool(live, timeout=3) as pool:
        _report("ASK of a worker", [_asked(pool) for _ in range(500)])
        rows = [seconds(lambda: pool.run(TABLE)) for _ in range(100)]
        _report("1,000 rows of a worker", rows)
        _report("ASK beside a runaway", _beside_runaway(pool))
        _respawn(pool)
    with QueryPool(live, timeout=3) as pool:
        _beside_writer(live, pool)


def _asked(pool: QueryPool) -> float:
    return seconds(lambda: pool.run(ASK))


def _snapshots(live: SemanticMap) -> None:
    snapshots = Snapshots(live.store, refresh=0)
    settings = settings_of(1024, (), snapshots.readable, snapshots.writable)
    made, ready = [], []
    for number in range(20):
        commit(live, number)
        begun = time.perf_counter()
        snapshot = snapshots.lease()
        made.append(time.perf_counter() - begun)
        request = query_call("ASK {}").body | {"folder": str(snapshot.folder), "max_bytes": 1000}
        begun = time.perf_counter()
        worker = WorkerProcess(settings)
        worker.ask(request, 10)
        ready.append(time.perf_counter() - begun)
        worker.close()
        snapshots.release(snapshot)
    snapshots.close()
    _report("snapshot", made)
    _report("worker, started to first answer", ready)


def _beside_runaway(pool: QueryPool) -> list[float]:
    runaway = threading.Thread(target=_run_away, args=(pool,))
    runaway.start()
    time.sleep(0.1)
    times = []
    while runaway.is_alive() and len(times) < 2000:
        times.append(_asked(pool))
        time.sleep(0.001)
    runaway.join()
    return times


def _respawn(pool: QueryPool) -> None:
    times = []
    for _ in range(5):
        runaways = [threading.Thread(target=_run_away, args=(pool, 0.2)) for _ in pool.pids]
        for runaway in runaways:
            runaway.start()
        time.sleep(0.05)
        times.append(_asked(pool) - 0.15)
        for runaway in runaways:
            runaway.join()
    _report("ASK after a kill (beyond the limit of 0.2 s)", times)


def _beside_writer(live: SemanticMap, pool: QueryPool) -> None:
    """30 commits a second, while one client asks as fast as it can."""
    times, lags = [], []
    until = time.monotonic() + 8
    with writer(live) as (commits, written):
        while time.monotonic() < until:
            begun = time.perf_counter()
            answer = pool.run(ASK)
            times.append(time.perf_counter() - begun)
            if (missing := written.get(answer.sequence + 1)) is not None:
                lags.append(time.monotonic() - missing)
            time.sleep(0.002)
    _report("ASK beside a writer at 30 Hz", times)
    _report("commit meanwhile", commits)
    _report("answer behind the map", lags)


def _run_away(pool: QueryPool, timeout: float | None = None) -> None:
    try:
        pool.run(RUNAWAY, timeout=timeout)
    except (QueryTimeoutError, QueryTooLargeError):
        return


def _report(what: str, times: list[float]) -> None:
    p50, p99, most = milliseconds(times, 50, 99, 100)
    row = f"{what:46} n {len(times):5}  p50 {p50:8.2f}  p99 {p99:8.2f}  max {most:8.2f} ms\n"
    sys.stdout.write(row)


if __name__ == "__main__":
    main()
