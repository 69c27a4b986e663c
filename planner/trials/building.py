"""A home made ready for searches: free space, covers of rooms, looks, shortest ways."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from planner.finding.ground import Ground
from planner.finding.hunt import with_fresh_stands
from planner.space.building import free_space, shifts
from planner.space.geodesic import distance_fields
from planner.space.grid import Cells, FreeSpace
from planner.trials.homes import Home
from planner.trials.robot import Robot
from planner.viewing.covers import room_covers
from planner.viewing.looks import Looks, candidate_looks
from planner.viewing.sensor import Motion, Sensor


class Building:
    """What all searches of one home have in common."""

    def __init__(self, home: Home, sensor: Sensor, motion: Motion) -> None:
        self.home, self.sensor, self.motion = home, sensor, motion
        floors = [room.floor for room in home.rooms]
        self.space: FreeSpace = free_space(floors, home.doors)
        moved = shifts(floors)
        self.middles: NDArray[np.float64] = np.array(  # (rooms, 2) [m]
            [
                ((f.xmin + f.xmax) / 2 + dx, (f.ymin + f.ymax) / 2)
                for f, dx in zip(floors, moved, strict=True)
            ]
        )
        self._fields: dict[int, NDArray[np.float32]] = {}
        self._fresh: dict[int, tuple[Looks, Looks]] = {}  # by the old ones' id, which are kept

    @cached_property
    def covers(self) -> dict[int, Cells]:
        """For each room with floor, the positions that cover it with whole turns."""
        found = room_covers(self.space, self.sensor.far, near=self.sensor.near)
        stands = sorted({int(cell) for cells in found.values() for cell in cells})
        fields = distance_fields(self.space, stands)
        self._fields.update(zip(stands, fields, strict=True))
        return found

    @cached_property
    def looks(self) -> Looks:
        """The looks to choose from."""
        return candidate_looks(self.space, self.sensor, self.motion)

    @cached_property
    def whole_turns(self) -> Looks:
        """The whole turns among `looks`."""
        looks = self.looks
        turns = np.flatnonzero(looks.extent >= 2 * np.pi - 1e-9)
        return replace(
            looks,
            stand=looks.stand[turns],
            heading=looks.heading[turns],
            extent=looks.extent[turns],
            seconds=looks.seconds[turns],
            chance=looks.chance[turns],
        )

    def fresh(self, ground: Ground, looks: Looks, weight: NDArray[np.float64]) -> Looks:
        """`with_fresh_stands`, worked out once for all searches: homes have few rooms."""
        if id(looks) not in self._fresh:
            self._fresh[id(looks)] = (looks, with_fresh_stands(ground, looks, weight))
        return self._fresh[id(looks)][1]

    def field(self, stand: int) -> NDArray[np.float32]:
        """(nx, ny) [m] shortest ways to a position of `covers`."""
        return self._fields[stand]

    def robot(self, start: int) -> Robot:
        """A robot that stands at cell `start`."""
        return Robot(self.space, self.sensor, self.motion, start)
