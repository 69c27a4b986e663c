"""Search ordering problem: where an object may be, travel times, and times to explore."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kg.model.errors import HereaboutsError
from planner.search.plans.thesis_rules import expected_seconds

FloatArray = NDArray[np.floating]

#: Dependence of the probabilities of the places.
#: ``single``: exactly one instance, in place k with probability p[k] / sum(p).
#: ``any``: instances independent between places; any instance ends the search.
SearchModel = Literal["single", "any"]

MAX_NUMBER: Final = 1e12  # of any number: sums and products of many stay finite


class OrderingError(HereaboutsError):
    """A search problem makes no sense: sizes differ, a time is negative, no probability."""


@dataclass(frozen=True, slots=True, eq=False)
class OrderingProblem:
    """Ordering problem: n places, their probabilities, and the travel times between them.

    `T` may be float32 where ten thousand places would not fit in memory otherwise; it need neither
    be symmetric nor obey the triangle inequality. Raises OrderingError where shapes differ, a
    number is not finite, is negative or beyond `MAX_NUMBER`, or every probability is 0.
    """

    p: FloatArray  # (n,) probabilities; in the model `any` each at most 1
    T: FloatArray  # (n, n) [s] travel from place to place
    t0: FloatArray  # (n,) [s] travel from the start to each place
    explore: FloatArray  # (n,) [s] to explore a place once there
    model: SearchModel = "single"

    def __post_init__(self) -> None:
        if self.model not in ("single", "any"):
            raise OrderingError(f"model must be 'single' or 'any', got {self.model!r}")
        p = _numbers("p", self.p)
        n = len(p) if p.ndim == 1 else -1
        for name, shape in (("p", (n,)), ("T", (n, n)), ("t0", (n,)), ("explore", (n,))):
            array = _numbers(name, getattr(self, name))
            if array.shape != shape or n < 1:
                wanted = "(n,) with n >= 1" if name == "p" else str(shape)
                raise OrderingError(f"{name} must have shape {wanted}, got {array.shape}")
            _check_range(name, array)
            object.__setattr__(self, name, array)
        if self.model == "any" and p.max() > 1:
            raise OrderingError(f"p must be at most 1 in the model 'any', got {p.max():g}")
        if not p.sum() > 0:
            raise OrderingError("p is 0 everywhere: nothing can be found; leave the problem out")

    @property
    def size(self) -> int:
        """Number of places n."""
        return len(self.p)

    def arrivals(self, order: ArrayLike) -> NDArray[np.float64]:
        """Arrival times (k,) [s]: until each place of `order` (k,) has been explored."""
        sites = np.asarray(order, dtype=np.intp)
        legs = np.empty(len(sites))
        legs[:1] = self.t0[sites[:1]]
        legs[1:] = self.T[sites[:-1], sites[1:]]
        return np.cumsum(legs + self.explore[sites])

    def expected_seconds(self, order: ArrayLike) -> float:
        """Expected time [s] to find along `order`, a permutation of all places."""
        sites = np.asarray(order, dtype=np.intp)
        when, p = self.arrivals(sites), np.asarray(self.p[sites], np.float64)
        if self.model == "single":
            return float(when @ (p / p.sum()))
        found = expected_seconds(when, p)
        assert found is not None, "some probability is positive"
        return found


def _numbers(name: str, values: object) -> FloatArray:
    try:
        array = np.asarray(values)
        if array.dtype.kind == "f":
            return array
        if array.dtype.kind in "iu" or array.size == 0:
            return array.astype(np.float64)
    except (TypeError, ValueError):
        pass
    raise OrderingError(f"{name} must be numbers in rows of equal length")


def _check_range(name: str, array: FloatArray) -> None:
    low, high = float(array.min()), float(array.max())
    if not (np.isfinite(low) and np.isfinite(high)):
        raise OrderingError(f"{name} must be finite, got {low if np.isfinite(high) else high:g}")
    if low < 0:
        raise OrderingError(f"{name} must be 0 or more, got {low:g}")
    if high > MAX_NUMBER:
        raise OrderingError(f"{name} must be at most {MAX_NUMBER:g}, got {high:g}")
