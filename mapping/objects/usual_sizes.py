"""Usual sizes: the longest dimension and the width that things of a category usually have.

Figures are common knowledge about household things, one a line of `usual_sizes.csv`; categories
that are not listed have no usual size.
"""

from __future__ import annotations

import csv
import functools
import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Final

_FILE: Final = Path(__file__).with_name("usual_sizes.csv")
SPREAD: Final = 0.5  # standard deviation of log size within a category
OCCLUDED: Final = 0.35  # weight of a deviation below: hidden and cut things look smaller
WORST: Final = -4.0  # an outlier by size costs no more than this

MIN_CATEGORIES: Final = 4  # with usual sizes, to conclude anything
LARGE: Final = 1.6  # factor from which sizes are unusual ...
SMALL: Final = 0.35  # ... and below which: things are often seen in part
ALIKE: Final = 0.75  # share of the categories that must agree


@dataclass(frozen=True, slots=True)
class UsualSize:
    """Usual dimensions of a category's things [m]."""

    longest: float
    width: float  # the shorter horizontal one: the centres of two of them are no nearer


#: of things without a usual size
UNUSUAL: Final = UsualSize(longest=0.3, width=0.1)


@functools.cache
def usual_sizes() -> Mapping[str, UsualSize]:
    """Usual sizes by label."""
    with _FILE.open(newline="", encoding="utf-8") as file:
        rows = csv.DictReader(file)
        return {row["label"]: UsualSize(float(row["size"]), float(row["width"])) for row in rows}


def size_log_likelihood(size: float, usual: UsualSize | None) -> float:
    """Log-likelihood of a longest dimension `size` [m], log-normal about `usual`; 0 at its mode.

    Deviations below the usual size count less, since often only a part of a thing is visible.
    """
    if usual is None or size <= 0:
        return 0.0
    deviation = math.log(size / usual.longest) / SPREAD
    if deviation < 0:
        deviation *= OCCLUDED
    return max(-0.5 * deviation * deviation, WORST)


#: usual size of a category by IRI, None where it has none
SizeOf = Callable[[str], UsualSize | None]


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
