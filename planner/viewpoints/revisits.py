"""Revisit model: a repeated view of the same cells detects less each time."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
from numpy.typing import NDArray

from planner.viewpoints.candidate_views import CandidateViews, square

Chances = NDArray[np.float32]


class RevisitModel:
    """Revisit model: after n views from a square metre the next keeps (1 - rho)^n of its chance.

    Misses of one viewpoint are correlated: what it does not show is hidden from there or not known
    to the detector, also a step beside it.
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
        self._worth: dict[int, Chances] = {}  # by square: (c,) what is left of a look

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
        """(c,) chance of `view` to detect what all looks before it have missed."""
        return self.reduced(self._cell(view), self._views.chance[view])

    def remaining(self, viewpoint: int) -> Chances | None:
        """(c,) share left of views from `viewpoint`; None where none was taken there."""
        return self._worth.get(self._squares[viewpoint])

    def reduced(self, cell: int, chance: Chances) -> Chances:
        """`chance` (c,) of a picture from floor `cell`, after all looks before it."""
        worth = self._worth.get(square(self._views.space, cell))
        return np.array(chance) if worth is None else chance * worth

    def gains(self, weight: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) how much each look finds of `weight` (c,)."""
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
