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
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from pyoxigraph import Literal, NamedNode, Quad

from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.errors import QueryTimeoutError, QueryTooLargeError
from kg.model.transactions import Cause
from kg.serving.opening import create_map
from kg.serving.workers.pool import QueryPool
from kg.serving.workers.process import WorkerProcess
from kg.store.snapshots import Snapshots

ASK = "ASK {here:Kitchen here:isA here:Place}"
TABLE = "SELECT ?o ?x {?o a here:Chair ; here:x ?x} LIMIT 1000"
RUNAWAY = "SELECT (SUM(STRLEN(STR(?a))) AS ?n) {?a ?b ?c. ?d ?e ?f. ?g ?h ?i}"


def main() -> None:
    """Measure each size given, or a thousand and a hundred thousand objects."""
    for objects in [int(size) for size in sys.argv[1:]] or [1_000, 100_000]:
        with (
            tempfile.TemporaryDirectory(dir=Path.cwd()) as folder,
            create_map(Path(folder) / "home") as live,
        ):
            live.engine.bulk_extend(_objects(objects))
            live.store.flush()
            sys.stdout.write(f"\n{objects:,} objects\n")
            _measure(live)


def _measure(live: SemanticMap) -> None:
    _snapshots(live)
    ask = f"PREFIX here: <{v.HERE}> {ASK}"
    table = f"PREFIX here: <{v.HERE}> {TABLE}"
    for name, sparql in (("ASK", ask), ("1,000 rows", table)):
        _report(f"{name} in this process", _times(lambda q=sparql: live.query(q), 100))
    with QueryPool(live, timeout=3) as pool:
        _report("ASK of a worker", _times(lambda: pool.run(ASK), 500))
        _report("1,000 rows of a worker", _times(lambda: pool.run(TABLE), 100))
        _report("ASK beside a runaway", _beside_runaway(pool))
        _respawn(pool)
    with QueryPool(live, timeout=3) as pool:
        _beside_writer(live, pool)


def _snapshots(live: SemanticMap) -> None:
    snapshots = Snapshots(live.store, refresh=0)
    made, ready = [], []
    with QueryPool(live) as pool:
        settings = pool._settings
    for number in range(20):
        _write(live, number)
        begun = time.perf_counter()
        snapshot = snapshots.lease()
        made.append(time.perf_counter() - begun)
        request = {
            "sparql": "ASK {}", "default_graphs": [], "named_graphs": [], "graph_type": None,
            "result_type": "text/csv", "max_bytes": 1000, "folder": str(snapshot.folder),
        }  # fmt: skip
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
        times += _times(lambda: pool.run(ASK), 1)
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
        begun = time.perf_counter()
        pool.run(ASK)
        times.append(time.perf_counter() - begun - 0.15)
    _report("ASK after a kill (beyond the limit of 0.2 s)", times)


def _beside_writer(live: SemanticMap, pool: QueryPool) -> None:
    """30 commits a second, while one client asks as fast as it can."""
    written: dict[int, float] = {}
    stop = threading.Event()
    commits: list[float] = []

    def write() -> None:
        number = 1000
        while not stop.wait(1 / 30):
            begun = time.perf_counter()
            number += 1
            _write(live, number)
            commits.append(time.perf_counter() - begun)
            written[live.sequence] = time.monotonic()

    writer = threading.Thread(target=write)
    writer.start()
    times, lags = [], []
    until = time.monotonic() + 8
    while time.monotonic() < until:
        begun = time.perf_counter()
        answer = pool.run(ASK)
        times.append(time.perf_counter() - begun)
        if (missing := written.get(answer.sequence + 1)) is not None:
            lags.append(time.monotonic() - missing)
        time.sleep(0.002)
    stop.set()
    writer.join()
    _report("ASK beside a writer at 30 Hz", times)
    _report("commit meanwhile", commits)
    _report("answer behind the map", lags)


def _run_away(pool: QueryPool, timeout: float | None = None) -> None:
    try:
        pool.run(RUNAWAY, timeout=timeout)
    except (QueryTimeoutError, QueryTooLargeError):
        return
    raise AssertionError("the runaway query ended by itself; make it bigger")


def _times(act: Callable[[], object], count: int) -> list[float]:
    times = []
    for _ in range(count):
        begun = time.perf_counter()
        act()
        times.append(time.perf_counter() - begun)
    return times


def _report(what: str, seconds: list[float]) -> None:
    p50, p99 = np.percentile(seconds, [50, 99]) * 1000
    row = f"{what:46} n {len(seconds):5}  p50 {p50:8.2f}  p99 {p99:8.2f}"
    sys.stdout.write(f"{row}  max {max(seconds) * 1000:8.2f} ms\n")


def _write(live: SemanticMap, number: int) -> None:
    at = NamedNode(v.HERE + "x")
    thing = NamedNode(f"{live.base}object/{number % 20}")
    live.store.commit([], [Quad(thing, at, Literal(number / 7), v.MAP_GRAPH)], Cause("update"))


def _objects(count: int) -> Iterator[Quad]:
    """Objects of 15 triples."""
    kinds = [NamedNode(v.HERE + name) for name in ("Chair", "Cup", "Book", "Laptop")]
    generator = np.random.default_rng(1)
    for number in range(count):
        thing = NamedNode(f"urn:object:{number}")
        yield Quad(thing, v.RDF_TYPE, kinds[number % len(kinds)], v.MAP_GRAPH)
        for name, value in zip("xyzabcdefghijk", generator.random(14), strict=True):
            yield Quad(thing, NamedNode(v.HERE + name), Literal(float(value)), v.MAP_GRAPH)


if __name__ == "__main__":
    main()
