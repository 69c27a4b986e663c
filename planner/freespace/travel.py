"""What a search costs: straight-line travel, a fixed time at each stop, the expected time to find.

Pure functions over arrays. Positions are (x, y) in metres in the map frame, times in seconds from
the start of the search.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

#: How the probabilities of the stops hang together.
#: ``single``: exactly one instance, in stop k with probability p[k] / sum(p).
#: ``any``: instances independent between stops, any one will do.
SearchModel = Literal["single", "any"]


@dataclass(frozen=True, slots=True)
class Travel:
    """Cost of moving and of looking, as they explain the times of the thesis' Table 4.5.

    Raises ValueError for a speed that is not positive or a negative time.
    """

    speed: float = 0.2412  # [m/s] on straight lines; fitted to Table 4.5, R^2 0.965
    explore: float = 41.79  # [s] to turn once and look at a place; thesis section 4.4

    def __post_init__(self) -> None:
        if not self.speed > 0 or not self.explore >= 0:
            raise ValueError(f"speed must be > 0 and explore >= 0, got {self}")


def distances(p_from: ArrayLike, p_to: ArrayLike) -> NDArray[np.float64]:
    """Straight-line distances (n,) [m] from one position (2,) to each of (n, 2)."""
    offset = np.asarray(p_to, dtype=np.float64).reshape(-1, 2) - np.asarray(p_from, np.float64)
    return np.hypot(offset[:, 0], offset[:, 1])


def travelled(start: ArrayLike, stops: ArrayLike) -> NDArray[np.float64]:
    """Metres (n,) travelled from `start` (2,) until each of `stops` (n, 2), in their order."""
    points = np.vstack([np.reshape(start, (1, 2)), np.reshape(stops, (-1, 2))]).astype(np.float64)
    legs = np.diff(points, axis=0)
    return np.cumsum(np.hypot(legs[:, 0], legs[:, 1]))


def arrival_seconds(
    start: ArrayLike, stops: ArrayLike, travel: Travel | None = None
) -> NDArray[np.float64]:
    """Seconds (n,) until each of `stops` (n, 2) has been reached and explored, in their order."""
    travel = travel or Travel()
    metres = travelled(start, stops)
    return metres / travel.speed + travel.explore * np.arange(1, len(metres) + 1)


def expected_seconds(
    arrivals: ArrayLike, probabilities: ArrayLike, model: SearchModel = "single"
) -> float | None:
    """Expected seconds until the first success, given that there is one somewhere among the stops.

    `arrivals` (n,) [s] in visiting order, `probabilities` (n,) in the same order:

    - single: sum p[k] arrival(k) / sum p
    - any: sum arrival(k) P(first at k) / P(anywhere), P(first at k) = p[k] prod_{j<k} (1 - p[j])

    None when no stop has any probability. Raises ValueError for arrays of different length, and for
    probabilities below 0 or, in the model `any`, above 1.
    """
    when = np.asarray(arrivals, dtype=np.float64)
    p = np.asarray(probabilities, dtype=np.float64)
    if when.shape != p.shape or when.ndim != 1:
        raise ValueError(f"arrivals and probabilities must be (n,), got {when.shape}, {p.shape}")
    if np.any(p < 0) or (model == "any" and np.any(p > 1)):
        raise ValueError(f"probabilities must lie in 0..1, got {p.min():g} to {p.max():g}")
    first = p * np.cumprod(np.concatenate([[1.0], 1.0 - p[:-1]])) if model == "any" else p
    total = float(first.sum())
    return float(when @ (first / total)) if total > 0 else None
