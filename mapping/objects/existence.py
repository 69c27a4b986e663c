"""Existence: how probable it is that a thing of a category is there, from all looks at its place.

A hit of score s counts its odds, s / (1 - s), at most 5. A look that shows the whole place without
a detection is a miss; it counts by how large the thing is in the image. Looks from one viewpoint
are correlated: the n-th counts 1 / n. With S the sum of the hits and M of the misses, the log-odds
against there being nothing are

    SEEN ln(1 + S) - MISSED ln(1 + M) + SIZE size_log_likelihood - NOTHING

The logarithm lets evidence saturate, since detectors repeat their mistakes. One look never reaches
0.9. The four numbers are a logistic regression over tracks of real rooms and simulated houses
(`python -m benchmarks.existence`); they hold for every detector.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

SEEN: Final = 2.25
MISSED: Final = 1.5
SIZE: Final = 0.95
NOTHING: Final = 2.65
MAX_ODDS: Final = 5.0  # of one detection
HALF_SEEN: Final = 0.2  # side, as a share of the image's, of a thing whose miss counts half


@dataclass(slots=True)
class CategoryEvidence:
    """Detections of one category at one place."""

    strength: float = 0.0  # S, of the hits
    looks: float = 0.0  # that were hits, each as much as it would count as a miss

    def merge(self, other: CategoryEvidence) -> None:
        """Add all hits of another track of the same thing."""
        self.strength += other.strength
        self.looks += other.looks

    def log_odds(self, looks: float, size: float) -> float:
        """Log-odds after `looks` in all; `size` is the log-likelihood of the thing's size."""
        missed = max(looks - self.looks, 0.0)
        return (
            SEEN * math.log1p(self.strength) - MISSED * math.log1p(missed) + SIZE * size - NOTHING
        )

    def set_log_odds(self, log_odds: float, size: float) -> None:
        """Choose the hits so that these `log_odds` follow before any look."""
        rest = log_odds + NOTHING - SIZE * size
        self.strength = math.expm1(max(rest, 0.0) / SEEN)


def strength(score: float) -> float:
    """Evidence of one detection with `score` in 0..1."""
    return score / max(1 - score, score / MAX_ODDS)


def visibility(side: float) -> float:
    """Weight of a miss of a thing whose `side` is that share of the image's, in 0..1."""
    return 1 / (1 + (HALF_SEEN / max(side, 1e-6)) ** 2)


def category_probabilities(log_odds: Mapping[str, float]) -> dict[str, float]:
    """Probability of each category, against the others and against there being nothing.

    Each category's log-odds are against nothing; the result sums to less than 1.
    """
    top = max(0.0, max(log_odds.values(), default=0.0))
    weights = {category: math.exp(odds - top) for category, odds in log_odds.items()}
    total = math.exp(-top) + sum(weights.values())
    return {category: weight / total for category, weight in weights.items()}


def logit(probability: float) -> float:
    """Log-odds of a probability, which is kept within 0.005..0.995."""
    kept = min(max(probability, 0.005), 0.995)
    return math.log(kept / (1 - kept))
