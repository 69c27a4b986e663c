"""Viewpoint adapter: the planning state in terms of a robot's poses, messages and obstacles.

The module also has the counter of failed goals, and the pictures taken on the way to a viewpoint.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import LayoutError, RobotError
from kg.model.records import LookRecord, ObstacleRecord
from mapping.occupancy.mapped_floor import FloorView
from planner.execution.protocol import Hello, RobotPose
from planner.search.plans.search_state import PlanningState, build_search
from planner.search.viewpoints.candidate_views import (
    Motion,
    Sensor,
    floor_in_view,
    sweep_chance,
    sweep_over,
)
from planner.settings import BELIEF

NEAR: float = 0.5  # [m] from a viewpoint within which a look counts as one from there
ALIKE: float = 0.35  # [rad] from a heading within which it has that heading
STEP: float = 0.5  # [m] by which a second view is nearer
BLOCKS: float = 0.6  # [m] radius of blocked floor around an obstacle: enough to close a door


@dataclass(frozen=True, slots=True)
class NextView:
    """The next view: its viewpoint, the sweep, the expected gain and the reasons."""

    x: float  # [m]
    y: float
    heading: float  # [rad] to arrive with: the beginning of the sweep
    turn: float  # [rad] to sweep from there, to the left
    middle: float  # [rad] heading in the middle of the view
    extent: float  # [rad] angle in view altogether
    place: str  # label of the place, "" for none
    probability: float  # to find any target
    seconds: float  # [s] until the view is over
    left: float  # probability that a target is on the floor if this view fails
    why: tuple[str, ...]  # the weightiest reasons first


class ViewpointAdapter:
    """Keeps a planning state consistent with the robot and with changes by other writers."""

    def __init__(
        self,
        semantic_map: SemanticMap,
        words: Sequence[str],
        robot: Hello,
        at: float,
        give_up_at: float = BELIEF.stop_below,
    ) -> None:
        self._map = semantic_map
        self._at = at  # [s] time for which persistence is computed, the same in each run
        self._words = tuple(words)
        self._settings = replace(BELIEF, stop_below=give_up_at)
        self._sensor, self._motion = sensor_of(robot), motion_of(robot)
        self._state = self._prepared()
        self._no_viewpoint = False  # whether no viewpoint is left

    @property
    def left(self) -> float:
        """Probability that any target still wanted is on this floor."""
        return self._state.left

    @property
    def uncertain(self) -> bool:
        """Whether the views so far may have missed a target, with more than `give_up_at`."""
        return self._state.overlooked > self._settings.stop_below

    @property
    def field_of_view(self) -> float:
        """[rad] horizontal field of view of one picture."""
        return self._sensor.field_of_view

    @property
    def recall(self) -> float:
        """Probability to detect an object in view."""
        return self._sensor.recall

    def off_floor(self, pose: RobotPose) -> str:
        """A line about a pose off the floor, or ""; QueryParameterError for one far away."""
        return self._state.space.off_floor((pose.x, pose.y), "pose of the robot")

    def next(self, pose: RobotPose) -> NextView | None:
        """The view to take next; None where no view gains enough."""
        state = self._state
        if self._no_viewpoint:
            return None
        at = state.robot_state((pose.x, pose.y), pose.heading)
        view = state.next_view(at)
        if view is None:
            return None
        views = state.views
        x, y = (float(c) for c in views.space.centres([views.viewpoints[views.viewpoint[view]]])[0])
        viewed = float(views.heading[view]), float(views.extent[view])
        there = int(views.viewpoints[views.viewpoint[view]]) == at.cell
        arriving = state.next_best_view.arriving(at)[views.viewpoint[view]]
        heading = pose.heading if there else float(arriving)
        sweep = sweep_over(heading, *viewed, self._sensor.field_of_view)
        gain = float(state.revisits.chance(view) @ state.belief.weight)
        left = max(state.left - gain, 0.0) / max(1.0 - gain, 1e-9)
        return NextView(
            x=x,
            y=y,
            heading=math.remainder(sweep.start, 2 * math.pi),
            turn=sweep.turn,
            middle=sweep.middle,
            extent=sweep.extent,
            place=state.place_name(view),
            probability=gain,
            seconds=float(state.next_best_view.costs(at, np.array([view]))[0]),
            left=left,
            why=tuple(
                f"{reason.candidate.label}: {'; '.join(reason.candidate.facts)}"
                for reason in state.why(view)[:3]
            ),
        )

    def missed(self, pose: RobotPose, heading: float, extent: float) -> None:
        """Update the belief: a sweep of `extent` [rad] about `heading` showed no target."""
        self._state.missed_sweep(self._viewpoint_at(pose.x, pose.y), heading, extent)

    def missed_picture(self, x: float, y: float, heading: float) -> None:
        """Update the belief: one picture showed no target."""
        cell = self._state.space.nearest((x, y))
        self._state.missed_sweep(cell, heading, self._sensor.field_of_view)

    def in_view(self, x: float, y: float, heading: float, extent: float | None = None) -> FloorView:
        """The floor that a view of `extent` [rad] shows, by default one picture."""
        space, extent = self._state.space, extent or self.field_of_view
        return floor_in_view(space, self._sensor, space.nearest((x, y)), heading, extent)

    def another_view(
        self, pose: RobotPose, p_map: np.ndarray, aside: float = 0.0
    ) -> tuple[float, float]:
        """Viewpoint (x, y) [m] for a second view of an object at `p_map` (3,) [m].

        The viewpoint is nearer to the object than `pose`, as far as the sensor's range allows, and
        `aside` [rad] around the object, on the side with floor.
        """
        near, far = self._sensor.near, self._sensor.far
        dx, dy = pose.x - p_map[0], pose.y - p_map[1]
        distance, direction = math.hypot(dx, dy), math.atan2(dy, dx)
        closer = max(min(distance - STEP, (near + far) / 2), 2 * near)
        away = closer if aside or distance - closer >= STEP / 2 else distance + STEP
        floor = self._state.space.centres(self._state.space.floor())
        off = [
            np.hypot(*(floor - p_map[:2] - away * np.array([math.cos(d), math.sin(d)])).T)
            for d in (direction + aside, direction - aside)
        ]
        x, y = floor[min(off, key=np.min).argmin()].tolist()
        return x, y

    def found(self, target: str, p_map: np.ndarray) -> None:
        """Update the belief: `target` (its text) is at `p_map`."""
        self._state.found(target, p_map)

    def blocked(self, x: float, y: float, pose: RobotPose | None) -> bool:
        """Block the floor around (x, y) without the robot's cell; returns whether it changed."""
        space = self._state.space
        cells = set(space.within((x, y), BLOCKS).tolist())
        if pose is not None:
            cells.discard(space.nearest((pose.x, pose.y)))
        if not cells:
            return False
        if cells.issuperset(self._state.views.viewpoints.tolist()):
            self._no_viewpoint = True
            return True
        try:
            self._state.blocked(np.array(sorted(cells), np.intp))
        except LayoutError:  # no floor would be left: ignore the obstacle
            return False
        return True

    def shows(self, look: LookRecord, p_map: np.ndarray) -> bool:
        """Whether `look` is likely to show an object at `p_map` (3,) [m]."""
        views = self._state.views
        cell = self._viewpoint_at(*look.position)
        chance = sweep_chance(views, cell, look.heading, look.extent)
        off = ((views.space.centres(views.cells) - p_map[:2]) ** 2).sum(axis=1)
        return float(chance[int(np.argmin(off))]) >= views.sensor.recall / 2

    def rebuild(
        self,
        looks: Sequence[LookRecord],
        obstacles: Sequence[ObstacleRecord],
        found: Sequence[tuple[str, np.ndarray]] = (),
    ) -> None:
        """Rebuild the planning state from the map, then apply `looks`, `obstacles` and `found`."""
        self._state, self._no_viewpoint = self._prepared(), False
        for obstacle in obstacles:
            self.blocked(*obstacle.position, None)
        for target, p_map in found:
            self.found(target, p_map)
        for look in looks:
            for picture in look.glimpses:
                self.missed_picture(*picture)
            self.missed(RobotPose(*look.position, look.heading), look.heading, look.extent)

    def _viewpoint_at(self, x: float, y: float) -> int:
        """Floor cell that a look from (x, y) [m] counts for: the viewpoint nearby, if there is one.

        A look from beside a viewpoint shows nearly the same. If it did not count for all that
        the planned view promised, the search would plan that view for ever.
        """
        space, viewpoints = self._state.space, self._state.views.viewpoints
        off = np.linalg.norm(space.centres(viewpoints) - (x, y), axis=1)
        nearest = int(np.argmin(off))
        return int(viewpoints[nearest]) if off[nearest] <= NEAR else space.nearest((x, y))

    def _prepared(self) -> PlanningState:
        state = build_search(
            self._map,
            self._words,
            sensor=self._sensor,
            motion=self._motion,
            at=self._at,
            settings=self._settings,
        )
        if state is None:
            raise LayoutError(
                "the map has neither places with an area nor objects, so there is nowhere to "
                "search; map a recording into it first"
            )
        return state


