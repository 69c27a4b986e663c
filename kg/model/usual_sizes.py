"""Usual sizes of things, by category: what is general knowledge, for mappers and explanations.

`usual_sizes.csv` has, for each label, the usual longest side, the shorter horizontal one, and the
three sides of the largest things of that name that are found in rooms, in metres.
"""

from __future__ import annotations

import csv
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

_FILE: Final = Path(__file__).with_name("usual_sizes.csv")
VOXEL: Final = 0.03  # [m] by which a box that is grown from the surface is too large


@dataclass(frozen=True, slots=True)
class UsualSize:
    """Usual dimensions of a category's things [m]."""

    longest: float
    width: float  # the shorter horizontal one: the centres of two of them are no nearer
    greatest: tuple[float, float, float] = (math.inf,) * 3  # sides of the largest, longest first

    def excess(self, sides: Sequence[float]) -> float:
        """Greatest ratio of one of three `sides` [m] to that of the largest things, at least 1."""
        pairs = zip(sorted(sides, reverse=True), self.greatest, strict=True)
        return max(1.0, *(side / (greatest + VOXEL) for side, greatest in pairs))


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
        label: UsualSize(size, width, (long, middle, short))
        for label, (size, width, long, middle, short) in sizes.items()
    }


def size_reason(label: str, sides: Sequence[float]) -> str:
    """A sentence: a box of three `sides` [m] fits a name or not; "" where its size is unknown."""
    usual = usual_sizes().get(label)
    if usual is None:
        return ""
    own, largest = (" x ".join(f"{x:.2f}" for x in found) for found in (sides, usual.greatest))
    verdict = "speaks against" if usual.excess(sides) > 1 else "fits"
    return f"the size {verdict} {label}: {own} m, the largest have {largest} m"
