"""The robot all ways of searching drive: same legs, same looks, same clock."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.search.ground_truth import HiddenObject
from planner.freespace.geodesic import shortest_path
from planner.freespace.grid import FreeSpace
from planner.search.viewpoints.candidate_views import (
    Motion,
    Sensor,
    Sweep,
    angle_between,
    sweep_over,
)

_AHEAD: Final = 3  # cells: the camera points where the robot will be then


@dataclass(frozen=True, slots=True)
class TrialOutcome:
    """The course of a search."""

    found: bool
    seconds: float  # until found, or given up
    metres: float
    looks: int


class TrialRobot:
    """Drives and looks in a home until it sees what is hidden; counts seconds and metres."""

    def __init__(self, space: FreeSpace, sensor: Sensor, motion: Motion, start: int) -> None:
        self.space, self.sensor, self.motion = space, sensor, motion
        self.cell, self.heading = start, 0.0
        self.seconds, self.metres, self.looks = 0.0, 0.0, 0

    def outcome(self, found: bool) -> TrialOutcome:
        """The search as it stands."""
        return TrialOutcome(found, self.seconds, self.metres, self.looks)

    def drive(
        self,
        field: NDArray[np.float32],
        hidden: HiddenObject | None = None,
        seen: Callable[[int, float], bool] | None = None,
        apart: float = 0.0,
    ) -> bool:
        """Go to where the distance `field` (nx, ny) [m] is zero; whether something was seen.

        Pictures are taken on the way where `hidden` is given: each takes the time of
        `Motion.picture` while the robot drives on, and the next one begins at least `apart` metres
        after it. `seen(cell, heading)` is called after each picture without the target; it returns
        True to stop the drive there.
        """
        path = shortest_path(self.space, field, self.cell)
        left = field.reshape(-1)
        last = float(left[self.cell])
        apart = max(apart, self.motion.speed * self.motion.picture)
        for step in range(1, len(path)):
            cell, ahead = int(path[step]), path[min(step + _AHEAD, len(path) - 1)]
            behind = path[max(step - _AHEAD, 0)] if ahead == cell else cell
            self._move(
                cell, float(left[self.cell]), float(left[cell]), self._towards(behind, ahead)
            )
            if hidden is None or last - float(left[cell]) < apart or step == len(path) - 1:
                continue
            last = float(left[cell])
            self.looks += 1
            if hidden.shown(cell, self.heading, self.sensor.field_of_view):
                self.seconds += self.motion.picture
                return True
            if seen is not None and seen(cell, self.heading):
                return False
        return False

    def _move(self, cell: int, before: float, after: float, heading: float) -> None:
        self.metres += before - after
        self.seconds += (before - after) / self.motion.speed
        self.cell, self.heading = cell, heading

    def _towards(self, a: int, b: int) -> float:
        dx, dy = self.space.centres([b])[0] - self.space.centres([a])[0]
        return float(np.arctan2(dy, dx))

    def turn_and_look(self, hidden: HiddenObject, heading: float, extent: float) -> bool:
        """Sweep over `extent` [rad] about `heading`; whether it shows something."""
        return self.sweep(
            hidden, sweep_over(self.heading, heading, extent, self.sensor.field_of_view)
        )

    def sweep(self, hidden: HiddenObject, sweep: Sweep) -> bool:
        """Carry out a sweep; whether it shows something."""
        turned = float(angle_between(self.heading, sweep.start)) + abs(sweep.turn)
        self.seconds += turned / self.motion.turn_rate + self.motion.picture
        self.heading = sweep.start + sweep.turn
        self.looks += 1
        return hidden.shown(self.cell, sweep.middle, sweep.extent)
