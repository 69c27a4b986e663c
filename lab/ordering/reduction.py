"""Reduction of an ordering problem: one leg matrix, only places worth a visit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.ordering.problem import OrderingProblem

Floats = NDArray[np.floating]
Ints = NDArray[np.intp]

#: up to so many places it is checked whether one without probability is a shortcut
_SHORTCUTS_UP_TO = 1000
#: up to so many places legs are kept in double precision whatever they come in
_DOUBLE_UP_TO = 2000


@dataclass(frozen=True, slots=True, eq=False)
class ReducedProblem:
    """Ordering problem of the m places that matter; the last row of `D` leaves from the start.

    An order's cost is the sum over its legs of leg time x probability left before the leg ends,
    which is the same number as the sum over places of probability of the first find x arrival.
    """

    D: Floats  # (m + 1, m) [s] travel plus look of the column's place; row m leaves from the start
    w: NDArray[np.float64]  # (m,) `single`: p / sum p; `any`: p
    any: bool
    sites: Ints  # (m,) which places of the problem these are
    rest: Ints  # places that are visited last or never

    @property
    def size(self) -> int:
        """The number of places that matter."""
        return len(self.w)

    @property
    def root(self) -> int:
        """The row of the start."""
        return len(self.w)

    @property
    def norm(self) -> float:
        """Probability that there is anything to find; cost / norm is the expected time [s]."""
        return present_anywhere(self.w) if self.any else float(self.w.sum())

    def cost(self, order: Ints) -> float:
        """Cost of `order` (m,): sum of first-find probability x arrival [s]."""
        legs = np.concatenate([self.D[self.root, order[:1]], self.D[order[:-1], order[1:]]])
        w = self.w[order]
        first = w * np.concatenate([[1.0], np.cumprod(1.0 - w[:-1])]) if self.any else w
        return float(first @ np.cumsum(legs, dtype=np.float64))


def present_anywhere(p: Floats) -> float:
    """Probability that at least one of independent `p` (m,) comes true, exact for small ones."""
    if p.max() >= 1:
        return 1.0
    return float(-np.expm1(np.log1p(-p).sum()))


def reduce_problem(problem: OrderingProblem) -> ReducedProblem:
    """`problem` without the places that cannot help.

    A place without probability is left out unless a path through such places beats a direct leg
    (their looks included): then it may be worth visiting on the way, and all are kept.
    """
    worth = problem.p > 0
    if not worth.all() and problem.size <= _SHORTCUTS_UP_TO and _shortcut(problem, worth):
        worth = np.ones_like(worth)
    sites = np.flatnonzero(worth)
    T = problem.T if worth.all() else problem.T[np.ix_(sites, sites)]
    D = np.empty(
        (len(sites) + 1, len(sites)), dtype=T.dtype if len(sites) > _DOUBLE_UP_TO else np.float64
    )
    np.add(T, problem.explore[sites], out=D[:-1], casting="same_kind")
    np.add(problem.t0[sites], problem.explore[sites], out=D[-1], casting="same_kind")
    p = problem.p[sites].astype(np.float64)
    some = problem.model == "any"
    rest = np.flatnonzero(~worth)
    return ReducedProblem(D, p if some else p / p.sum(), some, sites, rest)


def _shortcut(problem: OrderingProblem, worth: NDArray[np.bool_]) -> bool:
    """Whether detours over places without probability shorten a leg between places with some."""
    if not _first_steps(problem, worth):
        return False
    direct = np.vstack([problem.T, problem.t0[None]]).astype(np.float64)
    short = direct.copy()
    for via in np.flatnonzero(~worth):
        np.minimum(short, short[:, via, None] + problem.explore[via] + short[via], out=short)
    kept = np.append(worth, True)
    return bool(
        np.any((short < direct - 1e-9 * (1 + direct))[np.ix_(kept, worth)] & _off(kept, worth))
    )


def _first_steps(problem: OrderingProblem, worth: NDArray[np.bool_]) -> bool:
    """Whether a way from a place with probability, or the start, is shorter by one without.

    If not, no number of them shortens one: each could be left out in turn.
    """
    idle = np.flatnonzero(~worth)
    leave = np.vstack([problem.T[worth], problem.t0[None]]).astype(np.float64)
    for via in idle:
        around = leave[:, via, None] + (problem.explore[via] + problem.T[via])
        if np.any(around < leave):
            return True
    return False


def _off(rows: NDArray[np.bool_], columns: NDArray[np.bool_]) -> NDArray[np.bool_]:
    apart: NDArray[np.bool_] = np.flatnonzero(rows)[:, None] != np.flatnonzero(columns)[None]
    return apart
