"""Failed goals: when a goal counts as unreachable, and when a robot does."""

from __future__ import annotations

from collections import Counter
from typing import Final

from kg.errors import RobotError
from planner.execution.viewpoint_adapter import NextView

MOST_FAILURES: Final = 25  # commands that fail with no look between them
MOST_TRIES: Final = 2  # of one goal


class FailedGoals:
    """Failures since the last look, and of each goal (to 0.1 m)."""

    def __init__(self) -> None:
        self._of_goal: Counter[tuple[float, float]] = Counter()
        self._in_a_row = 0

    def add(self, goal: NextView, reason: str) -> bool:
        """Whether `goal` counts as unreachable now; RobotError where nothing works any more."""
        self._in_a_row += 1
        if self._in_a_row >= MOST_FAILURES:
            raise RobotError(f"{MOST_FAILURES} commands in a row failed, the last one: {reason}")
        key = round(goal.x, 1), round(goal.y, 1)
        self._of_goal[key] += 1
        return self._of_goal[key] >= MOST_TRIES

    def looked(self) -> None:
        """A look worked."""
        self._in_a_row = 0
