"""Calibration of existence: how often objects of each predicted probability are true.

Expected calibration error (Guo et al., On Calibration of Modern Neural Networks, 2017) over ten
bins of equal width. An object is true if it is matched at existence 0; duplicates, wrong labels and
ghosts are false; ignored ones are left out.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np

from mapping.evaluation.truth_matching import Matching

BINS: Final = 10


@dataclass(frozen=True, slots=True)
class CalibrationBin:
    """Objects whose predicted existence lies in one interval."""

    lower: float
    upper: float
    objects: int
    predicted: float  # mean existence
    true: float  # share that is true


@dataclass(frozen=True, slots=True)
class Calibration:
    """Reliability of predicted existence."""

    objects: int
    ece: float | None  # mean |predicted - true| over objects; None: no objects
    bins: tuple[CalibrationBin, ...]  # those that hold objects


def calibration(matchings: Iterable[Matching]) -> Calibration:
    """Calibration over all objects of one or several maps, matched at existence 0."""
    return reliability(pair for matching in matchings for pair in _outcomes(matching))


def reliability(outcomes: Iterable[tuple[float, bool]]) -> Calibration:
    """Calibration of predicted probabilities, each with whether it came true."""
    pairs = list(outcomes)
    existence = np.clip([predicted for predicted, _ in pairs], 0.0, 1.0)
    true = np.array([outcome for _, outcome in pairs], dtype=np.float64)
    index = np.minimum((existence * BINS).astype(np.intp), BINS - 1)
    bins = tuple(
        CalibrationBin(
            lower=b / BINS,
            upper=(b + 1) / BINS,
            objects=int(np.sum(index == b)),
            predicted=float(np.mean(existence[index == b])),
            true=float(np.mean(true[index == b])),
        )
        for b in np.unique(index).tolist()
    )
    error = sum(b.objects * abs(b.predicted - b.true) for b in bins)
    return Calibration(len(pairs), error / len(pairs) if pairs else None, bins)


def _outcomes(matching: Matching) -> list[tuple[float, bool]]:
    """(existence, whether true) of each object that is not ignored."""
    mapped = matching.mapped
    false = (*matching.duplicates, *matching.wrong, *matching.ghosts)
    return [(mapped[pair.mapped].existence, True) for pair in matching.matched] + [
        (mapped[pair.mapped].existence, False) for pair in false
    ]
