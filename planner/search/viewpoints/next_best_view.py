"""Next best view: the ratio rule with lookahead, and a model of repeated views.

A view is rated by the probability gained per second. A room is rated by the best prefix of a greedy
walk through it, so that a far room counts for all its views and not only for its first one. A
repeated view of the same cells detects less each time.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.freespace.geodesic import cells_before, distance_fields
from planner.search.viewpoints.candidate_views import CandidateViews, angle_between, square

LAST_STEPS: Final = 3  # cells before the end of a way by which the robot's heading is known


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
    cells: NDArray[np.intp]  # (m,) indices of cells of the belief
    chance: NDArray[np.float32]  # (k, m)

    def reduced(self, views: CandidateViews, revisits: RevisitModel) -> NDArray[np.float32]:
        """(k, m) `chance` after all earlier views."""
        viewpoints, chance = views.viewpoint[self.rows], self.chance
        for viewpoint in np.unique(viewpoints):
            share = revisits.remaining(int(viewpoint))
            if share is not None:
                chance = chance.copy() if chance is self.chance else chance
                chance[viewpoints == viewpoint] *= share[self.cells]
        return chance


_AHEAD: Final = 3  # views that the lookahead follows after the first one


class NextBestView:
    """Choice of the next best view in one building, for any belief."""

    def __init__(self, views: CandidateViews) -> None:
        self.views = views
        rooms = views.space.room.reshape(-1)[views.viewpoints][views.viewpoint]
        self._rooms = [_room(views, np.flatnonzero(rooms == room)) for room in np.unique(rooms)]
        from_viewpoints = views.chance.reshape(len(views.viewpoints), -1, len(views.cells)) > 0
        self._shown: NDArray[np.bool_] = np.asarray(from_viewpoints.any(axis=1), np.bool_)  # (s, c)
        self._headings = dict[int, NDArray[np.float64]]()  # of arrival at each viewpoint, by cell

    @property
    def seeable(self) -> NDArray[np.bool_]:
        """(c,) cells that some view shows."""
        return np.asarray(self._shown.any(axis=0), np.bool_)

    def seeable_from(self, at: RobotState) -> NDArray[np.bool_]:
        """(c,) cells that some view from a reachable viewpoint shows."""
        reachable = np.isfinite(self.views.metres_from(at.cell))
        return np.asarray(self._shown[reachable].any(axis=0), np.bool_)

    def reached(self, at: RobotState) -> NDArray[np.bool_]:
        """(n,) views from reachable viewpoints."""
        reachable = np.isfinite(self.views.metres_from(at.cell))
        return np.asarray(reachable[self.views.viewpoint], np.bool_)

    def metres_to(self, at: RobotState) -> NDArray[np.float64]:
        """(s,) [m] the shortest way from `at` to each viewpoint."""
        if at.viewpoint is None:
            return self.views.metres_from(at.cell)
        return np.asarray(self.views.metres[at.viewpoint], np.float64)

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
        if at.cell not in self._headings:
            space, ends = self.views.space, self.views.viewpoints
            if at.viewpoint is None:
                field = distance_fields(space, [at.cell])[0]
            else:
                field = self.views.fields[at.viewpoint]
            way = space.centres(ends) - space.centres(cells_before(space, field, ends, LAST_STEPS))
            self._headings[at.cell] = np.arctan2(way[:, 1], way[:, 0])
        return self._headings[at.cell]

    def after(self, at: RobotState, view: int) -> RobotState:
        """State of the robot after `view`."""
        views = self.views
        viewpoint = int(views.viewpoint[view])
        cell = int(views.viewpoints[viewpoint])
        if views.extent[view] >= 2 * np.pi - 1e-9:
            return RobotState(cell, at.heading, viewpoint)
        ends = np.array([float(end[0]) for end in views.starts([view])])
        heading = at.heading if cell == at.cell else float(self.arriving(at)[viewpoint])
        near = int(np.argmin(angle_between(heading, ends)))
        return RobotState(cell, float(ends[1 - near]), viewpoint)

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
            view = int(room.rows[np.argmax(rate[room.rows])])
            room_rate = self._lookahead_rate(at, weight, room, view, revisits)
            if room_rate > best_rate + 1e-15:
                best, best_rate = view, room_rate
        return best

    def _lookahead_rate(
        self,
        at: RobotState,
        weight: NDArray[np.float64],
        room: _Room,
        view: int,
        revisits: RevisitModel,
    ) -> float:
        """Rate of the best prefix of a greedy walk through one room that begins with `view`."""
        left, seconds, gained, best_rate = weight[room.cells], 0.0, 0.0, 0.0
        chance = room.reduced(self.views, revisits)
        for step in range(_AHEAD + 1):
            seconds += float(self.costs(at, np.array([view]))[0])
            gain = chance[np.searchsorted(room.rows, view)] * left
            gained += float(gain.sum())
            best_rate = max(best_rate, gained / seconds)
            if step == _AHEAD:
                break
            left, at = left - gain, self.after(at, view)
            rate = (chance @ left.astype(np.float32)) / self.costs(at, room.rows)
            view = int(room.rows[np.argmax(rate)])
        return best_rate


def _room(views: CandidateViews, rows: NDArray[np.intp]) -> _Room:
    chance = views.chance[rows]
    cells = np.flatnonzero((chance > 0).any(axis=0))
    return _Room(rows, cells, np.ascontiguousarray(chance[:, cells]))


Chances = NDArray[np.float32]


class RevisitModel:
    """Revisit model: after n views from a square metre the next keeps (1 - rho)^n of its chance.

    Misses from one viewpoint are correlated: if one view misses an object, the object is probably
    occluded from there or unknown to the detector, and so it is one step aside.
    """

    def __init__(self, views: CandidateViews) -> None:
        self._views = views
        self._viewpoints_of: dict[int, list[int]] = defaultdict(list)  # by square
        for viewpoint, cell in enumerate(views.viewpoints):
            self._viewpoints_of[square(views.space, int(cell))].append(viewpoint)
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
        left = weight.astype(np.float32)
        gains = self._views.chance @ left
        for here, share in self._share.items():
            for viewpoint in self._viewpoints_of.get(here, ()):
                rows = slice(*np.searchsorted(self._views.viewpoint, [viewpoint, viewpoint + 1]))
                gains[rows] = self._views.chance[rows] @ (left * share)
        return gains.astype(np.float64)

    def moved_to(self, views: CandidateViews) -> RevisitModel:
        """The same revisits for other `views` over the same cells of a floor of the same grid."""
        other = RevisitModel(views)
        other._share = dict(self._share)
        return other

    def copy(self) -> RevisitModel:
        """An independent copy, for rollouts."""
        return self.moved_to(self._views)

    def _cell(self, view: int) -> int:
        return int(self._views.viewpoints[self._views.viewpoint[view]])
