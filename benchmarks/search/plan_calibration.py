"""Calibration of plans: the predicted chance of being found by parts of a plan, and the realised.

A plan is carried out as it is, look by look, without pictures on the way, which it does not count
either. The object is in the home, so predictions are those given that it is there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from benchmarks.search.ground_truth import HiddenObject
from benchmarks.search.home_space import HomeSpace
from benchmarks.search.room_beliefs import RoomChances
from benchmarks.search.view_policy import Ablation, initial_state
from planner.search.plans.view_plan import plan
from planner.search.viewpoints.next_best_view import RobotState

#: Shares of a plan's time.
PARTS: Final = (0.1, 0.25, 0.5, 0.75, 0.9, 1.0)


@dataclass(frozen=True, slots=True)
class PlanOutcome:
    """A plan for one query, carried out: at each of `PARTS` of its time."""

    predicted: tuple[float, ...]  # chance to be found by then, given that it is there
    found: tuple[bool, ...]
    instances: int  # of it in the home


def planned(
    building: HomeSpace,
    start: int,
    hidden: HiddenObject,
    rooms: RoomChances,
) -> PlanOutcome:
    """Plan with the chances of `rooms` to hold it, and carry the plan out."""
    manner = Ablation()
    views = building.views
    state = initial_state(building, views, rooms, manner)
    made = plan(state, RobotState(start, 0.0), time_limit=np.inf)
    steps = made.steps
    if not steps:
        return PlanOutcome((0.0,) * len(PARTS), (False,) * len(PARTS), len(hidden.cells))
    robot = building.robot(start)
    hidden.begin()
    found_at = len(steps)
    for number, step in enumerate(steps):
        robot.drive(views.ways.field(int(views.viewpoints[views.viewpoint[step.view]])))
        if robot.turn_and_look(hidden, step.heading, step.extent):
            found_at = number
            break
    chance = np.cumsum([step.probability for step in steps]) / made.present
    over = np.array([step.seconds for step in steps])
    done = [int((over <= part * over[-1] + 1e-9).sum()) for part in PARTS]
    return PlanOutcome(
        predicted=tuple(float(chance[k - 1]) if k else 0.0 for k in done),
        found=tuple(found_at < k for k in done),
        instances=len(hidden.cells),
    )


@dataclass(frozen=True, slots=True)
class Reliability:
    """Means over plans, at each of `PARTS` of their time."""

    plans: int
    predicted: tuple[float, ...]
    found: tuple[float, ...]


def reliability(outcomes: Sequence[PlanOutcome]) -> dict[str, Reliability]:
    """Of all plans, and of those for things of which the home holds one; none is left out."""
    groups = {"all": outcomes, "one instance": [o for o in outcomes if o.instances == 1]}
    return {
        name: Reliability(
            len(those),
            tuple(np.mean([o.predicted for o in those], axis=0).tolist()),
            tuple(np.mean([o.found for o in those], axis=0).tolist()),
        )
        for name, those in groups.items()
        if those
    }
