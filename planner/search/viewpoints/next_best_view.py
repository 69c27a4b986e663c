"""Next best view: the ratio rule with lookahead, and the value of views that are taken again.

A view is rated by the probability gained per second. So that a far room is judged by all that it
offers and not by the first view in it, each room is followed greedily and rated by the best
beginning. A repeated view of the same cells detects less each time.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.search.viewpoints.candidate_views import CandidateViews, square
from planner.search.viewpoints.sensor import angle_between


@dataclass(frozen=True, slots=True)
class RobotState:
    """Robot state: floor cell, heading [rad], and number of the viewpoint it is at, if any."""

    cell: int
    heading: float = 0.0
    viewpoint: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class _Room:
    """The views from within one room, and the cells they show."""

    rows: NDArray[np.intp]  # (k,) numbers of views
    cells: NDArray[np.intp]  # (m,) which of the belief's cells
    chance: NDArray[np.float32]  # (k, m)

    def reduced(self, views: CandidateViews, revisits: RevisitModel) -> NDArray[np.float32]:
        """(k, m) `chance` after all views that were taken."""
        viewpoint, chance = views.viewpoint[self.rows], self.chance
        for one in np.unique(viewpoint):
            worth = revisits.remaining(int(one))
            if worth is not None:
                chance = chance.copy() if chance is self.chance else chance
                chance[viewpoint == one] *= worth[self.cells]
        return chance


class NextBestView:
    """Next-best-view choice in one building for one belief after another."""

    def __init__(self, views: CandidateViews, *, ahead: int = 3) -> None:
        self.views = views
        self._ahead = ahead
        rooms = views.space.room.reshape(-1)[views.viewpoints][views.viewpoint]
        self._rooms = [_room(views, np.flatnonzero(rooms == room)) for room in np.unique(rooms)]
        from_viewpoints = views.chance.reshape(len(views.viewpoints), -1, len(views.cells)) > 0
        self._shown: NDArray[np.bool_] = np.asarray(from_viewpoints.any(axis=1), np.bool_)  # (s, c)

    @property
    def seeable(self) -> NDArray[np.bool_]:
        """(c,) cells that some view shows."""
        return np.asarray(self._shown.any(axis=0), np.bool_)

    def seeable_from(self, at: RobotState) -> NDArray[np.bool_]:
        """(c,) cells that some view from a reachable viewpoint shows."""
        there = np.isfinite(self.views.metres_from(at.cell))
        return np.asarray(self._shown[there].any(axis=0), np.bool_)

    def reached(self, at: RobotState) -> NDArray[np.bool_]:
        """(n,) views from reachable viewpoints."""
        there = np.isfinite(self.views.metres_from(at.cell))
        return np.asarray(there[self.views.viewpoint], np.bool_)

    def costs(self, at: RobotState, among: NDArray[np.intp]) -> NDArray[np.float64]:
        """(k,) [s] to drive, to turn and to take the view, for each of the views `among`."""
        views = self.views
        viewpoint = views.viewpoint[among]
        if at.viewpoint is None:
            metres = views.metres_from(at.cell)[viewpoint]
        else:
            metres = views.metres[at.viewpoint, viewpoint]
        here = views.space.centres([at.cell])[0]
        towards = views.space.centres(views.viewpoints[viewpoint]) - here
        moved = metres > views.space.cell / 2
        heading = np.where(moved, np.arctan2(towards[:, 1], towards[:, 0]), at.heading)
        first, last = views.starts(among)
        turn = np.minimum(angle_between(heading, first), angle_between(heading, last))
        turn = np.where(views.extent[among] >= 2 * np.pi - 1e-9, 0.0, turn)
        motion = views.motion
        return metres / motion.speed + turn / motion.turn_rate + views.seconds[among]

    def after(self, at: RobotState, view: int) -> RobotState:
        """State of the robot after `view`."""
        views = self.views
        viewpoint = int(views.viewpoint[view])
        cell = int(views.viewpoints[viewpoint])
        if views.extent[view] >= 2 * np.pi - 1e-9:
            return RobotState(cell, at.heading, viewpoint)
        ends = np.array([float(end[0]) for end in views.starts([view])])
        came = at.heading
        if cell != at.cell:
            dx, dy = views.space.centres([cell])[0] - views.space.centres([at.cell])[0]
            came = float(np.arctan2(dy, dx))
        near = int(np.argmin(angle_between(came, ends)))
        return RobotState(cell, float(ends[1 - near]), viewpoint)

    def best(
        self,
        at: RobotState,
        weight: NDArray[np.float64],
        revisits: RevisitModel | None = None,
        gains: NDArray[np.float64] | None = None,
    ) -> int | None:
        """The view to take next, or None where no view can show anything.

        `weight` (c,) is the present belief in any scale. `gains` (n,) is the share of it that each
        view finds, 0 for views that must not be taken; by default it is computed.
        """
        revisits = revisits or RevisitModel(self.views)
        if gains is None:
            gains = revisits.gains(weight)
        costs = self.costs(at, np.arange(len(gains)))
        rate = gains / costs
        best = int(np.argmax(rate))
        rated = float(rate[best])
        if not rated > 0:
            return None
        for room in self._rooms:
            most = float(weight[room.cells].sum()) * self.views.sensor.recall
            if most <= rated * float(costs[room.rows].min()):
                continue  # nothing in this room can be worth the way
            view = int(room.rows[np.argmax(rate[room.rows])])
            worth = self._follow(at, weight, room, view, revisits)
            if worth > rated + 1e-15:
                best, rated = view, worth
        return best

    def _follow(
        self,
        at: RobotState,
        weight: NDArray[np.float64],
        room: _Room,
        view: int,
        revisits: RevisitModel,
    ) -> float:
        """The rate of the best prefix of a greedy walk through one room that begins with `view`."""
        left, seconds, gained, worth = weight[room.cells], 0.0, 0.0, 0.0
        # cells that views from the same squares have shown count less on the way, too
        chance = room.reduced(self.views, revisits)
        for step in range(self._ahead + 1):
            seconds += float(self.costs(at, np.array([view]))[0])
            seen = chance[np.searchsorted(room.rows, view)] * left
            gained += float(seen.sum())
            worth = max(worth, gained / seconds)
            if step == self._ahead:
                break
            left, at = left - seen, self.after(at, view)
            ratio = (chance @ left.astype(np.float32)) / self.costs(at, room.rows)
            view = int(room.rows[np.argmax(ratio)])
        return worth


def _room(views: CandidateViews, rows: NDArray[np.intp]) -> _Room:
    chance = views.chance[rows]
    cells = np.flatnonzero((chance > 0).any(axis=0))
    return _Room(rows, cells, np.ascontiguousarray(chance[:, cells]))


Chances = NDArray[np.float32]


class RevisitModel:
    """Revisit model: after n views from a square metre the next keeps (1 - rho)^n of its chance.

    Misses from one viewpoint are correlated: an object that one view missed is hidden from there or
    unknown to the detector, also from a step aside.
    """

    def __init__(self, views: CandidateViews) -> None:
        self._views = views
        self._viewpoints_of: dict[int, list[int]] = defaultdict(list)  # by square
        for viewpoint, cell in enumerate(views.viewpoints):
            self._viewpoints_of[square(views.space, int(cell))].append(viewpoint)
        self._squares = {
            viewpoint: at
            for at, viewpoints in self._viewpoints_of.items()
            for viewpoint in viewpoints
        }
        self._worth: dict[int, Chances] = {}  # by square: (c,) share of the chance that is left

    def add(self, view: int) -> None:
        """Add `view`, which was taken."""
        self.add_shown(self._cell(view), self._views.chance[view])

    def add_shown(self, cell: int, chance: Chances) -> None:
        """Add a picture from floor `cell` that showed each cell with `chance` (c,)."""
        here = square(self._views.space, cell)
        worth = self._worth.get(here)
        worth = np.ones(len(chance), np.float32) if worth is None else worth
        rest = np.float32(1 - self._views.sensor.rho)
        self._worth[here] = np.where(chance > 0, worth * rest, worth)

    def chance(self, view: int) -> Chances:
        """(c,) probability that `view` detects what all earlier views have missed."""
        return self.reduced(self._cell(view), self._views.chance[view])

    def remaining(self, viewpoint: int) -> Chances | None:
        """(c,) share of the chance left to views from `viewpoint`; None without earlier ones."""
        return self._worth.get(self._squares[viewpoint])

    def reduced(self, cell: int, chance: Chances) -> Chances:
        """`chance` (c,) of a picture from floor `cell`, after all earlier views."""
        worth = self._worth.get(square(self._views.space, cell))
        return np.array(chance) if worth is None else chance * worth

    def gains(self, weight: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) share of `weight` (c,) that each view finds."""
        left = weight.astype(np.float32)
        gains = self._views.chance @ left
        for here, worth in self._worth.items():
            for viewpoint in self._viewpoints_of.get(here, ()):
                rows = slice(*np.searchsorted(self._views.viewpoint, [viewpoint, viewpoint + 1]))
                gains[rows] = self._views.chance[rows] @ (left * worth)
        return gains.astype(np.float64)

    def moved_to(self, views: CandidateViews) -> RevisitModel:
        """The same revisits for other `views` over the same cells of a floor of the same grid."""
        other = RevisitModel(views)
        other._worth = dict(self._worth)
        return other

    def copy(self) -> RevisitModel:
        """An independent copy, for rollouts."""
        return self.moved_to(self._views)

    def _cell(self, view: int) -> int:
        return int(self._views.viewpoints[self._views.viewpoint[view]])
