"""Calibration of probabilities: how often what was predicted came true.

Expected calibration error (Guo et al., On Calibration of Modern Neural Networks, 2017) over ten
bins of equal width.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np

BINS: Final = 10


@dataclass(frozen=True, slots=True)
class CalibrationBin:
    """Cases whose predicted probability lies in one interval."""

    lower: float
    upper: float
    cases: int
    predicted: float  # mean probability
    true: float  # share that came true


@dataclass(frozen=True, slots=True)
class Calibration:
    """Reliability of predicted probabilities."""

    cases: int
    ece: float | None  # mean |predicted - true| over cases; None: there are none
    bins: tuple[CalibrationBin, ...]  # those that hold cases


def reliability(outcomes: Iterable[tuple[float, bool]]) -> Calibration:
    """Calibration of predicted probabilities, each with whether it came true."""
    pairs = list(outcomes)
    chance = np.clip([predicted for predicted, _ in pairs], 0.0, 1.0)
    true = np.array([outcome for _, outcome in pairs], dtype=np.float64)
    index = np.minimum((chance * BINS).astype(np.intp), BINS - 1)
    bins = tuple(
        CalibrationBin(
            lower=b / BINS,
            upper=(b + 1) / BINS,
            cases=int(np.sum(index == b)),
            predicted=float(np.mean(chance[index == b])),
            true=float(np.mean(true[index == b])),
        )
        for b in np.unique(index).tolist()
    )
    error = sum(b.cases * abs(b.predicted - b.true) for b in bins)
    return Calibration(len(pairs), error / len(pairs) if pairs else None, bins)
