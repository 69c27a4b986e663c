"""A home prepared for searches: free space, covers of rooms, views, shortest paths."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from benchmarks.search.homes import Home
from benchmarks.search.robot import TrialRobot
from planner.freespace.floor_plan import free_space, shifts
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


class HomeSpace:
    """Data that all searches of one home share."""

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
