"""Existence: how probable it is that a thing of a category is there, from all looks at its place.

A hit of score s counts its odds, s / (1 - s), at most 5. A look that shows the whole place without
a detection of its most often seen category is a miss of the thing; it counts by how large the thing
is in the image. Looks from one viewpoint are correlated: the n-th counts 1 / n. With S the sum of a
category's hits and M of the thing's misses, the log-odds against there being nothing are

    SEEN ln(1 + S) - MISSED ln(1 + M) + SIZE size_log_likelihood + beyond - NOTHING

where `beyond` is below 0 if the box that is grown from the surface is too large for the category,
or less than half of a large thing. While a run has looked from few viewpoints, `early` is added:
mistakes become candidates as views add up, and things that are there do not.
While a thing is followed from frame to frame, its categories are judged one by one: M is then of
looks without that category, weighed by MISSED_NAME, and the box does not count. The logarithm lets
evidence saturate, since detectors repeat their mistakes. One look never reaches 0.93. The numbers
were chosen on tracks of real rooms and simulated houses (lab/research/mapping_trials.md); they hold
for every detector.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.usual_sizes import UsualSize
from mapping.frames.projection import to_camera
from mapping.objects.settings import ObjectSettings
from perception.frames import Frame

SEEN: Final = 2.25
MISSED: Final = 1.3
MISSED_NAME: Final = 1.5  # of a look without the one category, while things are followed
SIZE: Final = 0.95
NOTHING: Final = 2.65
EARLY: Final = 0.3  # times the logarithm of MANY / viewpoints, while these are few, less NOTHING
MANY: Final = 33  # viewpoints of a run
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

    def log_odds(self, missed: float, fit: float, weight: float = MISSED) -> float:
        """Log-odds after `missed` looks in vain at a thing whose size fits the category so well."""
        misses = weight * math.log1p(max(missed, 0.0))
        return SEEN * math.log1p(self.strength) - misses + fit - NOTHING

    def set_log_odds(self, log_odds: float, fit: float) -> None:
        """Choose the hits so that these `log_odds` follow before any look."""
        self.strength = math.expm1(max(log_odds + NOTHING - fit, 0.0) / SEEN)


def strength(score: float) -> float:
    """Evidence of one detection with `score` in 0..1."""
    return score / max(1 - score, score / MAX_ODDS)


def visibility(side: float) -> float:
    """Weight of a miss of a thing whose `side` is that share of the image's, in 0..1."""
    return 1 / (1 + (HALF_SEEN / max(side, 1e-6)) ** 2)


def early(viewpoints: int) -> float:
    """Log-odds that things gain while a run has looked from few `viewpoints`; 0: from unknown."""
    return EARLY * math.log(MANY / viewpoints) if 0 < viewpoints < MANY else 0.0


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


Floats = NDArray[np.float64]

SPREAD: Final = 0.5  # standard deviation of log size within a category
OCCLUDED: Final = 0.35  # weight of a deviation below: hidden and cut things look smaller
WORST: Final = -4.0  # an outlier by size costs no more than this
BEYOND: Final = 0.1  # a side so much beyond the greatest usual one, in logarithms, costs 1


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


def beyond(sides: Sequence[float], usual: UsualSize | None, size: float = 0.0) -> float:
    """Log-likelihood of the `sides` [m] of a thing's box (none: unknown) in a category, 0 at best.

    No side is longer than that of the largest things of a category. Shorter ones say nothing, since
    a box may hold only a part, but of large things it holds half at least. Without a box the
    longest dimension `size` [m] counts, 0 where it is unknown.
    """
    longest = max(sides, default=size)
    if usual is None or longest <= 0:
        return 0.0
    misfit = max(usual.excess(sides) if sides else 1.0, usual.lack(longest))
    return max(-math.log(misfit) / BEYOND, WORST)


class VolumeView(Enum):
    """View of a volume in a frame."""

    NOTHING = "not in view, hidden, or cut by the border"
    SURFACE = "rays end inside it"
    EMPTY = "rays go through it"


def in_front(frame: Frame, positions: Floats, settings: ObjectSettings) -> NDArray[np.intp]:
    """Indices of the positions (n, 3) [m] that project into the image, within range."""
    if not len(positions):
        return np.zeros(0, dtype=np.intp)
    p_cam = to_camera(frame.T_map_cam, positions)
    depth = p_cam[:, 2]
    near, far = settings.nearest_sight, settings.farthest_sight
    height, width = frame.depth.shape
    with np.errstate(divide="ignore", invalid="ignore"):
        columns = frame.K[0, 0] * p_cam[:, 0] / depth + frame.K[0, 2]
        rows = frame.K[1, 1] * p_cam[:, 1] / depth + frame.K[1, 2]
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    return np.nonzero((depth > near) & (depth < far) & inside)[0]


def ray_test(frame: Frame, p_map: Floats, size: float, settings: ObjectSettings) -> VolumeView:
    """View in `frame` of a volume of side `size` [m] around `p_map` (3,) [m]."""
    s = settings
    x, y, depth = to_camera(frame.T_map_cam, p_map)
    half = size / 2 * frame.K[0, 0] / depth
    column = frame.K[0, 0] * x / depth + frame.K[0, 2]
    row = frame.K[1, 1] * y / depth + frame.K[1, 2]
    height, width = frame.depth.shape
    margin = half + s.sight_margin
    if not (margin <= column <= width - margin and margin <= row <= height - margin):
        return VolumeView.NOTHING
    reach, step = max(0.6 * half, 3.0), max(1, int(half / 10))
    top, left = int(row - reach), int(column - reach)
    depths = frame.depth[
        max(top, 0) : int(row + reach) + 1 : step, max(left, 0) : int(column + reach) + 1 : step
    ]
    depths = depths[depths > 0]
    if len(depths) < 4:
        return VolumeView.NOTHING
    tolerance = 0.5 * size + s.ray_tolerance + s.ray_noise * depth**2
    before = float((depths < depth - tolerance).mean())
    beyond = float((depths > depth + tolerance).mean())
    if before > s.occluded:
        return VolumeView.NOTHING
    if beyond > s.empty:
        return VolumeView.EMPTY
    return VolumeView.SURFACE if 1 - before - beyond > 0.4 else VolumeView.NOTHING
