"""A writer that forgets: pages of the history, and time an update takes, with and without a bound.

    python -m benchmarks.retention [SECONDS]

200 objects, 20 of which change a frame, 2,500 frames; once with all of the past kept, once with the
last SECONDS (5).
"""

from __future__ import annotations

import random
import statistics
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.records import Evidence, MapUpdate, ObjectRecord
from kg.serving.opening import create_map

OBJECTS = 200
SEEN = 20  # objects a frame
FRAMES = 2500
TOLD_EVERY = 500


def main() -> None:
    """Measure both, side by side."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 5.0
    sys.stdout.write(
        "| kept | frames | pages | transactions | update, median [ms] |\n" + "|---" * 5 + "|\n"
    )
    for keep in (None, seconds):
        with tempfile.TemporaryDirectory() as folder:
            measure(Path(folder) / "flat.map", keep)


def measure(path: Path, keep: float | None) -> None:
    """Write all frames, and print a row every `TOLD_EVERY` of them."""
    luck, took = random.Random(1), []
    with create_map(path) as semantic_map:
        if keep is not None:
            semantic_map.history.retain(keep)
        for frame in range(1, FRAMES + 1):
            seen = ((frame * SEEN + k) % OBJECTS + 1 for k in range(SEEN))
            update = MapUpdate(objects=tuple(thing(semantic_map, n, frame, luck) for n in seen))
            started = time.perf_counter()
            semantic_map.apply(update)
            took.append(1e3 * (time.perf_counter() - started))
            if frame % TOLD_EVERY == 0:
                tell(semantic_map, keep, frame, took)
                took.clear()


def tell(semantic_map: SemanticMap, keep: float | None, frame: int, took: list[float]) -> None:
    """A row of the table."""
    db = semantic_map.history.log.db
    (pages,) = db.execute("PRAGMA page_count").fetchone()
    (commits,) = db.execute("SELECT count(*) FROM commits").fetchone()
    kept = "all" if keep is None else f"{keep:g} s"
    median = statistics.median(took)
    sys.stdout.write(f"| {kept} | {frame} | {pages} | {commits} | {median:.1f} |\n")


def thing(semantic_map: SemanticMap, number: int, frame: int, luck: random.Random) -> ObjectRecord:
    """An object as seen in a frame, a little off."""
    box = (1.0, 2.0, 3.0 + frame % 50, 4.0)
    name = f"frame-{frame:06d}"
    return ObjectRecord(
        iri=f"{semantic_map.base}object/{number}",
        category=v.HERE + "Cup",
        p_map=np.array([number % 20 + 0.2 * luck.random(), number // 20, 0.5]),
        confidence=2.0,
        existence=0.8,
        observations=frame,
        first_seen=1e9,
        last_seen=1e9 + frame,
        place=None,
        evidence=Evidence(name, "flat", 1e9 + frame, box, 0.5 + 0.4 * luck.random(), "model"),
    )


if __name__ == "__main__":
    main()
