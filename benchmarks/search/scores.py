"""Scores of searches: success, time, distance, SPL, success against time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from benchmarks.search.robot import TrialOutcome

#: [s] Success against time is looked at until here: a quarter of an hour.
HORIZON: Final = 900.0


@dataclass(frozen=True, slots=True)
class Score:
    """One way of searching over all queries."""

    success: float
    mean_seconds: float  # until found or given up
    mean_seconds_found: float | None  # of those found
    median_seconds: float
    worst_tenth_seconds: float  # mean of the slowest tenth
    mean_metres: float
    spl: float  # success weighted by (shortest way / way driven), Anderson et al. 2018
    auc: float  # area under success against time until `HORIZON`, 0..1
    mean_looks: float
    queries: int


def score(outcomes: Sequence[TrialOutcome], shortest: Sequence[TrialOutcome]) -> Score:
    """`outcomes` beside the clairvoyant's of the same queries; both (n,), n at least 1."""
    found = np.array([o.found for o in outcomes])
    seconds = np.array([o.seconds for o in outcomes])
    metres = np.array([o.metres for o in outcomes])
    best = np.array([o.metres for o in shortest])
    way = np.where(metres > best, best / np.maximum(metres, 1e-9), 1.0)
    return Score(
        success=float(found.mean()),
        mean_seconds=float(seconds.mean()),
        mean_seconds_found=float(seconds[found].mean()) if found.any() else None,
        median_seconds=float(np.median(seconds)),
        worst_tenth_seconds=float(np.sort(seconds)[-max(len(seconds) // 10, 1) :].mean()),
        mean_metres=float(metres.mean()),
        spl=float((found * way).mean()),
        auc=float((found * np.clip(1 - seconds / HORIZON, 0.0, 1.0)).mean()),
        mean_looks=float(np.mean([o.looks for o in outcomes])),
        queries=len(outcomes),
    )
