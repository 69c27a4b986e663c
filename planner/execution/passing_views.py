"""Passing views: pictures taken on the way to a look, of which none showed what is wanted."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from planner.execution.protocol import RobotPose
from planner.execution.viewpoint_adapter import NextView

_APART: Final = 1.0  # [m] pictures that are nearer to each other show the same
_TURNED: Final = 0.8  # [rad] unless the camera turned by more


class PassingViews:
    """Camera poses (x [m], y [m], heading [rad]) in the map frame, thinned as they are added."""

    def __init__(self) -> None:
        self._poses: list[tuple[float, float, float]] = []

    def __iter__(self) -> Iterator[tuple[float, float, float]]:
        return iter(self._poses)

    def add(self, pose: RobotPose, goal: NextView) -> None:
        """Add a view in vain, unless it repeats the last one or the look planned at `goal`."""
        if math.hypot(pose.x - goal.x, pose.y - goal.y) < _APART:
            return
        if self._poses:
            x, y, heading = self._poses[-1]
            turned = abs(math.remainder(pose.heading - heading, 2 * math.pi))
            if math.hypot(pose.x - x, pose.y - y) < _APART and turned < _TURNED:
                return
        self._poses.append((round(pose.x, 2), round(pose.y, 2), round(pose.heading, 2)))
