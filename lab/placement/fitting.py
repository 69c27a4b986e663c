"""Fit the placement model's parameters to what the rooms of real buildings hold.

m0 is a logistic regression on all rooms of the buildings, with a ridge penalty of 1 on every weight
but the base (Newton's method). kappa and tau then maximise the Beta-binomial likelihood of each
building given the counts of all others, with an m0 that was fitted without that building.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.knowledge.placement.belief_model import (
    EvidenceArrays,
    KnowledgeWeights,
    Matrix,
    PlacementParameters,
    SurveyWeights,
    posterior_belief,
    sigmoid,
)

Vector = NDArray[np.float64]

_RIDGE: Final = 1.0
_STEPS: Final = 40
#: values of kappa and tau that are tried [rooms]
_STRENGTHS: Final = np.geomspace(1.0, 32.0, 11)


@dataclass(frozen=True, slots=True)
class TrainingSet:
    """Buildings to fit to; arrays (buildings, objects, places)."""

    evidence: EvidenceArrays  # its counts (b, n, m): of all other buildings
    rooms: Matrix  # (b, n, m) rooms of the building searched for the object
    held: Matrix  # (b, n, m) of those, the ones that held it

    def without(self, building: int) -> TrainingSet:
        """All buildings but one."""
        return self.only(n for n in range(len(self.rooms)) if n != building)

    def only(self, buildings: Iterable[int]) -> TrainingSet:
        """Some of the buildings."""
        keep = list(buildings)
        evidence = replace(
            self.evidence,
            rooms=self.evidence.rooms[keep],
            rooms_with=self.evidence.rooms_with[keep],
        )
        return TrainingSet(evidence, self.rooms[keep], self.held[keep])


def fit(sample: TrainingSet) -> PlacementParameters:
    """All parameters; deterministic."""
    found = fit_prior(sample)
    count = len(sample.rooms)
    others = [fit_prior(sample.without(building)) for building in range(count)]
    kappa, tau = max(
        ((float(kappa), float(tau)) for kappa in _STRENGTHS for tau in _STRENGTHS),
        key=lambda pair: sum(
            log_likelihood(sample.only([n]), replace(others[n], kappa=pair[0], tau=pair[1]))
            for n in range(count)
        ),
    )
    return replace(found, kappa=kappa, tau=tau)


def fit_prior(sample: TrainingSet, kappa: float = 1.0, tau: float = 1.0) -> PlacementParameters:
    """The parameters of m0; `kappa` and `tau` as given."""
    evidence = sample.evidence
    knowledge = [np.ones_like(evidence.weight), evidence.listed > 0, np.log1p(evidence.weight)]
    surveys = [
        feature
        for survey in evidence.surveys
        for feature in (survey.covers_object, survey.object_rate, survey.covers_place, survey.lift)
    ]
    weights = _regression(sample, [*knowledge, *surveys])
    of_survey = {
        survey.name: SurveyWeights(*weights[4 * i + 3 : 4 * i + 7])
        for i, survey in enumerate(evidence.surveys)
    }
    return PlacementParameters(
        KnowledgeWeights(*weights[:3]),
        KnowledgeWeights(*_regression(sample, knowledge)),
        of_survey,
        kappa,
        tau,
    )


def _regression(sample: TrainingSet, features: Sequence[Matrix]) -> list[float]:
    """Weights of features (n, m), the first of them constant, by penalised logistic regression."""
    rooms, held = sample.rooms.sum(0).ravel(), sample.held.sum(0).ravel()
    cells = rooms > 0
    design = np.column_stack([np.asarray(x, float).ravel() for x in features])[cells]
    n, k = rooms[cells], held[cells]
    penalty = _RIDGE * np.diag([0.0] + [1.0] * (design.shape[1] - 1))
    weights = np.zeros(design.shape[1])
    weights[0] = math.log(k.sum() / (n.sum() - k.sum()))

    def cost(w: Vector) -> float:
        p = sigmoid(design @ w)
        return float(w @ penalty @ w / 2 - k @ np.log(p) - (n - k) @ np.log1p(-p))

    for _ in range(_STEPS):
        p = sigmoid(design @ weights)
        hessian = design.T @ (design * (n * p * (1 - p))[:, None]) + penalty
        step = np.linalg.solve(hessian, design.T @ (k - n * p) - penalty @ weights)
        while np.abs(step).max() > 1e-9 and cost(weights + step) > cost(weights):
            step = step / 2
        weights = weights + step
    return [float(weight) for weight in weights]


def log_likelihood(sample: TrainingSet, parameters: PlacementParameters) -> float:
    """ln p(what the buildings hold | the statistics of all others), Beta-binomial."""
    belief = posterior_belief(sample.evidence, parameters)
    cells = sample.rooms > 0
    a, b = (np.broadcast_to(x, cells.shape)[cells] for x in (belief.alpha, belief.beta))
    return float(log_beta_binomial(a, b, sample.rooms[cells], sample.held[cells]).sum())


def log_beta_binomial(alpha: Vector, beta: Vector, rooms: Vector, held: Vector) -> Vector:
    """ln of the Beta-binomial probability of one order of `held` with and the rest without."""
    return (
        _log_gamma(alpha + held)
        - _log_gamma(alpha)
        + _log_gamma(beta + rooms - held)
        - _log_gamma(beta)
        - _log_gamma(alpha + beta + rooms)
        + _log_gamma(alpha + beta)
    )


def _log_gamma(x: Vector) -> Vector:
    return np.array([math.lgamma(value) for value in np.ravel(x)]).reshape(np.shape(x))
