"""Evidence strength: votes, ConceptNet's weight, and the probability derived from it."""

from __future__ import annotations

import math
from typing import Final

#: Log-odds without evidence, and for each unit of ln(1 + weight): of an object in a place of the
#: category, and near another object; fitted as lab/research/conceptnet.md describes.
LOCATED: Final = (-3.65, 2.10)
NEAR: Final = (-2.08, 1.74)


def weight_of(votes: float) -> float:
    """ConceptNet 5's weight for n votes: 2 sqrt(max(n - 1, 1)) + min(n, 2) - 2."""
    return 2 * math.sqrt(max(votes - 1, 1)) + min(votes, 2) - 2


def votes_of(weight: float) -> float:
    """The votes for a weight: the inverse of `weight_of`, exact for weights above 0."""
    return weight if weight <= 2 else (weight / 2) ** 2 + 1


def probability_of(weight: float, log_odds: tuple[float, float] = LOCATED) -> float:
    """p = 1 / (1 + exp(-base - slope ln(1 + w))): the base rate at weight 0, rising towards 1.

    Args:
        weight: total weight for, less the weight against; below 0 counts as 0.
        log_odds: base and slope.
    """
    base, slope = log_odds
    return 1 / (1 + math.exp(-base - slope * math.log1p(max(weight, 0.0))))
