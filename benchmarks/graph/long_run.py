"""A long drive over a building that stays as large as it is: what grows from its start to its end.

    python -m benchmarks.graph.long_run [FRAMES] [OBJECTS] [--keep SECONDS] [--folder DIR]

60,000 frames (33 minutes at 30 Hz) over 1,000 objects, 20 of which change a frame, as fast as it
goes. A row for each tenth: median processor time of an update and of a lookup (the writer's thread
alone, so that other programs do not count), memory, and the folder on disk, store and history
apart. The last line is the last tenth over the first.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.graph.loading import furnished
from benchmarks.graph.ours import FLAT, asking, on_disk, parameters_for, resident
from kg.history.storage.recovery import FILE
from kg.maps.query.query_files import find_query
from kg.store.process_memory import gc_frozen

COLUMNS = ("frames", "update [ms]", "lookup [ms]", "memory [MB]", "store [MB]", "history [MB]")


def main() -> None:
    """Drive, and print a row for each tenth."""
    parser = argparse.ArgumentParser()
    parser.add_argument("frames", type=int, nargs="?", default=60_000)
    parser.add_argument("objects", type=int, nargs="?", default=1000)
    parser.add_argument("--keep", type=float)
    parser.add_argument("--folder", type=Path)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=given.folder) as folder:
        drive(Path(folder) / "long.map", given.frames, given.objects, given.keep)


def drive(path: Path, frames: int, objects: int, keep: float | None) -> None:
    """Write all frames; tell of each tenth."""
    semantic_map, building = furnished(path, objects)
    question = find_query(FLAT)
    ask = asking(semantic_map, question, parameters_for(question, building) or {})
    row("|".join(f" {name} " for name in COLUMNS))
    row("|".join(["---"] * len(COLUMNS)))
    tenths = []
    with semantic_map, gc_frozen():
        if keep is not None:
            semantic_map.history.retain(keep)
        for tenth in range(1, 11):
            some = []
            for number in range(frames * (tenth - 1) // 10, frames * tenth // 10):
                update = building.frame(number)
                start = time.thread_time()
                semantic_map.apply(update)
                middle = time.thread_time()
                if number % 20 == 0:
                    ask()
                    took = 1e3 * (middle - start), 1e3 * (time.thread_time() - middle)
                    some.append((*took, *sizes(path)))
            tenths.append(np.median(some, axis=0))
            tell(f"{frames * tenth // 10:,}", tenths[-1])
    tell("last / first", tenths[-1] / tenths[0], 2)


def sizes(path: Path) -> tuple[float, float, float]:
    """Megabytes: of memory, of the store, of the history with its journal."""
    history = sum(file.stat().st_size for file in path.glob(f"{FILE}*"))
    return resident() / 1e6, on_disk(path / "store") / 1e6, history / 1e6


def tell(name: str, values: np.ndarray, digits: int = 1) -> None:
    """A row of the table."""
    row("|".join([f" {name} ", *(f" {value:.{digits}f} " for value in values)]))


def row(cells: str) -> None:
    """A line, at once."""
    sys.stdout.write(f"|{cells}|\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
