"""The placement model: evidence about (object, place) pairs to Beta distributions; numpy only.

    x_e = logit(stated) - logit(silent), 0 without an edge     x_c = ln(1 + ConceptNet weight)
    x_u = logit(rate in similar places) - logit(rare)          x_k = lift among kindred objects
    m0 = sigmoid(base + max(edge x_e, conceptnet x_c) + usual x_u + kin x_k)
    m1 = (kappa m0 + rooms with) / (kappa + rooms)             statistics of other buildings
    s  = 1 / (1 / tau + 1 / (kappa + rooms))             what m1 is worth, in rooms of this building
    alpha = s m1 + seen with + 8 stated,  beta = s (1 - m1) + seen without + 8 (1 - stated)

Sources: logistic regression for m0; Beta-binomial shrinkage (Gelman et al., Bayesian Data Analysis,
chapter 5) for the rest. docs/placement.md explains each term.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.placement.settings import RARE, SILENT, STATED, Parameters

Matrix = NDArray[np.float64]

#: Log-odds beyond which nothing is believed: probabilities stay clear of 0 and 1.
_FARTHEST: Final = 9.0


@dataclass(frozen=True, slots=True)
class Evidence:
    """What is known of n objects in m places; arrays (n, m) unless said, counts >= 0.

    `rooms` and `rooms_with` may have leading axes, for several cases at once; the outcome has them.
    """

    listed: Matrix  # probability on an ontology's edge, 0 where there is none
    weight: Matrix  # ConceptNet's weight for, less that against, >= 0
    rooms: Matrix  # rooms of other buildings of the place that were searched for the object
    rooms_with: Matrix  # of those, the ones that held it
    similar: Matrix  # (m, m) 1 where two different places are alike, else 0
    kindred: Matrix  # (n, n) 1 where two different objects share a supercategory, else 0
    seen_with: Matrix  # rooms of this building that hold it
    seen_without: Matrix  # rooms of this building that were looked at and do not
    stated: Matrix  # a person's probabilities, added up
    statements: Matrix  # how many they are


@dataclass(frozen=True, slots=True)
class Belief:
    """The outcome, arrays (n, m): m0, m1, and the parameters of the Beta distribution."""

    prior: Matrix
    counted: Matrix
    strength: Matrix  # s: rooms that `counted` is worth
    alpha: Matrix
    beta: Matrix

    @property
    def mean(self) -> Matrix:
        """The probability: the mean of the Beta distribution."""
        return self.alpha / (self.alpha + self.beta)


def believe(evidence: Evidence, parameters: Parameters) -> Belief:
    """What the evidence amounts to; every probability lies strictly between 0 and 1."""
    p = parameters
    m0 = sigmoid(
        p.base
        + said_log_odds(evidence, p)
        + p.usual * usual_log_odds(evidence, p.kappa)
        + p.kin * kin_log_odds(evidence, p.kappa)
    )
    m1 = (p.kappa * m0 + evidence.rooms_with) / (p.kappa + evidence.rooms)
    strength = 1 / (1 / p.tau + 1 / (p.kappa + evidence.rooms))
    unstated = evidence.statements - evidence.stated
    return Belief(
        prior=m0,
        counted=m1,
        strength=strength,
        alpha=strength * m1 + evidence.seen_with + STATED * evidence.stated,
        beta=strength * (1 - m1) + evidence.seen_without + STATED * unstated,
    )


def said_log_odds(evidence: Evidence, parameters: Parameters) -> Matrix:
    """What an ontology and ConceptNet say, the stronger of both.

    The larger, not the sum: lists like the thesis' are made from ConceptNet, and what both say
    should count once.
    """
    listed = parameters.edge * listed_log_odds(evidence.listed)
    return np.maximum(listed, parameters.conceptnet * np.log1p(evidence.weight))


def listed_log_odds(listed: Matrix) -> Matrix:
    """x_e: by how much an edge raises the log-odds over no edge; 0 without one."""
    return np.maximum(logit(np.maximum(listed, SILENT)) - logit(SILENT), 0.0)


def usual_log_odds(evidence: Evidence, kappa: float) -> Matrix:
    """x_u: the log-odds of the object in similar places, over those of a rare object.

    The rate in similar places is shrunk towards the rate in all other places, by `kappa` rooms,
    and that towards `RARE`. 0 for objects nobody counted.
    """
    rooms, held = evidence.rooms, evidence.rooms_with
    elsewhere = rooms.sum(-1, keepdims=True) - rooms
    anywhere = (held.sum(-1, keepdims=True) - held + kappa * RARE) / (elsewhere + kappa)
    alike = (held @ evidence.similar + kappa * anywhere) / (rooms @ evidence.similar + kappa)
    return np.where(elsewhere > 0, logit(alike) - logit(RARE), 0.0)


def kin_log_odds(evidence: Evidence, kappa: float) -> Matrix:
    """x_k: how much kindred objects favour the place, over places at large; 0 without any."""
    rooms, held = evidence.kindred @ evidence.rooms, evidence.kindred @ evidence.rooms_with
    total = rooms.sum(-1, keepdims=True)
    anywhere = (held.sum(-1, keepdims=True) + kappa * RARE) / (total + kappa)
    here = (held + kappa * anywhere) / (rooms + kappa)
    return np.where(rooms > 0, logit(here) - logit(anywhere), 0.0)


def sigmoid(x: Matrix) -> Matrix:
    """1 / (1 + exp(-x)), kept away from 0 and 1."""
    return np.asarray(1 / (1 + np.exp(-np.clip(x, -_FARTHEST, _FARTHEST))))


def logit(p: Matrix | float) -> Matrix:
    """ln(p / (1 - p)), bounded for p at 0 or 1."""
    clipped = np.clip(p, 1e-6, 1 - 1e-6)
    return np.asarray(np.log(clipped / (1 - clipped)))
