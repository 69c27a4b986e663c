"""Usual sizes of things, by category: what is general knowledge, for mappers and explanations.

`usual_sizes.csv` has, for each label, the usual longest side, the shorter horizontal one, the three
sides of the largest things of that name that are found in rooms, and the usual height of what
always stands on the floor (others: 0), in metres.
"""

from __future__ import annotations

import csv
import functools
import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Final

import numpy as np

from kg.model.areas import OrientedBox
from kg.model.place_names import indefinite

_FILE: Final = Path(__file__).with_name("usual_sizes.csv")
VOXEL: Final = 0.03  # [m] by which a box that is grown from the surface is too large
_WIDE: Final = 0.5  # [m] width of large things
_BAND: Final = (0.5, 0.9)  # shares of its usual height that what stands on the floor fills ...
_FLOOR: Final = (-0.1, 1.3)  # ... where it was seen between that many metres and heights above it

MIN_CATEGORIES: Final = 4  # with usual sizes, to conclude anything
LARGE: Final = 1.6  # factor from which sizes are unusual ...
SMALL: Final = 0.35  # ... and below which: things are often seen in part
ALIKE: Final = 0.75  # share of the categories that must agree


@dataclass(frozen=True, slots=True)
class UsualSize:
    """Usual dimensions of a category's things [m]."""

    longest: float
    width: float  # the shorter horizontal one: the centres of two of them are no nearer
    greatest: tuple[float, float, float] = (math.inf,) * 3  # sides of the largest, longest first
    stands: float = 0.0  # height of what always stands on the floor; 0: it may be anywhere

    def excess(self, sides: Sequence[float]) -> float:
        """Greatest ratio of one of three `sides` [m] to that of the largest things, at least 1."""
        pairs = zip(sorted(sides, reverse=True), self.greatest, strict=True)
        return max(1.0, *(side / (greatest + VOXEL) for side, greatest in pairs))

    def lack(self, longest: float) -> float:
        """Ratio of half the usual longest side of a large thing to `longest` [m], at least 1."""
        return max(1.0, self.longest / 2 / longest) if self.width >= _WIDE else 1.0

    def whole(self, box: OrientedBox) -> OrientedBox:
        """`box` with the hidden parts of what stands on the floor, which is at height 0.

        A chair behind a table shows its back alone, and one below the camera its seat: it reaches
        from half of its usual height to nine tenths at least. Other things stay as they are seen.
        """
        bottom, top = (box.centre[2] + side * box.extent[2] / 2 for side in (-1, 1))
        lowest, highest = _FLOOR
        if not (lowest < bottom and top < highest * self.stands):
            return box
        low, high = min(bottom, _BAND[0] * self.stands), max(top, _BAND[1] * self.stands)
        if (low, high) == (bottom, top):
            return box
        centre = np.array([*box.centre[:2], (low + high) / 2])
        return OrientedBox(centre, np.array([*box.extent[:2], high - low]), box.yaw)


#: of things without a usual size
UNUSUAL: Final = UsualSize(longest=0.3, width=0.1)

#: usual size of a category by IRI, None where it has none
SizeOf = Callable[[str], UsualSize | None]


@functools.cache
def usual_sizes() -> Mapping[str, UsualSize]:
    """Usual sizes by label."""
    with _FILE.open(newline="", encoding="utf-8") as file:
        rows = csv.reader(file)
        next(rows)
        sizes = {label: [*map(float, sides)] for label, *sides in rows}
    return {
        label: UsualSize(size, width, (long, middle, short), stands)
        for label, (size, width, long, middle, short, stands) in sizes.items()
    }


def unusual_scale(sizes: Iterable[tuple[str, float]]) -> float | None:
    """Factor by which things are larger than usual, by (label, longest dimension [m]) of each.

    A wrong unit of depth makes a room that is consistent, and larger or smaller by one factor.
    None where they are about as large as usual, or too few of their usual sizes are known.
    """
    usual, found = usual_sizes(), defaultdict[str, list[float]](list)
    for label, size in sizes:
        if label in usual and size > 0:
            found[label].append(math.log(size / usual[label].longest))
    if len(found) < MIN_CATEGORIES:
        return None
    by_category = [median(ratios) for ratios in found.values()]
    factor = math.exp(median(by_category))
    for limit, sign in ((LARGE, 1), (SMALL, -1)):
        beyond = sum(sign * (ratio - math.log(limit)) > 0 for ratio in by_category)
        if beyond >= ALIKE * len(by_category):
            return factor
    return None


def size_reason(label: str, sides: Sequence[float]) -> str:
    """A sentence: a box of three `sides` [m] fits a name or not; "" where its size is unknown."""
    usual = usual_sizes().get(label)
    if usual is None:
        return ""
    own, largest = (" x ".join(f"{x:.2f}" for x in found) for found in (sides, usual.greatest))
    if usual.lack(max(sides)) > 1:
        named = indefinite(label)
        return f"the size speaks against {named}: {own} m, and {usual.longest:.2f} m is usual"
    verdict = "speaks against" if usual.excess(sides) > 1 else "fits"
    return f"the size {verdict} {indefinite(label)}: {own} m, the largest have {largest} m"
