"""Looks that can fail: the belief after a miss, and a search that comes back where it pays.

Bayes' rule, and the rule of most probability a second, which is optimal without travel where looks
at one place help less and less (Stone, Theory of Optimal Search, 1975, ch. 4); with travel it is a
heuristic. Time limits play no part: the plan is the same on every machine.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmarks.ordering.problem import OrderingError, OrderingProblem
from planner.search.plans.thesis_rules import SearchModel

Array = NDArray[np.float64]
#: why a plan ends
Ending = Literal["price", "epsilon", "stops"]


@dataclass(frozen=True, slots=True)
class PlannedLook:
    """One look."""

    site: int
    seconds: float  # [s] from the start until it is over
    gain: float  # probability to find at this look, as seen from the start
    left: float  # probability that the thing is somewhere and still not found after this look


@dataclass(frozen=True, slots=True)
class MissPlan:
    """Looks in order, until they do not pay any more."""

    stops: tuple[PlannedLook, ...]
    found: float  # probability that one of them finds
    expected_seconds: float  # [s] to find, given that one of them does; nan without looks
    ending: Ending


def update_after_miss(
    p: ArrayLike, k: int, detection: float, model: SearchModel = "single"
) -> Array:
    """Probabilities (n,) after a look at place `k` that would have detected with `detection`.

    In the model `single` what `p` lacks to 1 is the probability that the thing is nowhere; it grows
    like the other places. In the model `any` the other places keep theirs. Bayes' rule. Raises
    OrderingError for numbers outside 0..1, and where a miss was impossible.
    """
    prior = _probabilities(p, model)
    if not 0 <= k < len(prior):
        raise OrderingError(f"place must be 0 to {len(prior) - 1}, got {k}")
    _check_share("detection", detection)
    miss = 1.0 - detection * prior[k]
    if miss <= 0:
        raise OrderingError(f"a miss at place {k} cannot happen: p is 1 and detection 1")
    posterior = prior / miss if model == "single" else prior.copy()
    posterior[k] = prior[k] * (1.0 - detection) / miss
    return posterior


def missed(looks: ArrayLike, detection: ArrayLike, rho: float) -> Array:
    """Probability that all of `looks` at one place miss a thing that is there.

    A share `rho` of the misses of one look lasts, whatever the number of looks (hidden from there,
    not known to the detector); the rest fall anew each time. rho 0: (1 - d)^looks; rho 1: 1 - d.
    """
    d, count = np.asarray(detection, np.float64), np.asarray(looks, np.float64)
    lasting = rho * (1.0 - d)
    again = np.divide(1.0 - d - lasting, 1.0 - lasting, out=np.zeros_like(d), where=lasting < 1)
    return np.asarray(lasting + (1.0 - lasting) * again**count, dtype=np.float64)


def plan_with_misses(
    problem: OrderingProblem,
    detection: ArrayLike,
    *,
    rho: float = 0.0,
    price: float = 0.0,
    epsilon: float = 0.01,
    most: int = 1000,
) -> MissPlan:
    """Looks in the order of most probability a second; a place may come again.

    `detection` is one probability or (n,); `rho` the share of misses that lasts (see `missed`). The
    plan ends before a look whose probability to find, given that all before it missed, is below
    `price` a second; once less than `epsilon` is left to be found; or after `most` looks. p of the
    model `single` must sum to 1 or less. Raises OrderingError for numbers outside their range.
    """
    p = _probabilities(problem.p, problem.model)
    d = np.broadcast_to(np.asarray(detection, np.float64), p.shape)
    for name, least, greatest in (("detection", d.min(), d.max()), ("rho", rho, rho)):
        _check_share(name, least)
        _check_share(name, greatest)
    if not (price >= 0 and epsilon >= 0 and most >= 0):
        raise OrderingError(
            f"price, epsilon and most must be 0 or more, got {price}, {epsilon}, {most}"
        )
    return _Search(problem, p, d, rho).run(price, epsilon, most)


class _Search:
    """A search in the making: how often each place was looked at, and where the robot stands."""

    def __init__(self, problem: OrderingProblem, p: Array, d: Array, rho: float) -> None:
        self.problem, self.p, self.d, self.rho = problem, p, d, rho
        self.looks = np.zeros(len(p), dtype=np.int64)
        self.seconds, self.away = 0.0, np.asarray(problem.t0, np.float64)

    def unfound(self) -> tuple[float, float]:
        """Probability not to have found yet; and of that, that it is somewhere."""
        found = self.p * (1.0 - missed(self.looks, self.d, self.rho))
        if self.problem.model == "any":
            not_yet = float(np.prod(1.0 - found))
            return not_yet, not_yet - float(np.prod(1.0 - self.p))
        return 1.0 - float(found.sum()), float(self.p.sum() - found.sum())

    def chances(self) -> Array:
        """(n,) probability that a look at each place finds now, given that none has."""
        now, then = (missed(self.looks + more, self.d, self.rho) for more in (0, 1))
        gains = self.p * (now - then)
        if self.problem.model == "any":
            still = 1.0 - self.p * (1.0 - now)
        else:
            still = np.full(len(self.p), self.unfound()[0])
        return np.divide(gains, still, out=np.zeros_like(gains), where=still > 0)

    def run(self, price: float, epsilon: float, most: int) -> MissPlan:
        """Look where it pays most until it does not pay."""
        stops: list[PlannedLook] = []
        ending: Ending = "stops"
        not_yet, left = self.unfound()
        while len(stops) < most:
            if left <= max(epsilon, 1e-12):
                ending = "epsilon"
                break
            cost = np.maximum(self.away + self.problem.explore, 1e-9)
            chances = self.chances()
            site = int(np.argmax(chances / cost))
            if chances[site] <= 0 or chances[site] / cost[site] < price:
                ending = "price"
                break
            self._look(site)
            before, (not_yet, left) = not_yet, self.unfound()
            stops.append(PlannedLook(site, self.seconds, before - not_yet, left))
        return _plan(stops, ending)

    def _look(self, site: int) -> None:
        self.seconds += float(self.away[site] + self.problem.explore[site])
        self.looks[site] += 1
        self.away = np.array(self.problem.T[site], dtype=np.float64)
        self.away[site] = 0.0


def _plan(stops: list[PlannedLook], ending: Ending) -> MissPlan:
    found = sum(stop.gain for stop in stops)
    weighted = sum(stop.gain * stop.seconds for stop in stops)
    return MissPlan(tuple(stops), found, weighted / found if found > 0 else float("nan"), ending)


def _probabilities(p: ArrayLike, model: SearchModel) -> Array:
    array = np.asarray(p, dtype=np.float64)
    if array.ndim != 1 or not len(array) or not (array.min() >= 0 and array.max() <= 1):
        raise OrderingError("p must be (n,) probabilities from 0 to 1")
    if model == "single" and array.sum() > 1 + 1e-9:
        raise OrderingError(f"p must sum to 1 at most in the model 'single', got {array.sum():g}")
    return array


def _check_share(name: str, value: float) -> None:
    if not 0 <= value <= 1:
        raise OrderingError(f"{name} must lie in 0..1, got {value}")
