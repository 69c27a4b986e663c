"""Agreement of views: a part of the scene is a thing where most of the views show it apart."""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.areas import along
from mapping.frames.projection import bounds
from mapping.things.view_parts import MAX_LENGTH, Part

Floats = NDArray[np.float64]

_SAME: Final = 0.4  # overlap of boxes of one part in two views
_VIEWS: Final = 2  # that show a thing, at least
_CARRIED: Final = 0.1  # share of the lower outline that touches something level, on average
_OTHER: Final = 0.3  # share of the smaller box that two things have in common, at most
_AROUND: Final = 0.0125  # [m] around the points of a part; a thin one has a box, too


@dataclass(frozen=True, slots=True, eq=False)
class SeenPart:
    """A part and the view that shows it."""

    part: Part
    view: int
    stamp: float  # [s]


@dataclass(frozen=True, slots=True, eq=False)
class AgreedPart:
    """A part that views agree on, along axes turned as the walls."""

    low: Floats  # (3,) [m] corners of its box
    high: Floats
    seen: tuple[SeenPart, ...]  # once in each view


class _Boxes:
    """Boxes of parts in order of their middles along x, and how they overlap."""

    def __init__(self, seen: Sequence[SeenPart], yaw: float) -> None:
        ends = [_longest_ends(one.part.points, yaw) for one in seen]
        low, high = np.array(ends).reshape(-1, 2, 3).transpose(1, 0, 2)
        self.order = np.argsort(low[:, 0] + high[:, 0], kind="stable")
        self.low, self.high = low[self.order], high[self.order]
        self.view = np.array([one.view for one in seen], np.int64)[self.order]
        self.middle = (self.low[:, 0] + self.high[:, 0]) / 2
        self.volume = (self.high - self.low).prod(1)
        self.longest = (self.high - self.low).max(1)

    def shared(self, one: int) -> tuple[NDArray[np.intp], Floats]:
        """The boxes near one, and the volumes [m^3] that they have in common with it."""
        reach = np.array([-1, 1]) * (MAX_LENGTH + 2 * _AROUND)
        near = np.arange(*np.searchsorted(self.middle, self.middle[one] + reach))
        sides = np.minimum(self.high[near], self.high[one])
        sides = sides - np.maximum(self.low[near], self.low[one])
        return near, np.maximum(sides, 0).prod(1)

    def alike(self, one: int) -> tuple[NDArray[np.intp], Floats]:
        """The boxes that may be the same part as one, most alike first, and the overlaps."""
        near, shared = self.shared(one)
        overlap = shared / (self.volume[near] + self.volume[one] - shared)
        order = np.argsort(-overlap, kind="stable")
        order = order[overlap[order] >= _SAME]
        return near[order], overlap[order]


def _longest_ends(points: NDArray[np.float32], yaw: float) -> Floats:
    low, high = bounds(along(points.astype(np.float64), yaw), 0.01)
    return np.stack([low - _AROUND, high + _AROUND])


def agreed_parts(seen: Sequence[SeenPart], yaw: float) -> list[AgreedPart]:
    """Parts that most views agree on, first those of more views and of more size.

    Two that overlap are never both in the result. `yaw` [rad] turns their boxes.
    """
    if not seen:
        return []
    boxes = _Boxes(seen, yaw)
    alike, alive = [boxes.alike(one) for one in range(len(seen))], np.ones(len(seen), np.bool_)

    def agreeing(one: int) -> tuple[float, NDArray[np.intp]]:
        others, overlap = alike[one]
        kept = alive[others]
        others, overlap = others[kept], overlap[kept]
        first = np.unique(boxes.view[others], return_index=True)[1]
        return -float(overlap[first].sum() * boxes.longest[one] ** 0.5), others[first]

    waiting, found = [(agreeing(one)[0], one) for one in range(len(seen))], list[AgreedPart]()
    heapq.heapify(waiting)
    while waiting:
        before, one = heapq.heappop(waiting)
        if not alive[one]:
            continue
        worth, others = agreeing(one)
        if worth > before + 1e-9:
            heapq.heappush(waiting, (worth, one))
            continue
        members = tuple(seen[boxes.order[other]] for other in others)
        carried = np.mean([member.part.carried for member in members])
        if len(members) < _VIEWS or carried < _CARRIED:
            alive[one] = False
            continue
        low, high = np.median(boxes.low[others], axis=0), np.median(boxes.high[others], axis=0)
        found.append(AgreedPart(low, high, members))
        near, shared = boxes.shared(one)
        alive[near[shared > _OTHER * np.minimum(boxes.volume[near], boxes.volume[one])]] = False
        alive[one] = False
    return found
