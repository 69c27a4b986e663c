"""A day of mapping at two frames a second: what grows in memory, on disk and in the map.

    python -m benchmarks.day [--frames 172800] [--map FOLDER] [--json]

A simulated robot drives through a furnished house without rest. Each lap shows the house in one of
several states: small things lie elsewhere or are gone, and persons stand here and there. Pictures,
depth with noise and detections with errors are made once for each pose and state, and each lap
takes another draw of detections, so that a frame costs what its mapping costs. Stamps are those of
a real day. After a quarter of the frames `compact` drops the older half of the history, and a line
tells what it gives back. A shorter run, or one that Ctrl+C ends, ends with a row that goes on
straight from its rows.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.graph.ours import on_disk, resident
from hereabouts.cli.console import note, print_table, write_json
from hereabouts.cli.live import until_signal
from kg.maps.semantic_map import SemanticMap
from kg.serving.opening import create_map
from lab.command_line import parser_of
from lab.command_line import run as run_benchmark
from lab.houses.house_changes import changed_house
from mapping.mapper import Mapper
from mapping.mapping_options import MappingOptions
from perception.frames import Detections, Frame
from planner.simulation.camera import CameraModel, SimulatedCamera
from planner.simulation.house import FloorGrid, House, Item, SolidPart, furnished_house
from planner.simulation.house_robot import START, SimulatedTour
from planner.simulation.sensors import SimulatedDetector

RATE: Final = 2.0  # frames a second
HOUR: Final = round(3600 * RATE)  # frames
DAY: Final = 24 * HOUR
ROWS: Final = (0.25, 1.0, 2.0, 6.0, 12.0, 24.0)  # [h]
STATES: Final = 6  # of the house
DRAWS: Final = 4  # of the detections of a view
PERSONS: Final = 2  # in each state
IRIS: Final = "SELECT (COUNT(DISTINCT ?thing) AS ?n) WHERE { ?thing a ?kind }"


class _Person(Item):
    """A person, who stands."""

    @property
    def parts(self) -> tuple[SolidPart, ...]:
        """Legs and body, and a head."""
        body = SolidPart(0, 0, 0, 0.42, 0.28, 1.45, (0.25, 0.3, 0.55))
        return body, SolidPart(0, 0, 1.45, 0.2, 0.2, 0.27, (0.85, 0.68, 0.55), "ellipsoid")


_View = tuple[Frame, tuple[Detections, ...]]


@dataclass(frozen=True, slots=True)
class Row:
    """The run at one moment."""

    hours: float
    frames: int
    ms: float  # of the clock a frame, over the frames since the row before
    cpu: float  # [ms] of a core, the same
    memory: float  # [MB] of the process, views included
    store: float  # [MB] on disk
    history: float  # [MB]
    beside: float  # [MB] surface, pictures, views and the mapper's own files
    objects: int
    iris: int  # things of any kind in the graph
    issued: int  # numbers of objects that were given so far


def house_states(rng: np.random.Generator) -> Iterator[House]:
    """The furnished house, and the same with things elsewhere and with persons."""
    house = furnished_house()
    named = [replace(item, name=f"{item.label}-{n}") for n, item in enumerate(house.objects)]
    house = replace(house, objects=tuple(named))
    grid = FloorGrid(house)
    free = grid.centres(grid.clearance > 0.6)
    for _ in range(STATES):
        changed = changed_house(house, rng).house
        spots = free[rng.choice(len(free), PERSONS, replace=False)]
        persons = [_Person("person", float(x), float(y), name=f"person-{x}") for x, y in spots]
        yield replace(changed, rooms=house.rooms).with_objects(persons)


def views(rng: np.random.Generator) -> list[list[_View]]:
    """Frames of a lap with their detections, of each state of the house."""
    model, laps = CameraModel(width=160, height=120, focal=140.0), []
    poses = SimulatedTour(SimulatedCamera(furnished_house(), model)).poses
    for number, house in enumerate(house_states(rng)):
        camera = SimulatedCamera(house, model, seed=number)
        detector, lap = SimulatedDetector(camera), []
        for frame in SimulatedTour(camera, poses=poses).frames():
            draws = tuple(
                detector.detect(replace(frame, id=f"{frame.id}/{d}")) for d in range(DRAWS)
            )
            lap.append((frame, draws))
        laps.append(lap)
    return laps


def frames_of(
    laps: list[list[_View]], rng: np.random.Generator
) -> Iterator[tuple[Frame, Detections]]:
    """Frames without end, each with a stamp and a name of its own."""
    number = 0
    while True:
        lap = laps[int(rng.integers(len(laps)))]
        for frame, draws in lap:
            named = replace(frame, id=f"day-{number:06d}", stamp=START + number / RATE)
            yield named, draws[int(rng.integers(len(draws)))]
            number += 1


def row(semantic_map: SemanticMap, mapper: Mapper, frames: int, ms: float, cpu: float) -> Row:
    """What there is now."""
    folder = semantic_map.store.path
    assert folder is not None
    total, store = on_disk(folder) / 1e6, on_disk(folder / "store") / 1e6
    history = sum(path.stat().st_size for path in folder.glob("history.sqlite*")) / 1e6
    new = semantic_map.new_object_iri()
    return Row(
        frames / HOUR,
        frames,
        ms,
        cpu,
        resident() / 1e6,
        store,
        history,
        total - store - history,
        mapper.believed(),
        int(semantic_map.query(IRIS).rows[0][0]),
        int(new.rpartition("/")[2]),
    )


def day(semantic_map: SemanticMap, count: int) -> Iterator[Row]:
    """Map `count` frames; a row at each of ROWS, and at the end."""
    rng = np.random.default_rng(7)
    source = frames_of(views(rng), rng)
    shown = {round(hours * HOUR) for hours in ROWS} | {count}
    started = began = time.perf_counter()
    spent, since = time.process_time(), 0
    options = MappingOptions(find_places=True)
    with until_signal() as ended, Mapper(semantic_map, options, recording="day") as mapper:
        for done in range(1, count + 1):
            mapper.add(*next(source))
            if done in shown or ended.is_set():
                now, cpu, some = time.perf_counter(), time.process_time(), (done - since) / 1000
                yield row(semantic_map, mapper, done, (now - began) / some, (cpu - spent) / some)
                began, spent, since = time.perf_counter(), time.process_time(), done
            if ended.is_set():
                return
            if done == count // 4:
                _compact(semantic_map, time.perf_counter() - started)


def _compact(semantic_map: SemanticMap, seconds: float) -> None:
    start = time.perf_counter()
    done = semantic_map.history.compact(seconds / 2)
    before, after = (size / 1e6 for size in (done.bytes_before, done.bytes_after))
    took = time.perf_counter() - start
    note(
        f"compact drops {done.dropped} transactions: {before:.1f} to {after:.1f} MB in {took:.1f} s"
    )


def whole_day(rows: Sequence[Row]) -> Row:
    """A row of 24 h that goes on straight, and at the same pace, from the first and the last row.

    History grows as it grew fastest, since `compact` made it smaller once.
    """
    first, last = rows[0], rows[-1]
    left = DAY - last.frames
    ends = {
        name: type(b)(b + left * (b - a) / (last.frames - first.frames))
        for name in (f.name for f in fields(Row))
        for a, b in [(getattr(first, name), getattr(last, name))]
    }
    rates = [(b.history - a.history) / (b.frames - a.frames) for a, b in pairwise(rows)]
    history = last.history + left * max(rates)
    return Row(**ends | {"ms": last.ms, "cpu": last.cpu, "history": history})


def run(arguments: argparse.Namespace) -> int:
    """Map, and print the table."""
    with tempfile.TemporaryDirectory(prefix="hereabouts-day-") as folder:
        path = Path(arguments.map or Path(folder) / "day.map")
        with create_map(path) as semantic_map:
            rows = []
            for one in day(semantic_map, arguments.frames):
                rows.append(one)
                note(str(one))
    if rows[-1].frames < DAY and len(rows) > 1:
        rows.append(whole_day(rows))
    if arguments.json:
        write_json([{f.name: getattr(one, f.name) for f in fields(Row)} for one in rows])
        return 0
    names = [f.name for f in fields(Row)]
    table = [[getattr(one, name) for name in names] for one in rows]
    print_table(
        names, [[f"{v:.1f}" if isinstance(v, float) else v for v in line] for line in table]
    )
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    parser = parser_of("benchmarks.day", __doc__)
    parser.add_argument("--frames", type=int, default=DAY)
    parser.add_argument("--map", help="keep the map in this folder")
    parser.add_argument("--json", action="store_true")
    return run_benchmark(parser, run, argv)


if __name__ == "__main__":
    sys.exit(main())
