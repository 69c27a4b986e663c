"""Size check: whether things of many categories look larger or smaller than they usually are.

A wrong unit of depth makes a room that is right in itself, and larger or smaller by one factor.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable
from statistics import median
from typing import Final

from mapping.objects.usual_sizes import usual_sizes

MIN_CATEGORIES: Final = 4  # with usual sizes, to conclude anything
LARGE: Final = 1.6  # factor from which sizes are told ...
SMALL: Final = 0.35  # ... and below which: things are often seen in part
ALIKE: Final = 0.75  # share of the categories that have to say so


def unusual_scale(sizes: Iterable[tuple[str, float]]) -> float | None:
    """Factor by which things are larger than usual, by (label, longest dimension [m]) of each.

    None where they are about as large as usual, or too few are known to tell.
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
