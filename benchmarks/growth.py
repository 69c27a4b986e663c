"""Growth of the cost of a map: with its objects, and with the frames of its history.

    python -m benchmarks.growth [--large] [--json]

Each row is a map of its own, measured in a process of its own: seconds of processor time of one
frame's update, of the query `objects`, of the number of cups, of `find` and `status` of one kind of
thing, of the state that pages draw, and of opening; the memory of the process after all of them;
the folder on disk. Each column has the work that it has to do: that of a frame, which is always the
same; of all objects; or of all frames. The last lines compare both: "grows" is how many times the
larger map costs the smaller one, "work" how many times it has to do; a column that grows faster
than its work is named, and the exit code is 1.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.graph.building import Building
from benchmarks.graph.loading import furnished
from benchmarks.graph.ours import on_disk, resident
from hereabouts.cli import main as hereabouts
from hereabouts.cli.arguments import declare
from hereabouts.cli.console import note, print_table, write_json
from kg.history.map_state import Categories, present_state
from kg.maps.semantic_map import SemanticMap
from kg.serving.opening import open_map
from lab import command_line
from planner.search.goals.status import status

SIZES: Final = (1000, 10_000)  # objects
LARGE: Final = 100_000
FRAMES: Final = (100, 1000)  # of a history, over a map of `FEW` objects
FEW: Final = 100  # objects
APPLIED: Final = 30  # frames that are measured
MAX_FIND: Final = 10_000  # objects up to which a search is planned
WANTED: Final = "cup"
SLACK: Final = 1.3  # times its work that a column may grow, for what the machine does meanwhile
COUNT: Final = "SELECT (COUNT(*) AS ?n) WHERE {{ ?object a <{}> }}"

#: column -> whether its work grows with the objects, and whether it grows with the frames
COLUMNS: Final = {
    "apply": (False, False),
    "query": (True, False),
    "class count": (True, False),
    "find": (True, False),
    "status": (True, False),
    "page's state": (True, False),
    "opening": (False, False),
    "memory": (True, False),
    "disk": (True, True),
}


@dataclass(frozen=True, slots=True)
class Row:
    """Costs of one map: [s] of processor time, and [MB] of memory and disk."""

    objects: int
    frames: int
    costs: dict[str, float]

    def cells(self) -> tuple[object, ...]:
        """Objects, frames, then a cell for each column."""
        costs = (self.costs.get(name) for name in COLUMNS)
        shown = ("-" if cost is None else f"{cost:.3g}" for cost in costs)
        return (self.objects, self.frames, *shown)


@dataclass(frozen=True, slots=True)
class Growth:
    """The growth of a column from one row to another."""

    column: str
    of: str  # "objects" or "frames"
    grows: float  # times
    work: float  # times

    @property
    def too_fast(self) -> bool:
        """Whether it grows faster than its work."""
        return self.grows > SLACK * self.work


def cost(act: Callable[[], object], runs: int = 3) -> float:
    """Processor time [s] of a run, the least of several."""
    found = []
    for _ in range(runs):
        start = time.process_time()
        act()
        found.append(time.process_time() - start)
    return min(found)


def costs(path: Path, objects: int, frames: int) -> dict[str, float]:
    """Costs of the map at `path`, in a fresh process."""
    start = time.process_time()
    semantic_map = open_map(path)
    found = {"opening": time.process_time() - start}
    with semantic_map:
        building = Building(objects, semantic_map.catalogue, seed=frames)
        found["apply"] = applied(semantic_map, building, range(frames, frames + APPLIED))
        found |= reading(semantic_map)
    if objects <= MAX_FIND:
        with contextlib.redirect_stdout(io.StringIO()):
            found["find"] = cost(lambda: hereabouts(["find", str(path), WANTED, "--json"]), runs=1)
    return found | {"memory": resident() / 1e6, "disk": on_disk(path) / 1e6}


def reading(semantic_map: SemanticMap) -> dict[str, float]:
    """Costs of what only reads."""
    engine, categories = semantic_map.store.native, Categories.of(semantic_map.engine)
    page = partial(present_state, engine, categories, semantic_map.base)
    count = COUNT.format(semantic_map.catalogue.find(WANTED).iri)
    return {
        "query": cost(lambda: semantic_map.query("objects", least=0)),
        "class count": cost(lambda: semantic_map.query(count), runs=20),
        "status": cost(lambda: status(semantic_map, WANTED)),
        "page's state": cost(lambda: json.dumps(page())),
    }


def applied(semantic_map: SemanticMap, building: Building, numbers: range) -> float:
    """Processor time [s] of an update by a frame: the median of several."""
    updates = [building.frame(number) for number in numbers]
    return float(np.median([cost(lambda u=update: semantic_map.apply(u), 1) for update in updates]))  # type: ignore[misc]


def row(objects: int, frames: int) -> Row:
    """The costs of a new map, measured in a process of its own."""
    with tempfile.TemporaryDirectory(prefix="hereabouts-growth-") as folder:
        path = Path(folder) / "growth.map"
        semantic_map, building = furnished(path, objects)
        with semantic_map:
            for number in range(frames):
                semantic_map.apply(building.frame(number))
        this = [sys.executable, "-m", "benchmarks.growth", "--measure"]
        words = [*this, str(path), str(objects), str(frames)]
        answer = subprocess.run(words, check=True, stdout=subprocess.PIPE).stdout
    return Row(objects, frames, json.loads(answer))


def growths(rows: Sequence[Row]) -> Iterator[Growth]:
    """Of each column with the objects, and with the frames, from the smallest to the largest."""
    for kind, with_objects in (("objects", True), ("frames", False)):
        some = [one for one in rows if bool(one.frames) != with_objects]
        low, high = some[0], some[-1]
        times = getattr(high, kind) / getattr(low, kind)
        for column, (by_objects, by_frames) in COLUMNS.items():
            if column in low.costs and column in high.costs:
                grows = high.costs[column] / max(low.costs[column], 1e-9)
                work = times if (by_objects if with_objects else by_frames) else 1.0
                yield Growth(column, kind, grows, work)


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and print; 1 where a column grows faster than its work."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.growth", description=__doc__)
    parser.add_argument("--large", action="store_true", help=f"also {LARGE:,} objects, for minutes")
    parser.add_argument("--measure", nargs=3, metavar=("MAP", "OBJECTS", "FRAMES"), help="one map")
    declare(parser, "--json")
    return command_line.run(parser, run, argv)


def run(arguments: argparse.Namespace) -> int:
    """One map, or the whole table."""
    if arguments.measure:
        path, objects, frames = arguments.measure
        write_json(costs(Path(path), int(objects), int(frames)))
        return 0
    sizes = (*SIZES, LARGE) if arguments.large else SIZES
    rows = [
        *(row(objects, 0) for objects in sizes),
        *(row(FEW, frames) for frames in FRAMES),
    ]
    found = [*growths(rows)]
    if arguments.json:
        write_json([{"objects": r.objects, "frames": r.frames, **r.costs} for r in rows])
    else:
        units = (f"{name} [{'MB' if name in ('memory', 'disk') else 's'}]" for name in COLUMNS)
        print_table(("objects", "frames", *units), [one.cells() for one in rows])
        table = [(g.column, g.of, f"{g.grows:.1f}", f"{g.work:.0f}") for g in found]
        print_table(("column", "with", "grows", "work"), table)
    fast = [growth for growth in found if growth.too_fast]
    for growth in fast:
        note(f"{growth.column} grows faster than its work with the {growth.of}")
    return 1 if fast else 0


if __name__ == "__main__":
    sys.exit(main())
