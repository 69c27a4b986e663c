"""How well rooms are found.

    python -m benchmarks.room_segmentation [--mapped DIR ...] [--homes DIR]

Prints Markdown rows: simulated houses with their true floor; maps of simulated houses (each DIR
holds what `hereabouts simulate house --seed N -o DIR` wrote, N in its name, and DIR.map its map by
`hereabouts map DIR --into DIR.map --transform DIR/transform.json`); and real homes, whose floor is
drawn from their rooms' boxes and doors (benchmarks/search/homes.py), without furniture.

Recall and precision are those of Bormann et al. (ICRA 2016), means over rooms: the largest share of
a true room's area that one found room has, which over-segmentation lowers; and the largest share
of a found room's area in one true room, which under-segmentation lowers. A room is found where the
intersection over union is above 0.5.
"""

from __future__ import annotations

import argparse
import re
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.search.homes import read_homes
from kg.model.records import FREE, LOW, TALL, UNKNOWN
from kg.serving.opening import open_map
from lab.command_line import run
from lab.houses.random_house import random_house
from mapping.occupancy.mapped_floor import MappedFloor, mapped_floor
from mapping.occupancy.room_segmentation import segmented
from planner.freespace.floor_plan import free_space
from planner.freespace.grid import NO_ROOM
from planner.simulation.houses.house import House, Solid

HEADER: Final = (
    "| floors | true rooms | found | recall | precision | found right | ms a floor |\n"
    "|---|---|---|---|---|---|---|"
)
_CELL: Final = 0.05  # [m]
_MARGIN: Final = 0.3  # [m] around a house
_EYE, _TOP, _LOWEST = 1.1, 1.8, 0.05  # [m] heights as in mapping.occupancy

Labels = NDArray[np.int64]


@dataclass(slots=True)
class Tally:
    """Scores of several floors."""

    recall: list[float] = field(default_factory=list)
    precision: list[float] = field(default_factory=list)
    right: list[bool] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)

    def add(self, floor: MappedFloor, truth: Labels) -> None:
        """Segment `floor`, and compare with the true room of each cell (nx, ny), or -1."""
        begun = time.perf_counter()
        found = segmented(floor)
        self.seconds.append(time.perf_counter() - begun)
        factor = round(found.cell / floor.resolution)
        fine = np.kron(found.rooms, np.ones((factor, factor), np.int32))
        fine = fine[: truth.shape[0], : truth.shape[1]]
        known = np.isin(floor.states, (FREE, LOW)) & (truth >= 0)
        shared = np.zeros((len(found), int(truth.max()) + 1))
        both = known & (fine >= 0)
        np.add.at(shared, (fine[both], truth[both]), 1)
        of_truth = np.bincount(truth[known], minlength=shared.shape[1])
        of_found = shared.sum(axis=1)
        overlap = shared / np.maximum(of_found[:, None] + of_truth - shared, 1)
        there = of_truth > 0
        self.recall += (shared.max(axis=0, initial=0) / np.maximum(of_truth, 1))[there].tolist()
        self.precision += (shared.max(axis=1) / np.maximum(of_found, 1))[of_found > 0].tolist()
        self.right += (overlap.max(axis=0, initial=0) > 0.5)[there].tolist()

    def row(self, name: str) -> str:
        """A row of the table."""
        shares = (f"{np.mean(v):.3f}" for v in (self.recall, self.precision, self.right))
        milliseconds = 1000 * float(np.median(self.seconds))
        counts = f"{len(self.right)} | {len(self.precision)}"
        return f"| {name} | {counts} | {' | '.join(shares)} | {milliseconds:.0f} |"


