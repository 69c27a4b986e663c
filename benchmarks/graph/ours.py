"""The graph on disk: frame updates, every shipped question, export; live, and over a long run."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.graph.building import BASE, Building
from benchmarks.graph.timing import Timing, goes_on, measured, timing
from kg.export.serialization import export_map
from kg.maps.query.query_files import ParameterizedQuery, shipped_queries
from kg.maps.semantic_map import SemanticMap
from kg.model.platforms import gc_frozen
from kg.model.records import MapUpdate

STORE = "hereabouts on disk"
LOOKUPS = tuple(q.name for q in shipped_queries() if q.answer == "lookup")
FLAT = "objects-within-radius"  # asked now and then in a long run
WARM = 1.0  # [s] of live writing that does not count
MAX_EXPORT = 10_000  # objects; an export is made whole in memory


def measure(semantic_map: SemanticMap, building: Building, folder: Path) -> Iterator[Timing]:
    """All operations on a furnished map."""
    yield update_timing(semantic_map, building)
    for question in shipped_queries():
        values = parameters_for(question, building)
        if values is not None:
            yield measured(
                question.name, STORE, building.size, asking(semantic_map, question, values)
            )
    if building.size <= MAX_EXPORT:
        out = folder / "export.nt"
        export = _silent(lambda: export_map(semantic_map, out, ontology=False))
        yield measured("export as N-Triples", STORE, building.size, export)


def update_timing(semantic_map: SemanticMap, building: Building) -> Timing:
    """A frame's update of 20 objects; what the frame says is made up outside of the clock."""
    durations: list[float] = []
    while goes_on(durations):
        number = len(durations)
        update = building.frame(number)
        start = time.process_time()
        semantic_map.apply(update)
        durations.append(1000 * (time.process_time() - start))
    return timing("update by a frame", STORE, building.size, durations)


def parameters_for(question: ParameterizedQuery, building: Building) -> dict[str, object] | None:
    """Values that ask `question` of something that is there; None for parameters unheard of."""
    x, y = building.centre()
    known: dict[str, object] = {
        "category": "banana",
        "place": 1,
        "object": f"{BASE}object/1",
        "one": f"{BASE}object/1",
        "other": f"{BASE}object/40",
        "x": x,
        "y": y,
        "xmin": x - 2,
        "xmax": x + 2,
        "ymin": y - 2,
        "ymax": y + 2,
    }
    needed = [p.name for p in question.parameters if p.default is None]
    return {name: known[name] for name in needed} if known.keys() >= set(needed) else None


def asking(
    semantic_map: SemanticMap, question: ParameterizedQuery, values: dict[str, Any]
) -> Callable[[], int]:
    """A run of a question, that tells how many rows it got."""
    return lambda: len(semantic_map.query(question.name, **values).rows)


@dataclass(frozen=True, slots=True)
class LiveRun:
    """A writer at a fixed rate, readers beside it."""

    frames: int
    late: int  # frames not done when the next one was due
    update: Timing
    reads: int
    read: Timing

    def to_json(self) -> dict[str, object]:
        """As a JSON object."""
        return {
            "frames": self.frames,
            "late": self.late,
            "update": self.update.to_json(),
            "reads": self.reads,
            "read": self.read.to_json(),
        }


def live(
    semantic_map: SemanticMap,
    building: Building,
    frame: Callable[[int], MapUpdate],
    how: str,
    *,
    seconds: float,
    rate: float = 30.0,
) -> LiveRun:
    """Write `rate` frames a second while two readers ask lookups as fast as they can.

    `frame` makes the update of that number, `how` says of what robot. The first second warms up.
    """
    stop = threading.Event()
    reads: list[float] = []
    readers = [
        threading.Thread(target=_read, args=(semantic_map, building, stop, reads)) for _ in (1, 2)
    ]
    updates = [frame(number) for number in range(int((WARM + seconds) * rate))]
    warm = int(WARM * rate)
    with gc_frozen():
        for reader in readers:
            reader.start()
        durations, late, due = [], 0, time.perf_counter()
        for number, update in enumerate(updates):
            time.sleep(max(0.0, due - time.perf_counter()))
            start = time.perf_counter()
            semantic_map.apply(update)
            done = time.perf_counter()
            due += 1 / rate
            if number >= warm:
                durations.append(1000 * (done - start))
                late += done > due
    stop.set()
    for reader in readers:
        reader.join()
    written = timing(f"update, 30 a second, 2 readers, {how}", STORE, building.size, durations)
    read = timing(f"lookup beside that writer, {how}", STORE, building.size, reads)
    return LiveRun(len(durations), late, written, len(reads), read)


def _read(
    semantic_map: SemanticMap, building: Building, stop: threading.Event, reads: list[float]
) -> None:
    questions = [q for q in shipped_queries() if q.name in LOOKUPS]
    runs = [asking(semantic_map, q, parameters_for(q, building) or {}) for q in questions]
    number = 0
    while not stop.is_set() or not reads:
        start = time.perf_counter()
        runs[number % len(runs)]()
        reads.append(1000 * (time.perf_counter() - start))
        number += 1


@dataclass(frozen=True, slots=True)
class Flatness:
    """The last tenth of a long run over the first tenth of it; 1 is flat."""

    frames: int
    update: float  # of the median latency
    lookup: float  # of the median latency
    memory: float  # of the resident set
    disk: float  # of the folder


def flatness(
    semantic_map: SemanticMap, building: Building, folder: Path, *, frames: int
) -> Flatness:
    """Apply `frames` frames, one after the other, over a map that stays as large as it is."""
    question = next(q for q in shipped_queries() if q.name == FLAT)
    ask = asking(semantic_map, question, parameters_for(question, building) or {})
    rows = []
    for number in range(frames):
        update = building.frame(number)
        start = time.perf_counter()
        semantic_map.apply(update)
        middle = time.perf_counter()
        if number % 10 == 0:
            ask()
            lookup = time.perf_counter() - middle
            rows.append((middle - start, lookup, resident(), on_disk(folder)))
    table = np.array(rows)
    tenth = max(1, len(table) // 10)
    first, last = np.median(table[:tenth], axis=0), np.median(table[-tenth:], axis=0)
    return Flatness(frames, *(float(ratio) for ratio in last / first))


def resident() -> float:
    """Resident memory of this process [bytes]; 1 where the system does not report it."""
    status = Path("/proc/self/statm")
    return 4096.0 * float(status.read_text().split()[1]) if status.exists() else 1.0


def on_disk(folder: Path) -> float:
    """Size of the files in a folder [bytes]."""
    total = 1
    for path in folder.rglob("*"):
        try:
            total += path.stat().st_size
        except FileNotFoundError:  # compacted away meanwhile
            continue
    return float(total)


def _silent(run: Callable[[], object]) -> Callable[[], None]:
    return lambda: (run(), None)[1]
