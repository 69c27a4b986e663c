"""Scores of probabilities: log loss, Brier score, calibration, and rooms visited until found."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
BINS = 10


def log_loss(p: Vector, held: Vector) -> float:
    """Mean of -ln p(what is the case) [nats]; `p` strictly between 0 and 1, `held` 0 or 1."""
    return float(-np.mean(held * np.log(p) + (1 - held) * np.log1p(-p)))


def brier(p: Vector, held: Vector) -> float:
    """Mean squared error of the probabilities."""
    return float(np.mean((p - held) ** 2))


def calibration_error(p: Vector, held: Vector, *, equal_mass: bool = False) -> float:
    """Expected calibration error over ten bins: mean |share that held - mean p|, by bin size.

    Bins have equal width, or equal mass: as many probabilities in each (ties stay in the order of
    `p`). Source: Naeini et al., AAAI 2015.
    """
    if equal_mass:
        order = np.argsort(p, kind="stable")
        parts = [part for part in np.array_split(order, BINS) if len(part)]
    else:
        number = np.minimum((p * BINS).astype(int), BINS - 1)
        parts = [np.flatnonzero(number == b) for b in range(BINS) if np.any(number == b)]
    gaps = [len(part) * abs(float(held[part].mean() - p[part].mean())) for part in parts]
    return sum(gaps) / len(p)


def rooms_visited(p: Vector, held: Vector) -> float:
    """The number of rooms that are entered until the first that holds it, the likeliest first.

    Rooms of one probability come in random order; the expectation is exact: of t such rooms of
    which h hold it, the first is the (t + 1) / (h + 1)-th. `held` must have at least one 1.
    """
    before = 0
    for value in np.unique(np.round(p, 12))[::-1]:
        tied = np.round(p, 12) == value
        hits = float(held[tied].sum())
        if hits:
            return before + (float(tied.sum()) + 1) / (hits + 1)
        before += int(tied.sum())
    raise ValueError("no room holds it")


@dataclass(frozen=True, slots=True)
class Predictions:
    """Predictions of one method for one building: pairs of room and object, and searches."""

    p: Vector  # (n,) probabilities
    held: Vector  # (n,) 1 where the room holds the object, else 0
    visited: Vector  # (q,) rooms visited, one for each object that is anywhere in the building
    anywhere: Vector  # (s,) probability that any room of the building holds each object sought
    present: Vector  # (s,) 1 where one does, else 0


#: a score of several buildings
Measure = Callable[[Sequence[Predictions]], float]


def pooled(
    score: Callable[[Vector, Vector], float], names: tuple[str, str] = ("p", "held")
) -> Measure:
    """A score of two vectors of several buildings as one, all entries alike."""

    def measure(outcomes: Sequence[Predictions]) -> float:
        p, held = (np.concatenate([getattr(o, name) for o in outcomes]) for name in names)
        return score(p, held)

    return measure


def mean_visited(outcomes: Sequence[Predictions]) -> float:
    """Mean rooms visited over all searches; nan without any."""
    visited = np.concatenate([o.visited for o in outcomes])
    return float(visited.mean()) if len(visited) else float("nan")


MEASURES: dict[str, Measure] = {
    "log_loss": pooled(log_loss),
    "brier": pooled(brier),
    "ece": pooled(calibration_error),
    "ece_equal_mass": pooled(lambda p, held: calibration_error(p, held, equal_mass=True)),
    "rooms_visited": mean_visited,
    "floor_ece": pooled(calibration_error, ("anywhere", "present")),
}


def resampled(outcomes: Sequence[Predictions], draws: NDArray[np.int64]) -> dict[str, Vector]:
    """Every measure for every resampling; `draws` (d, b) has indices of `outcomes`, repeated.

    Works on sums a building, so a draw costs next to nothing. The bins of equal mass stay those of
    all buildings together.
    """
    pairs = np.array([float(len(o.p)) for o in outcomes])
    losses = np.array([log_loss(o.p, o.held) if len(o.p) else 0.0 for o in outcomes]) * pairs
    squares = np.array([float(((o.p - o.held) ** 2).sum()) for o in outcomes])
    searches = np.array([float(len(o.visited)) for o in outcomes])
    visited = np.array([float(o.visited.sum()) for o in outcomes])
    wide = np.linspace(0, 1, BINS + 1)[1:-1]
    even = np.quantile(np.concatenate([o.p for o in outcomes]), wide)

    def mean(sums: Vector, counts: Vector) -> Vector:
        with np.errstate(invalid="ignore"):
            return np.asarray(sums[draws].sum(1) / counts[draws].sum(1))

    def gap(edges: Vector) -> Vector:
        sums = np.array([_gaps(o, edges) for o in outcomes])
        return np.asarray(np.abs(sums[draws].sum(1)).sum(1) / pairs[draws].sum(1))

    return {
        "log_loss": mean(losses, pairs),
        "brier": mean(squares, pairs),
        "ece": gap(wide),
        "ece_equal_mass": gap(even),
        "rooms_visited": mean(visited, searches),
    }


def _gaps(outcome: Predictions, edges: Vector) -> Vector:
    """(bins,) sum of held - p in each bin."""
    number = np.digitize(outcome.p, edges)
    sums = np.bincount(number, weights=outcome.held - outcome.p, minlength=BINS)
    return np.asarray(sums, dtype=np.float64)


def interval(values: Vector) -> tuple[float, float]:
    """The 95 % percentile interval."""
    low, high = np.nanpercentile(values, [2.5, 97.5])
    return float(low), float(high)