def sensor_of(robot: Hello) -> Sensor:
    """Sensor model of the robot's camera; the thesis' where the hello gives none."""
    plain = Sensor()
    near, far = robot.near, robot.far
    if near is None or far is None or not near < far:
        near, far = plain.near, plain.far
    return Sensor(
        near=near,
        far=far,
        field_of_view=min(robot.field_of_view or plain.field_of_view, 2 * math.pi),
        recall=robot.recall or plain.recall,
    )


def motion_of(robot: Hello) -> Motion:
    """Motion model of the robot; the thesis' where the hello gives none."""
    plain = Motion()
    return Motion(robot.speed or plain.speed, robot.turn_rate or plain.turn_rate)


MAX_FAILURES: Final = 25  # failed commands without a view between them
MAX_TRIES: Final = 2  # of one goal


class FailedGoals:
    """Failures since the last view, and of each goal (to 0.1 m)."""

    def __init__(self) -> None:
        self._of_goal: Counter[tuple[float, float]] = Counter()
        self._in_a_row = 0

    def add(self, goal: NextView, reason: str) -> bool:
        """Count a failure; returns whether `goal` is unreachable.

        Raises RobotError after MAX_FAILURES failures in a row.
        """
        self._in_a_row += 1
        if self._in_a_row >= MAX_FAILURES:
            raise RobotError(f"{MAX_FAILURES} commands in a row failed, the last one: {reason}")
        key = round(goal.x, 1), round(goal.y, 1)
        self._of_goal[key] += 1
        return self._of_goal[key] >= MAX_TRIES

    def reset(self) -> None:
        """Reset the count of failures after a view."""
        self._in_a_row = 0


_APART: Final = 0.2  # [m] between pictures; nearer ones show the same floor ...
_TURNED: Final = 0.8  # [rad] ... unless the camera has turned by more


class PassingViews:
    """Camera poses (x [m], y [m], heading [rad]) in the map frame, thinned as they are added."""

    def __init__(self) -> None:
        self._poses: list[tuple[float, float, float]] = []

    def __iter__(self) -> Iterator[tuple[float, float, float]]:
        return iter(self._poses)

    def add(self, pose: RobotPose) -> bool:
        """Add a failed view, unless it repeats the last one; returns whether it was added."""
        if self._poses:
            x, y, heading = self._poses[-1]
            turned = abs(math.remainder(pose.heading - heading, 2 * math.pi))
            if math.hypot(pose.x - x, pose.y - y) < _APART and turned < _TURNED:
                return False
        self._poses.append((round(pose.x, 2), round(pose.y, 2), round(pose.heading, 2)))
        return True
