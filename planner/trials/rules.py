"""Ways of searching that know no cells: room after room by a rule, and the one that knows all."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from planner.space.geodesic import distance_fields
from planner.space.grid import Cells
from planner.trials.building import Building
from planner.trials.hidden import Hidden
from planner.trials.robot import Outcome, Robot


def room_by_room(
    building: Building, start: int, hidden: Hidden, rooms: Sequence[Sequence[int]]
) -> Outcome:
    """Groups of rooms in turn, each group nearest first by straight line to the rooms' middles.

    In every room whole turns from as many positions as cover it, the nearest first. Gives up after
    the last room.
    """
    robot = building.robot(start)
    hidden.begin()
    for group in rooms:
        left = list(group)
        while left:
            room = _nearest(building, robot.cell, left)
            left.remove(room)
            if _swept(building, robot, hidden, building.covers[room]):
                return robot.outcome(True)
    return robot.outcome(False)


def _nearest(building: Building, cell: int, rooms: Sequence[int]) -> int:
    here = building.space.centres([cell])[0]
    metres = [float(np.hypot(*(building.middles[room] - here))) for room in rooms]
    return rooms[int(np.argmin(metres))]


def _swept(building: Building, robot: Robot, hidden: Hidden, stands: Cells) -> bool:
    left = [int(stand) for stand in stands]
    while left:
        metres = [float(building.field(stand).reshape(-1)[robot.cell]) for stand in left]
        stand = left.pop(int(np.argmin(metres)))
        robot.drive(building.field(stand))
        if robot.turn_and_look(hidden, 0.0, 2 * np.pi):
            return True
    return False


def thesis_rule(building: Building, start: int, hidden: Hidden, listed: Sequence[bool]) -> Outcome:
    """The rooms the ontology lists, then the others (thesis section 3.4, and on until found)."""
    first = [room for room in building.covers if listed[room]]
    return room_by_room(
        building, start, hidden, (first, [r for r in building.covers if not listed[r]])
    )


def brute_force(building: Building, start: int, hidden: Hidden) -> Outcome:
    """All rooms (thesis section 4.4)."""
    return room_by_room(building, start, hidden, (list(building.covers),))


def clairvoyant(building: Building, start: int, hidden: Hidden) -> Outcome:
    """The shortest way to where an instance can be seen, and one picture that does not miss."""
    field = distance_fields(building.space, [start])[0].reshape(-1)
    metres = float(field[hidden.views].min(initial=np.inf))
    motion = building.motion
    if not np.isfinite(metres):
        return Outcome(False, 0.0, 0.0, 0)
    return Outcome(True, metres / motion.speed + motion.picture, metres, 1)
