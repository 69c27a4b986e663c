"""What positions to look from see of real homes, and how fast shortest ways between them are.

    python -m benchmarks.viewpoints [--homes DIR]

For the thesis' building (its Fig. 4.7), and each home of DIR: its floor, how many positions cover
its rooms with whole turns of the 0.8 to 4.6 m camera, how much of a room they see, and how much a
turn in its middle does (means over rooms). Then seconds of one core: to choose the positions, and
for the shortest ways from each of them to all of the floor, beside Dijkstra's algorithm in Python
over the very same steps (extrapolated from two positions; lengths must agree).
"""

from __future__ import annotations

import argparse
import heapq
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from planner.reference_world import reference_world
from planner.space.building import free_space, shifts
from planner.space.geodesic import distance_fields
from planner.space.grid import FreeSpace, Room
from planner.space.sight import visible
from planner.space.sweep import FAR, UNIT, StepCosts
from planner.trials.homes import read_homes
from planner.viewing.covers import room_covers
from planner.viewing.sensor import Sensor

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
    """How much of a room whole turns from `cells` see."""
    seen: set[int] = set()
    for cell in cells:
        there, offset = visible(space, int(cell), SENSOR.far)
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


def dijkstra(costs: StepCosts, source: int) -> NDArray[np.int64]:
    """Cost of the cheapest way from `source` to each cell."""
    field = np.full(costs.passable.size, FAR, np.int64)
    field[source] = 0
    queue = [(0, source)]
    while queue:
        so_far, cell = heapq.heappop(queue)
        if so_far > field[cell]:
            continue
        for there, cost in costs.neighbours(cell):
            if so_far + cost < field[there]:
                field[there] = so_far + cost
                heapq.heappush(queue, (so_far + cost, there))
    return field


def ways_timed(space: FreeSpace, stands: NDArray[np.intp]) -> tuple[float, float]:
    """[s] for all shortest ways from `stands`: swept, and one by one."""
    begun = time.process_time()
    fields = distance_fields(space, stands).reshape(len(stands), -1)
    swept = time.process_time() - begun
    links = tuple((p.a, p.b, max(round(p.metres / space.cell * UNIT), 1)) for p in space.passages)
    costs = StepCosts.over(space.free, np.zeros(space.shape, np.int32), links)
    begun = time.process_time()
    for k in (0, len(stands) // 2):
        one = dijkstra(costs, int(stands[k]))
        metres = np.where(one >= FAR, np.inf, one * (space.cell / UNIT))
        np.testing.assert_allclose(metres, fields[k], rtol=1e-6)
    return swept, (time.process_time() - begun) * len(stands) / 2


def row(name: str, rooms: list[Room], doors: _Pairs | None) -> list[str]:
    """One line of the table."""
    space = free_space(rooms, doors)
    begun = time.process_time()
    covers = room_covers(space, SENSOR.far, near=SENSOR.near)
    chosen = time.process_time() - begun
    stands = np.array(sorted({int(c) for cells in covers.values() for c in cells}), np.intp)
    seen = [share_seen(space, room, cells) for room, cells in covers.items()]
    turns = [share_seen(space, room, c) for room, c in middles(space, rooms).items()]
    swept, one_by_one = ways_timed(space, stands)
    floor = len(space.floor()) * space.cell**2
    numbers = [f"{floor:.0f}", str(len(stands)), f"{np.mean(seen):.3f}", f"{np.mean(turns):.2f}"]
    return [name, *numbers, f"{chosen:.2f}", f"{swept:.3f}", f"{one_by_one / swept:.0f}"]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--homes", type=Path, metavar="DIR", help="a folder of homes")
    head = ["building", "floor m2", "positions", "seen", "by turns in the middle", "s to choose"]
    head += ["s for ways", "Dijkstra / ours"]
    sys.stdout.write(f"| {' | '.join(head)} |\n|{' --- |' * len(head)}\n")
    for name, rooms, doors in layouts(parser.parse_args().homes):
        sys.stdout.write(f"| {' | '.join(row(name, rooms, doors))} |\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