def true_floor(house: House) -> MappedFloor:
    """The floor of a house as a perfect sensor would map it, in cells of 0.05 m."""
    xmin, xmax, ymin, ymax = house.extent
    origin = np.array([xmin, ymin]) - _MARGIN
    nx, ny = (round((side + 2 * _MARGIN) / _CELL) for side in (xmax - xmin, ymax - ymin))
    floor = MappedFloor(origin, _CELL, np.full((nx, ny), UNKNOWN, np.uint8))
    states = floor.states
    states[true_rooms(house, floor) >= 0] = FREE
    items = [solid for item in (*house.objects, *house.furnishings) for solid in item.solids()]
    for solid in (*items, *(solid for wall in house.walls for solid in wall.solids())):
        if solid.lo[2] < _TOP and solid.hi[2] > _LOWEST:
            part = states[_covered(solid, floor)]
            np.maximum(part, TALL if solid.hi[2] > _EYE else LOW, out=part)
    return floor


def _covered(solid: Solid, floor: MappedFloor) -> tuple[slice, slice]:
    first = np.rint((solid.lo[:2] - floor.origin) / _CELL).astype(int).clip(0)
    last = np.rint((solid.hi[:2] - floor.origin) / _CELL).astype(int)
    return slice(first[0], last[0]), slice(first[1], last[1])


def true_rooms(house: House, floor: MappedFloor) -> Labels:
    """(nx, ny) the true room of each cell of `floor`, parts of one room alike; -1 outside."""
    x, y = (
        low + (np.arange(n) + 0.5) * floor.resolution
        for low, n in zip(floor.origin, floor.states.shape, strict=True)
    )
    names = sorted({room.part_of or room.name for room in house.rooms})
    labels = np.full(floor.states.shape, -1, np.int64)
    for room in house.rooms:
        across, along = (x >= room.xmin) & (x < room.xmax), (y >= room.ymin) & (y < room.ymax)
        labels[np.ix_(across, along)] = names.index(room.part_of or room.name)
    return labels


def _home_floors(folder: Path) -> Iterator[tuple[MappedFloor, Labels]]:
    """The floor of each home's rooms, one cell of wall between them, doors cut."""
    for home in read_homes(folder):
        space = free_space([room.floor for room in home.rooms], home.doors, cell=2 * _CELL)
        labels = np.where(space.room == NO_ROOM, -1, space.room).astype(np.int64)
        states = np.where(labels < 0, TALL, FREE).astype(np.uint8)
        yield MappedFloor(space.origin, space.cell, states), labels


def _mapped(folder: Path) -> tuple[MappedFloor, Labels]:
    seed = int(re.findall(r"\d+", folder.name)[-1])
    with open_map(str(folder) + ".map", read_only=True) as semantic_map:
        floor = mapped_floor(semantic_map.floor())
    assert floor is not None, f"{folder}.map has no floor"
    return floor, true_rooms(random_house(seed), floor)


def _tally(floors: Iterable[tuple[MappedFloor, Labels]]) -> Tally:
    tally = Tally()
    for floor, truth in floors:
        tally.add(floor, truth)
    return tally


def _command(arguments: argparse.Namespace) -> int:
    write = sys.stdout.write
    write(HEADER + "\n")
    houses = [random_house(seed) for seed in range(1, arguments.houses + 1)]
    floors = [(floor, true_rooms(h, floor)) for h in houses for floor in (true_floor(h),)]
    write(_tally(floors).row(f"{len(houses)} simulated houses, true floor") + "\n")
    if arguments.mapped:
        maps = _tally(map(_mapped, arguments.mapped))
        write(maps.row(f"{len(arguments.mapped)} simulated houses, mapped") + "\n")
    if arguments.homes:
        write(
            _tally(_home_floors(arguments.homes)).row("real homes, drawn from their boxes") + "\n"
        )
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(prog="benchmarks.room_segmentation", description=__doc__)
    parser.add_argument("--houses", type=int, default=50, help="simulated houses (default: 50)")
    parser.add_argument("--mapped", type=Path, nargs="*", default=(), metavar="DIR")
    parser.add_argument("--homes", type=Path, metavar="DIR")
    return run(parser, _command, argv)


if __name__ == "__main__":
    sys.exit(main())
