"""Fit the model's parameters: the likelihood of what real buildings hold, at its maximum.

Every building is one draw: of N rooms of a kind, K hold the object, Beta-binomial with the alpha
and beta the model gives from all other buildings. Each pair counts in four ways, so that numbers
serve where there is less to go by: with all statistics, without those of the very pair (a rare
category), without any statistics (ontology and ConceptNet), and with the ontology alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.placement.model import Evidence, Matrix, believe
from kg.placement.settings import Parameters

Vector = NDArray[np.float64]

_START: Final = Parameters(-3.0, 0.5, 0.5, 0.7, 0.2, 10.0, 10.0)
_WIDEST: Final = 5.0  # of ln(kappa), ln(tau); and the most any share can be


@dataclass(frozen=True, slots=True)
class Sample:
    """Buildings to fit to; arrays (buildings, objects, places)."""

    evidence: Evidence  # its counts (b, n, m): of all other buildings
    rooms: Matrix  # (b, n, m) rooms of the building searched for the object
    held: Matrix  # (b, n, m) of those, the ones that held it

    def without(self, building: int) -> Sample:
        """All buildings but one."""
        keep = np.arange(len(self.rooms)) != building
        evidence = replace(
            self.evidence,
            rooms=self.evidence.rooms[keep],
            rooms_with=self.evidence.rooms_with[keep],
        )
        return Sample(evidence, self.rooms[keep], self.held[keep])


def fit(sample: Sample, start: Parameters = _START, steps: int = 900) -> Parameters:
    """The parameters that make the sample likeliest; deterministic."""

    def cost(x: Vector) -> float:
        return -log_likelihood(sample, _parameters(x))

    return _parameters(minimise(cost, _numbers(start), steps))


def log_likelihood(sample: Sample, parameters: Parameters) -> float:
    """ln p(the buildings) in the four ways, less a weak pull of the numbers towards the start."""
    evidence = sample.evidence
    nothing = np.zeros_like(evidence.rooms[:1])
    bare = replace(evidence, rooms=nothing, rooms_with=nothing)
    full, bare_belief = believe(evidence, parameters), believe(bare, parameters)
    alone = believe(replace(bare, weight=np.zeros_like(bare.weight)), parameters)
    strength = 1 / (1 / parameters.tau + 1 / parameters.kappa)
    total = (
        _beta_binomial(sample, full.alpha, full.beta)
        + _beta_binomial(sample, strength * full.prior, strength * (1 - full.prior))
        + _beta_binomial(sample, bare_belief.alpha, bare_belief.beta)
        + _beta_binomial(sample, alone.alpha, alone.beta)
    )
    return total - 0.05 * float(np.sum((_numbers(parameters) - _numbers(_START)) ** 2))


def _beta_binomial(sample: Sample, alpha: Matrix, beta: Matrix) -> float:
    """Sum of ln B(alpha + K, beta + N - K) / B(alpha, beta) by rising factorials."""
    cells = sample.rooms > 0
    a, b = (np.broadcast_to(x, cells.shape)[cells] for x in (alpha, beta))
    n, k = sample.rooms[cells], sample.held[cells]
    return rising(a, k) + rising(b, n - k) - rising(a + b, n)


def rising(x: Vector, n: Vector) -> float:
    """Sum over the arrays of ln x (x + 1) ... (x + n - 1)."""
    total = 0.0
    for i in range(int(n.max(initial=0))):
        total += float(np.log(x[n > i] + i).sum())
    return total


def _numbers(p: Parameters) -> Vector:
    x = np.array(astuple(p))
    x[5:] = np.log(x[5:])
    return x


def _parameters(x: Vector) -> Parameters:
    shares = np.clip(np.abs(x[1:5]), 0, _WIDEST)
    rooms = np.exp(np.clip(x[5:], -1, _WIDEST))
    return Parameters(float(x[0]), *map(float, shares), *map(float, rooms))


def minimise(cost: Callable[[Vector], float], start: Vector, steps: int) -> Vector:
    """Where `cost` is least, by the simplex method of Nelder and Mead (1965)."""
    n = len(start)
    points = np.vstack([start, start + 0.4 * np.eye(n)])
    costs = np.array([cost(x) for x in points])
    for _ in range(steps):
        order = np.argsort(costs, kind="stable")
        points, costs = points[order], costs[order]
        if costs[-1] - costs[0] < 1e-6:
            break
        centre = points[:-1].mean(0)
        for factor in _moves(cost, centre, points, costs):
            points[-1], costs[-1] = factor
            break
        else:
            points[1:] = (points[1:] + points[0]) / 2
            costs[1:] = [cost(x) for x in points[1:]]
    return np.asarray(points[int(np.argmin(costs))])


def _moves(
    cost: Callable[[Vector], float], centre: Vector, points: Matrix, costs: Vector
) -> list[tuple[Vector, float]]:
    """The point that replaces the worst one: reflected, stretched or drawn in; none: shrink."""

    def tried(factor: float) -> tuple[Vector, float]:
        x = centre + factor * (points[-1] - centre)
        return x, cost(x)

    mirrored = tried(-1.0)
    if mirrored[1] < costs[0]:
        farther = tried(-2.0)
        return [min(mirrored, farther, key=lambda found: found[1])]
    if mirrored[1] < costs[-2]:
        return [mirrored]
    nearer = tried(-0.5 if mirrored[1] < costs[-1] else 0.5)
    return [nearer] if nearer[1] < min(costs[-1], mirrored[1]) else []
