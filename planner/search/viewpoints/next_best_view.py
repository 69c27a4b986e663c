"""Next best view: the ratio rule with lookahead, and a model of repeated views.

A view is rated by the probability gained per second. A room is rated by the best prefix of a greedy
walk through it, so that a far room counts for all its views and not only for its first one. A
repeated view of the same cells detects less each time.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.search.viewpoints.candidate_views import (
    CandidateViews,
    DetectionMatrix,
    angle_between,
    square,
)


@dataclass(frozen=True, slots=True)
class RobotState:
    """Robot state: floor cell and heading [rad]."""

    cell: int
    heading: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class _Room:
    """The views from within one room, and what they show."""

    rows: NDArray[np.intp]  # (k,) numbers of views, ascending
    cells: NDArray[np.intp]  # (m,) cells of the belief that any of them shows
    chance: DetectionMatrix  # of these views

    def reduced(self, views: CandidateViews, revisits: RevisitModel) -> NDArray[np.float32]:
        """The chances of `chance` after all earlier views."""
        viewpoints, value = views.viewpoint[self.rows], self.chance.value
        for viewpoint in np.unique(viewpoints):
            share = revisits.remaining(int(viewpoint))
            if share is not None:
                value = value.copy() if value is self.chance.value else value
                first, end = np.searchsorted(viewpoints, [viewpoint, viewpoint + 1])
                part = slice(self.chance.starts[first], self.chance.starts[end])
                value[part] *= share[self.chance.cell[part]]
        return value


_AHEAD: Final = 3  # views that the lookahead follows after the first one


class NextBestView:
    """Choice of the next best view in one building, for any belief."""

    def __init__(self, views: CandidateViews) -> None:
        self.views = views
        rooms = views.space.room.reshape(-1)[views.viewpoints][views.viewpoint]
        self._rooms = [_room(views, np.flatnonzero(rooms == room)) for room in np.unique(rooms)]

    @property
    def seeable(self) -> NDArray[np.bool_]:
        """(c,) cells that some view shows."""
        return self.views.chance.any()

    def seeable_from(self, at: RobotState) -> NDArray[np.bool_]:
        """(c,) cells that some view from a reachable viewpoint shows."""
        return self.views.chance.any(self.reached(at))

    def reached(self, at: RobotState) -> NDArray[np.bool_]:
        """(n,) views from reachable viewpoints."""
        reachable = np.isfinite(self.metres_to(at))
        return np.asarray(reachable[self.views.viewpoint], np.bool_)

    def metres_to(self, at: RobotState) -> NDArray[np.float64]:
        """(s,) [m] the shortest way from `at` to each viewpoint."""
        return self.views.ways.metres_from(at.cell)

    def costs(self, at: RobotState, among: NDArray[np.intp]) -> NDArray[np.float64]:
        """(k,) [s] to drive, to turn and to take the view, for each of the views `among`."""
        views = self.views
        viewpoint = views.viewpoint[among]
        metres = self.metres_to(at)[viewpoint]
        moved = metres > views.space.cell / 2
        heading = np.where(moved, self.arriving(at)[viewpoint], at.heading)
        first, last = views.starts(among)
        turn = np.minimum(angle_between(heading, first), angle_between(heading, last))
        turn = np.where(views.extent[among] >= 2 * np.pi - 1e-9, 0.0, turn)
        motion = views.motion
        return metres / motion.speed + turn / motion.turn_rate + views.seconds[among]

    def arriving(self, at: RobotState) -> NDArray[np.float64]:
        """(s,) [rad] headings with which shortest ways from `at` arrive at each viewpoint."""
        return self.views.ways.arriving(at.cell)

    def after(self, at: RobotState, view: int) -> RobotState:
        """State of the robot after `view`."""
        views = self.views
        viewpoint = int(views.viewpoint[view])
        cell = int(views.viewpoints[viewpoint])
        if views.extent[view] >= 2 * np.pi - 1e-9:
            return RobotState(cell, at.heading)
        ends = np.array([float(end[0]) for end in views.starts([view])])
        heading = at.heading if cell == at.cell else float(self.arriving(at)[viewpoint])
        near = int(np.argmin(angle_between(heading, ends)))
        return RobotState(cell, float(ends[1 - near]))

    def best(
        self,
        at: RobotState,
        weight: NDArray[np.float64],
        revisits: RevisitModel | None = None,
        gains: NDArray[np.float64] | None = None,
    ) -> int | None:
        """The view to take next, or None where no view gains anything.

        Args:
            at: State of the robot.
            weight: (c,) present belief, in any scale.
            revisits: Earlier views; none by default.
            gains: (n,) share of `weight` that each view finds, 0 for views that must not be taken.
        """
        revisits = revisits or RevisitModel(self.views)
        if gains is None:
            gains = revisits.gains(weight)
        costs = self.costs(at, np.arange(len(gains)))
        rate = gains / costs
        best = int(np.argmax(rate))
        best_rate = float(rate[best])
        if not best_rate > 0:
            return None
        for room in self._rooms:
            max_gain = float(weight[room.cells].sum()) * self.views.sensor.recall
            if max_gain <= best_rate * float(costs[room.rows].min()):
                continue  # no view of this room can have a better rate
            number = int(np.argmax(rate[room.rows]))
            view = int(room.rows[number])
            seconds = float(costs[view])
            room_rate = self._lookahead_rate(at, weight, room, number, seconds, revisits)
            if room_rate > best_rate + 1e-15:
                best, best_rate = view, room_rate
        return best

    def _lookahead_rate(
        self,
        at: RobotState,
        weight: NDArray[np.float64],
        room: _Room,
        number: int,
        seconds: float,
        revisits: RevisitModel,
    ) -> float:
        """Rate of the best prefix of a greedy walk through one room.

        It begins with view `number` of the room, which takes `seconds`.
        """
        left, gained, best_rate = weight.copy(), 0.0, 0.0
        value = room.reduced(self.views, revisits)
        for step in range(_AHEAD + 1):
            part = slice(*room.chance.starts[number : number + 2])
            gain = value[part] * left[room.chance.cell[part]]
            gained += float(gain.sum())
            best_rate = max(best_rate, gained / seconds)
            if step == _AHEAD:
                break
            left[room.chance.cell[part]] -= gain
            at = self.after(at, int(room.rows[number]))
            costs = self.costs(at, room.rows)
            number = int(np.argmax(room.chance.product(left, value) / costs))
            seconds += float(costs[number])
        return best_rate


def _room(views: CandidateViews, rows: NDArray[np.intp]) -> _Room:
    chance = views.chance.rows(rows)
    return _Room(rows, np.flatnonzero(chance.any()), chance)


Chances = NDArray[np.float32]


class RevisitModel:
    """Revisit model: after n views from a square metre the next keeps (1 - rho)^n of its chance.

    Misses from one viewpoint are correlated: if one view misses an object, the object is probably
    occluded from there or unknown to the detector, and so it is one step aside.
    """

    def __init__(self, views: CandidateViews) -> None:
        self._views = views
        self._squares = square(views.space, views.viewpoints)  # (s,)
        self._share: dict[int, Chances] = {}  # by square: (c,) share of the chance that is left

    def add(self, view: int) -> None:
        """Add `view`, which was taken."""
        self.add_shown(self._cell(view), self._views.chance[view])

    def add_shown(self, cell: int, chance: Chances) -> None:
        """Add a picture from floor `cell` that showed each cell with `chance` (c,)."""
        here = square(self._views.space, cell)
        share = self._share.get(here, np.ones(len(chance), np.float32))
        rest = np.float32(1 - self._views.sensor.rho)
        self._share[here] = np.where(chance > 0, share * rest, share)

    def chance(self, view: int) -> Chances:
        """(c,) probability that `view` detects an object that all earlier views missed."""
        return self.reduced(self._cell(view), self._views.chance[view])

    def remaining(self, viewpoint: int) -> Chances | None:
        """(c,) share of the chance left to views from `viewpoint`; None without earlier ones."""
        cell = int(self._views.viewpoints[viewpoint])
        return self._share.get(square(self._views.space, cell))

    def reduced(self, cell: int, chance: Chances) -> Chances:
        """`chance` (c,) of a picture from floor `cell`, after all earlier views."""
        share = self._share.get(square(self._views.space, cell))
        return np.array(chance) if share is None else chance * share

    def gains(self, weight: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) share of `weight` (c,) that each view finds."""
        gains = self._views.chance @ weight
        for here, share in self._share.items():
            viewpoints = np.flatnonzero(self._squares == here)
            rows = np.flatnonzero(np.isin(self._views.viewpoint, viewpoints))
            gains[rows] = self._views.chance.rows(rows) @ (weight * share)
        return gains

    def moved_to(self, views: CandidateViews) -> RevisitModel:
        """The same revisits for other `views` over the same cells of a floor of the same grid."""
        other = RevisitModel(views)
        other._share = dict(self._share)
        return other

    def copy(self) -> RevisitModel:
        """An independent copy, for rollouts."""
        other = copy(self)
        other._share = dict(self._share)
        return other

    def _cell(self, view: int) -> int:
        return int(self._views.viewpoints[self._views.viewpoint[view]])
