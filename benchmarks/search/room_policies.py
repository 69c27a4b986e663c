"""Ways of searching that know no cells: room after room by a rule, and the one that knows all."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from benchmarks.search.ground_truth import HiddenObject
from benchmarks.search.home_space import HomeSpace
from benchmarks.search.robot import TrialOutcome, TrialRobot
from planner.freespace.geodesic import distance_fields
from planner.freespace.grid import Cells
from planner.search.plans.thesis_rules import nearest_neighbour


def room_by_room(
    building: HomeSpace,
    start: int,
    hidden: HiddenObject,
    rooms: Sequence[Sequence[int]],
    *,
    listens: bool = True,
) -> TrialOutcome:
    """Groups of rooms in turn, each group nearest first by straight line to the rooms' middles.

    In every room whole turns from as many positions as cover it, the nearest first. The robot that
    `listens` takes pictures on the way, too. Gives up after the last room.
    """
    robot = building.robot(start)
    hidden.begin()
    for group in rooms:
        for room in nearest_neighbour(group, partial(_straight_metres, building, robot)):
            if _swept(building, robot, hidden, building.covers[room], listens=listens):
                return robot.outcome(True)
    return robot.outcome(False)


def _straight_metres(building: HomeSpace, robot: TrialRobot, _: int | None, room: int) -> float:
    here = building.space.centres([robot.cell])[0]
    return float(np.hypot(*(building.middles[room] - here)))


def _swept(
    building: HomeSpace,
    robot: TrialRobot,
    hidden: HiddenObject,
    viewpoints: Cells,
    *,
    listens: bool,
) -> bool:
    def metres(_: int | None, viewpoint: int) -> float:
        return float(building.field(viewpoint).reshape(-1)[robot.cell])

    for viewpoint in nearest_neighbour((int(viewpoint) for viewpoint in viewpoints), metres):
        if robot.drive(building.field(viewpoint), hidden if listens else None):
            return True
        if robot.turn_and_look(hidden, 0.0, 2 * np.pi):
            return True
    return False


def thesis_rule(
    building: HomeSpace,
    start: int,
    hidden: HiddenObject,
    listed: Sequence[bool],
    *,
    listens: bool = True,
) -> TrialOutcome:
    """The rooms the ontology lists, then the others (thesis section 3.4, and on until found).

    Its finder listens to detections all the time (section 3.4.2).
    """
    first = [room for room in building.covers if listed[room]]
    others = [room for room in building.covers if not listed[room]]
    return room_by_room(building, start, hidden, (first, others), listens=listens)


def brute_force(
    building: HomeSpace, start: int, hidden: HiddenObject, *, listens: bool = True
) -> TrialOutcome:
    """All rooms (thesis section 4.4)."""
    return room_by_room(building, start, hidden, (list(building.covers),), listens=listens)


def greedy_walk(
    building: HomeSpace,
    start: int,
    hidden: HiddenObject,
    chances: NDArray[np.float64],
    *,
    listens: bool = True,
) -> TrialOutcome:
    """Always the room that gains most chance (rooms,) a second of driving there and looking."""
    robot, left = building.robot(start), dict.fromkeys(building.covers)
    hidden.begin()
    turn = 2 * np.pi / building.motion.turn_rate + building.motion.picture

    def gain(room: int) -> float:
        looks = building.covers[room]
        metres = min(building.field(int(look)).reshape(-1)[robot.cell] for look in looks)
        return float(chances[room] / (metres / building.motion.speed + turn * len(looks)))

    while left:
        room = max(left, key=gain)
        del left[room]
        if _swept(building, robot, hidden, building.covers[room], listens=listens):
            return robot.outcome(True)
    return robot.outcome(False)


def oracle(building: HomeSpace, start: int, hidden: HiddenObject) -> TrialOutcome:
    """The shortest way to where an instance can be seen, and one picture that does not miss."""
    field = distance_fields(building.space, [start])[0].reshape(-1)
    metres = float(field[hidden.views].min(initial=np.inf))
    motion = building.motion
    if not np.isfinite(metres):
        return TrialOutcome(False, 0.0, 0.0, 0)
    return TrialOutcome(True, metres / motion.speed + motion.picture, metres, 1)
