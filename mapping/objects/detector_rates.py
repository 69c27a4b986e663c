"""Detector rates: log-likelihood ratios of hits and misses, measured for each detector.

A candidate is a thing of some category, or clutter that resembles one. A view of it is a hit with a
score s, or a miss, and counts as

    hit    offset + slope logit(s)
    miss   log((1 - recall(size)) / (1 - repeat))    recall(size) = recall / (1 + (half / size)^2)

where `size` is the candidate's side as a share of the image's, `recall` the detector's for things
that fill it, `half` the share at which recall is half of that, and `repeat` the probability that a
false detection is made again in another view of the same spot. The numbers are fitted to
photographs with complete boxes, seen through random crops, blur and noise as so many views
(`python -m benchmarks.detector_rates`); they are part of the model card.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from perception.inference.model_zoo import find_rates


@dataclass(frozen=True, slots=True)
class DetectorRates:
    """Hit and false-alarm rates of a detector; the defaults are about the mean of four networks."""

    offset: float = 2.1
    slope: float = 1.9
    recall: float = 0.8
    half: float = 0.055
    repeat: float = 0.2

    def miss(self, size: float) -> float:
        """Log-likelihood ratio of a view without a detection; `size`: share of the image's side."""
        return self.miss_with(self.recall_of(size))

    def miss_with(self, recall: float) -> float:
        """Log-likelihood ratio of a view that detects such a thing with probability `recall`."""
        return min(0.0, math.log(max(1 - recall, 0.01) / (1 - self.repeat)))

    def recall_of(self, size: float) -> float:
        """Recall of a thing whose side is `size`, as a share of the image's."""
        return self.recall / (1 + (self.half / max(size, 1e-6)) ** 2)

    def hit(self, score: float, size: float) -> float:
        """Log-likelihood ratio of a detection; a weak one says no less than none would."""
        odds = min(max(score, 0.01), 0.98)
        return max(self.offset + self.slope * math.log(odds / (1 - odds)), self.miss(size))


UNKNOWN: Final = DetectorRates()


def rates_of(detector: str) -> DetectorRates:
    """Measured rates of the detector called `detector`; typical ones where none were measured."""
    measured = find_rates(detector)
    return UNKNOWN if measured is None else DetectorRates(**measured)
