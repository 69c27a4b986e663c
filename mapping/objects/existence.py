"""Existence: log-odds of a candidate's categories from its views, and their probabilities.

The evidence of n views that add up to S counts S / (1 + (n - 1) c): views of one thing are
correlated with c, so that a label that only ever repeats itself saturates.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(slots=True)
class ViewEvidence:
    """Sum of the log-likelihood ratios of the views by one detector."""

    views: float = 0.0  # n, each weighted by its novelty
    total: float = 0.0  # S

    def add(self, ratio: float, weight: float) -> None:
        """Add a view."""
        self.views += weight
        self.total += weight * ratio

    def merge(self, other: ViewEvidence) -> None:
        """Add all views of another candidate."""
        self.views += other.views
        self.total += other.total

    def saturated(self, correlation: float) -> float:
        """Log-likelihood ratio of all views together."""
        return self.total / (1 + max(self.views - 1, 0.0) * correlation)


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
