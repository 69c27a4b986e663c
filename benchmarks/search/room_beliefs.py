"""Beliefs given by probabilities of rooms, for benchmarks and tests."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.freespace.grid import Cells, FreeSpace
from planner.freespace.planning_map import PlanningMap
from planner.search.belief import CellBelief, TargetBelief, build_target_belief
from planner.search.goals.candidate_queries import Candidate
from planner.settings import BELIEF

#: Probability that the object is in the home, where no room is known to hold it.
PRESENT: Final = 0.9


@dataclass(frozen=True, slots=True, eq=False)
class RoomChances:
    """Beta distributions of the probability that each room holds at least one object."""

    p: NDArray[np.float64]  # (rooms,) their means
    kinds: tuple[str, ...]  # (rooms,) rooms of one kind share a distribution
    worth: NDArray[np.float64]  # (rooms,) alpha + beta: how many rooms the mean is worth

    @staticmethod
    def apart(p: ArrayLike) -> RoomChances:
        """Rooms that tell nothing of each other, with probabilities `p` (rooms,)."""
        means = np.asarray(p, np.float64)
        return RoomChances(means, ("",) * len(means), np.full(len(means), np.inf))


def room_belief(space: FreeSpace, cells: Cells, rooms: RoomChances, share: float) -> TargetBelief:
    """The belief of `find` in objects of `rooms`, of which `share` is even over all cells."""
    p = rooms.p if rooms.p.any() else np.full(len(rooms.p), PRESENT / len(rooms.p))
    names = tuple(f"room {number}" for number in range(int(space.room.max()) + 1))
    places = [
        Candidate(
            target=0,
            kind="place",
            iri=name,
            label=name,
            p_map=np.zeros(2),
            probability=float(p[number]),
            facts=(),
            place=name,
            room_kind=rooms.kinds[number],
            rooms=float(rooms.worth[number]),
        )
        for number, name in enumerate(names[: len(p)])
    ]
    ground = PlanningMap(space, names, names)
    return build_target_belief(ground, cells, places, replace(BELIEF, uniform_share=share))


def room_weights(
    space: FreeSpace, cells: Cells, probabilities: Mapping[int, float] | ArrayLike
) -> NDArray[np.float64]:
    """(c,) each room's probability spread evenly over its cells."""
    rooms = space.room.reshape(-1)[cells]
    counts = np.bincount(rooms, minlength=int(rooms.max()) + 1)
    p = np.zeros(len(counts))
    if isinstance(probabilities, Mapping):
        for room, value in probabilities.items():
            p[room] = value
    else:
        given = np.asarray(probabilities, np.float64)
        p[: len(given)] = given[: len(counts)]
    return p[rooms] / counts[rooms]


def belief_from(
    cells: Cells, weights: ArrayLike, absent: float, *, everywhere: float = 0.02
) -> CellBelief:
    """A belief of `weights` (c,) in any scale, of which `everywhere` is spread over all cells.

    The even share keeps cells possible that a wrong prior excludes.
    """
    raw = np.asarray(weights, np.float64)
    even = np.full(len(raw), 1.0 / len(raw))
    total = float(raw.sum())
    shaped = even if total <= 0 else (1 - everywhere) * raw / total + everywhere * even
    return CellBelief(cells, shaped * (1 - absent), absent)
