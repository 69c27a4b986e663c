"""Evidence strength: votes, ConceptNet's weight, and the probability derived from it."""

from __future__ import annotations

import math
from typing import Final

#: The weight at which a place of the category is as likely to hold the object as not, and how
#: steeply probability rises with weight there; fitted as docs/how-to/statistics.md describes.
HALF: Final = 5.5
STEEPNESS: Final = 2.3
#: The same for things near others. Nearly flat, about 0.16: in homes it hardly rises with weight.
NEAR_HALF: Final = 3e7
NEAR_STEEPNESS: Final = 0.1


def weight_of(votes: float) -> float:
    """ConceptNet 5's weight for n votes: 2 sqrt(max(n - 1, 1)) + min(n, 2) - 2."""
    return 2 * math.sqrt(max(votes - 1, 1)) + min(votes, 2) - 2


def votes_of(weight: float) -> float:
    """The votes that have that weight: the inverse of `weight_of`, exact for weights above 0."""
    return weight if weight <= 2 else (weight / 2) ** 2 + 1


def probability_of(weight: float, *, half: float = HALF, steepness: float = STEEPNESS) -> float:
    """p = w^s / (w^s + h^s): logistic in log w, 0 at weight 0, rising towards 1.

    Args:
        weight: total weight for, less the weight against; below 0 counts as 0.
        half: h, the weight at which p is 0.5.
        steepness: s, the slope of the log-odds over log w.
    """
    if weight <= 0:
        return 0.0
    return 1 / (1 + math.pow(half / weight, steepness))
