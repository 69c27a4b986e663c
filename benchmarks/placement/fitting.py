"""Fit the model's parameters: the likelihood of what real buildings hold, at its maximum.

Every building is one draw: of N rooms of a kind, K hold the object, Beta-binomial with the alpha
and beta the model gives from all other buildings. Each pair counts in four ways, so that numbers
serve where there is less to go by: with all statistics, without those of the very pair (a rare
category), without any statistics (ontology and ConceptNet), and with the ontology alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import astuple, dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.placement.model import (
    EvidenceArrays,
    Matrix,
    log_beta_binomial,
    logit,
    posterior_belief,
    sigmoid,
)
from kg.placement.settings import VAGUE_STRENGTH, PlacementParameters

Vector = NDArray[np.float64]

_START: Final = PlacementParameters(-3.0, 0.5, 0.5, 0.7, 0.2, 10.0, 0.9, 10.0)
_WIDEST: Final = 5.0  # of ln(kappa), ln(tau); and the most any share can be
_PULL: Final = 0.05  # loss of log-likelihood for each squared unit away from the start
_PULL_OF_KIND: Final = 0.1  # the same, of one kind of building's numbers away from all buildings'
#: positions in Parameters: those in rooms, and the probability
_ROOMS: Final = [5, 7]
_TRUST: Final = 6
#: numbers that a kind of building has of its own
_OWN: Final = [5, 6, 7]


@dataclass(frozen=True, slots=True)
class Sample:
    """Buildings to fit to; arrays (buildings, objects, places)."""

    evidence: EvidenceArrays  # its counts (b, n, m): of all other buildings
    rooms: Matrix  # (b, n, m) rooms of the building searched for the object
    held: Matrix  # (b, n, m) of those, the ones that held it

    def without(self, building: int) -> Sample:
        """All buildings but one."""
        return self.only(n for n in range(len(self.rooms)) if n != building)

    def only(self, buildings: Iterable[int]) -> Sample:
        """Some of the buildings."""
        keep = list(buildings)
        evidence = replace(
            self.evidence,
            rooms=self.evidence.rooms[keep],
            rooms_with=self.evidence.rooms_with[keep],
        )
        return Sample(evidence, self.rooms[keep], self.held[keep])


def fit(
    sample: Sample, start: PlacementParameters = _START, steps: int = 1200
) -> PlacementParameters:
    """The parameters that make the sample likeliest; deterministic."""
    anchor = _numbers(_START)

    def cost(x: Vector) -> float:
        return _PULL * float(np.sum((x - anchor) ** 2)) - _likelihood(sample, _parameters(x))

    return _parameters(minimise(cost, _numbers(start), steps))


def fit_kind(sample: Sample, overall: PlacementParameters, steps: int = 160) -> PlacementParameters:
    """The numbers of one kind of building: its own lift and strength of what is expected.

    Empirical Bayes: the others stay those fitted to all buildings, and these four are pulled
    towards them; few buildings of a kind move them little.
    """
    numbers = _numbers(overall)
    anchor = np.array([0.0, *numbers[_OWN]])

    def moved(x: Vector) -> PlacementParameters:
        own = numbers.copy()
        own[_OWN] = x[1:]
        return replace(_parameters(own), lift=float(x[0]))

    def cost(x: Vector) -> float:
        away = float(np.sum((x - anchor) ** 2))
        return _PULL_OF_KIND * away - _counted_likelihood(sample, moved(x))

    return moved(minimise(cost, anchor, steps))


def log_likelihood(sample: Sample, parameters: PlacementParameters) -> float:
    """ln p(the buildings) in the four ways, less a weak pull of the numbers towards the start."""
    away = _numbers(parameters) - _numbers(_START)
    return _likelihood(sample, parameters) - _PULL * float(np.sum(away**2))


def _counted_likelihood(sample: Sample, parameters: PlacementParameters) -> float:
    full = posterior_belief(sample.evidence, parameters)
    return _beta_binomial(sample, full.alpha, full.beta)


def _likelihood(sample: Sample, parameters: PlacementParameters) -> float:
    p, evidence = parameters, sample.evidence
    nothing = np.zeros_like(evidence.rooms[:1])
    bare = replace(evidence, rooms=nothing, rooms_with=nothing)
    full, bare_belief = posterior_belief(evidence, p), posterior_belief(bare, p)
    alone = posterior_belief(replace(bare, weight=np.zeros_like(bare.weight)), p)
    strength = 1 / (1 / p.tau + 1 / (p.trust * p.kappa + (1 - p.trust) * VAGUE_STRENGTH))
    return (
        _beta_binomial(sample, full.alpha, full.beta)
        + _beta_binomial(sample, strength * full.prior, strength * (1 - full.prior))
        + _beta_binomial(sample, bare_belief.alpha, bare_belief.beta)
        + _beta_binomial(sample, alone.alpha, alone.beta)
    )


def _beta_binomial(sample: Sample, alpha: Matrix, beta: Matrix) -> float:
    """Sum of ln B(alpha + K, beta + N - K) / B(alpha, beta)."""
    cells = sample.rooms > 0
    a, b = (np.broadcast_to(x, cells.shape)[cells] for x in (alpha, beta))
    return float(log_beta_binomial(a, b, sample.rooms[cells], sample.held[cells]).sum())


def _numbers(p: PlacementParameters) -> Vector:
    x = np.array(astuple(p)[:-1])  # without the lift
    x[_ROOMS] = np.log(x[_ROOMS])
    x[_TRUST] = logit(x[_TRUST])
    return x


def _parameters(x: Vector) -> PlacementParameters:
    shares = np.clip(np.abs(x[1:5]), 0, _WIDEST)
    kappa, tau = map(float, np.exp(np.clip(x[_ROOMS], -1, _WIDEST)))
    edge, conceptnet, across_places, across_objects = map(float, shares)
    trust = float(sigmoid(x[_TRUST]))
    return PlacementParameters(
        float(x[0]), edge, conceptnet, across_places, across_objects, kappa, trust, tau
    )


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
