"""A home prepared for searches: free space, covers of rooms, views, shortest paths."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.search.homes import Home, RoomFloor
from benchmarks.search.robot import TrialRobot
from planner.freespace.floor_plan import free_space
from planner.freespace.geodesic import distance_fields
from planner.freespace.grid import Cells, FreeSpace
from planner.freespace.planning_map import PlanningMap
from planner.search.plans.search_viewpoints import with_fresh_viewpoints
from planner.search.viewpoints.candidate_views import (
    CandidateViews,
    Motion,
    Sensor,
    candidate_views,
)
from planner.search.viewpoints.covering_viewpoints import room_viewpoints

STOREY: Final = 1.2  # [m] between floor heights from which on they are different storeys
CLIMB: Final = 2.0  # metres walked for each metre of height on stairs


def shifts(rooms: Sequence[RoomFloor]) -> NDArray[np.float64]:
    """(n,) [m] offset of each room along x, so that storeys do not overlap."""
    number: dict[float, int] = {}
    lowest, storey = -np.inf, -1
    for height in sorted({room.height for room in rooms}):
        if height - lowest > STOREY:
            lowest, storey = height, storey + 1
        number[height] = storey
    width = max((r.xmax for r in rooms), default=0.0) - min((r.xmin for r in rooms), default=0.0)
    return np.array([number[room.height] * (width + 5.0) for room in rooms], np.float64)


def with_stairs(space: FreeSpace, rooms: Sequence[RoomFloor]) -> FreeSpace:
    """`space`, whose passages between storeys are longer by the way up."""
    height = np.array([room.height for room in rooms])[space.room.reshape(-1)]
    passages = tuple(
        replace(p, metres=p.metres + CLIMB * abs(float(height[p.a] - height[p.b])))
        for p in space.passages
    )
    return replace(space, passages=passages)


class HomeSpace:
    """Data that all searches of one home share."""

    def __init__(self, home: Home, sensor: Sensor, motion: Motion) -> None:
        self.home, self.sensor, self.motion = home, sensor, motion
        floors = [room.floor for room in home.rooms]
        moved = shifts(floors)
        flat = [floor.shifted(float(dx)) for floor, dx in zip(floors, moved, strict=True)]
        self.space: FreeSpace = with_stairs(free_space(flat, home.doors), floors)
        self.middles: NDArray[np.float64] = np.array(  # (rooms, 2) [m]
            [
                ((f.xmin + f.xmax) / 2 + dx, (f.ymin + f.ymax) / 2)
                for f, dx in zip(floors, moved, strict=True)
            ]
        )
        self._fields: dict[int, NDArray[np.float32]] = {}
        self._fresh: dict[
            int, tuple[CandidateViews, CandidateViews]
        ] = {}  # by the old ones' id, which are kept

    @cached_property
    def covers(self) -> dict[int, Cells]:
        """For each room with floor, the viewpoints that cover it with whole turns."""
        found = room_viewpoints(self.space, self.sensor.far, near=self.sensor.near)
        viewpoints = sorted({int(cell) for cells in found.values() for cell in cells})
        fields = distance_fields(self.space, viewpoints)
        self._fields.update(zip(viewpoints, fields, strict=True))
        return found

    @cached_property
    def views(self) -> CandidateViews:
        """All candidate views."""
        return candidate_views(self.space, self.sensor, self.motion)

    @cached_property
    def whole_turns(self) -> CandidateViews:
        """The whole turns among `views`."""
        views = self.views
        turns = np.flatnonzero(views.extent >= 2 * np.pi - 1e-9)
        return replace(
            views,
            viewpoint=views.viewpoint[turns],
            heading=views.heading[turns],
            extent=views.extent[turns],
            seconds=views.seconds[turns],
            chance=views.chance.rows(turns),
        )

    def fresh(
        self, ground: PlanningMap, views: CandidateViews, weight: NDArray[np.float64]
    ) -> CandidateViews:
        """`with_fresh_viewpoints`, computed once for all searches."""
        if id(views) not in self._fresh:
            self._fresh[id(views)] = (views, with_fresh_viewpoints(ground, views, weight))
        return self._fresh[id(views)][1]

    def field(self, viewpoint: int) -> NDArray[np.float32]:
        """(nx, ny) [m] shortest paths to a viewpoint of `covers`."""
        return self._fields[viewpoint]

    def robot(self, start: int) -> TrialRobot:
        """A robot that stands at cell `start`."""
        return TrialRobot(self.space, self.sensor, self.motion, start)
