"""Absence: how probable it is that a thing has left the spot where it was last seen.

The prior is that of its class for the time since (`mapping.persistence`). Each later view that
should show the thing and does not is a miss. It counts by the thing's own rate of detection, a
Beta-binomial with the detector's recall as its mean, so that a run of misses saturates. Rays
through the thing's volume (`mapping.objects.existence`) count too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

RECALL: Final = 0.8  # of a thing that fills the image
HALF: Final = 0.055  # share of the image's side at which recall is half of that
SURE: Final = 0.5  # greatest rate of detection from a new view, however often it was seen before
KNOWN: Final = 2.0  # views that the detector's recall counts as, and hits known after a restart


def recall(side: float) -> float:
    """Usual recall of detectors for a thing whose `side` is that share of the image's."""
    return RECALL / (1 + (HALF / max(side, 1e-6)) ** 2)


@dataclass(slots=True)
class Absence:
    """Hits and misses of one thing, each weighted by the novelty of its view."""

    hits: float = 0.0
    misses: float = 0.0  # between hits
    run: float = 0.0  # misses since the last hit
    log_ratio: float = 0.0  # of the views since: absent against present

    def hit(self, weight: float) -> None:
        """Count a detection, which ends the run of misses."""
        self.hits += weight
        self.misses += self.run
        self.run = self.log_ratio = 0.0

    def miss(self, weight: float, recall: float) -> None:
        """Count a view without a detection by a detector with that `recall`, below 1."""
        views = self.hits + self.misses + self.run
        rate = min((self.hits + KNOWN * recall) / (views + KNOWN), SURE)
        self.log_ratio -= weight * math.log(1 - rate)
        self.run += weight

    def empty(self, weight: float, ratio: float) -> None:
        """Count a view through the thing's volume, of log-likelihood ratio `ratio`."""
        self.log_ratio += weight * ratio

    def merge(self, other: Absence) -> None:
        """Add all views of another track of the same thing, just after either was seen."""
        self.hits += other.hits
        self.misses += other.misses
        self.log_ratio = min(self.log_ratio, other.log_ratio)
        self.run = min(self.run, other.run)

    def probability(self, prior: float) -> float:
        """Probability that the thing has left; 0 unless views are evidence of it."""
        if self.log_ratio <= 0:
            return 0.0
        return 1 / (1 + (1 - prior) / prior * math.exp(-min(self.log_ratio, 50.0)))
