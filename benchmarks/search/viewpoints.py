"""Coverage of real homes by viewpoints, and computing time of the shortest paths between them.

    python -m benchmarks.search.viewpoints [--homes DIR]

For the thesis' building (its Fig. 4.7), and each home of DIR: the area of its floor, the number of
viewpoints that cover its rooms with whole turns of the 0.8 to 4.6 m camera, the share of a room
that they see, and the share that a turn in its middle sees (means over rooms). Then seconds of one
core to choose the viewpoints, and for the shortest paths from each of them to the whole floor.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.search.homes import read_homes
from lab.thesis.table_4_5 import reference_world
from planner.freespace.floor_plan import free_space, shifts
from planner.freespace.geodesic import distance_fields
from planner.freespace.grid import FreeSpace, Room, visible_cells
from planner.search.viewpoints.candidate_views import Sensor, room_viewpoints

_Pairs = tuple[tuple[int, int], ...]
SENSOR = Sensor()


def layouts(homes: Path | None) -> Iterator[tuple[str, list[Room], _Pairs | None]]:
    """Name, rooms and doors of each building."""
    with reference_world() as world:
        places = world.places()
    yield "thesis", [Room(p.xmin, p.xmax, p.ymin, p.ymax) for p in places], None
    for home in read_homes(homes) if homes else ():
        yield home.name[:5], [room.floor for room in home.rooms], home.doors


def share_seen(space: FreeSpace, room: int, cells: NDArray[np.intp]) -> float:
    """Share of a room that whole turns from `cells` see."""
    seen: set[int] = set()
    for cell in cells:
        there, offset = visible_cells(space, int(cell), SENSOR.far)
        seen.update(there[(offset**2).sum(axis=1) >= SENSOR.near**2].tolist())
    return float(np.isin(space.floor(room), list(seen)).mean())


def middles(space: FreeSpace, rooms: list[Room]) -> dict[int, NDArray[np.intp]]:
    """The middle cell of each room that has floor."""
    moved = shifts(rooms)
    return {
        k: np.array(
            [space.nearest(((r.xmin + r.xmax) / 2 + dx, (r.ymin + r.ymax) / 2), k)], np.intp
        )
        for k, (r, dx) in enumerate(zip(rooms, moved, strict=True))
        if len(space.floor(k))
    }


def row(name: str, rooms: list[Room], doors: _Pairs | None) -> list[str]:
    """One line of the table."""
    space = free_space(rooms, doors)
    begun = time.process_time()
    covers = room_viewpoints(space, SENSOR.far, near=SENSOR.near)
    chosen = time.process_time() - begun
    viewpoints = np.array(sorted({int(c) for cells in covers.values() for c in cells}), np.intp)
    seen = [share_seen(space, room, cells) for room, cells in covers.items()]
    turns = [share_seen(space, room, c) for room, c in middles(space, rooms).items()]
    begun = time.process_time()
    distance_fields(space, viewpoints)
    swept = time.process_time() - begun
    floor = len(space.floor()) * space.cell**2
    numbers = [
        f"{floor:.0f}",
        str(len(viewpoints)),
        f"{np.mean(seen):.3f}",
        f"{np.mean(turns):.2f}",
    ]
    return [name, *numbers, f"{chosen:.2f}", f"{swept:.3f}"]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--homes", type=Path, metavar="DIR", help="a folder of homes")
    head = ["building", "floor m2", "positions", "seen", "by turns in the middle", "s to choose"]
    head += ["s for ways"]
    sys.stdout.write(f"| {' | '.join(head)} |\n|{' --- |' * len(head)}\n")
    for name, rooms, doors in layouts(parser.parse_args().homes):
        sys.stdout.write(f"| {' | '.join(row(name, rooms, doors))} |\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
