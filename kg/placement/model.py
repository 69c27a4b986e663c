"""The placement model: evidence about (object, place) pairs to Beta distributions; numpy only.

    x_e = logit(stated) - logit(silent), 0 without an edge     x_c = ln(1 + ConceptNet weight)
    x_u = object found more often than expected, in all other and in similar places
    x_k = kindred objects found more often there than expected
    m0 = sigmoid(base + max(edge x_e, conceptnet x_c) + usual x_u + kin x_k)
    m1 = w (kappa m0 + with) / (kappa + rooms) + (1 - w) (0.02 m0 + with) / (0.02 + rooms)
    s  = 1 / (1 / tau + 1 / (w kappa + (1 - w) 0.02 + rooms))
    alpha = s m1 + seen with + 8 stated,  beta = s (1 - m1) + seen without + 8 (1 - stated)

w is the probability that m0 is to be trusted: `trust` beforehand, by Bayes' rule after the counts.

Sources: logistic regression for m0; Beta-binomial shrinkage (Gelman et al., Bayesian Data Analysis,
chapter 5); the mixture of a firm and a vague prior, which gives way where counts contradict it, is
Schmidli et al., Biometrics 70 (2014), 1023-1032. docs/placement.md explains each term.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.placement.settings import DOUBTED, SILENT, STATED, Parameters

Matrix = NDArray[np.float64]

#: Log-odds beyond which nothing is believed: probabilities stay clear of 0 and 1.
_FARTHEST: Final = 9.0
_HALF_LOG_TWO_PI: Final = 0.5 * float(np.log(2 * np.pi))


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
    share: Matrix  # of `prior` in `counted`; the rest is the rate in the counted rooms
    strength: Matrix  # s: rooms that `counted` is worth
    alpha: Matrix
    beta: Matrix

    @property
    def mean(self) -> Matrix:
        """The probability: the mean of the Beta distribution."""
        return self.alpha / (self.alpha + self.beta)


@dataclass(frozen=True, slots=True)
class Terms:
    """The parts of the log-odds of m0 beside its base, arrays (n, m), as they are added up."""

    said: Matrix  # an ontology or ConceptNet
    usual: Matrix  # the object in other places
    kin: Matrix  # kindred objects in the place


def believe(evidence: Evidence, parameters: Parameters) -> Belief:
    """What the evidence amounts to; every probability lies strictly between 0 and 1."""
    p, rooms, held = parameters, evidence.rooms, evidence.rooms_with
    terms = prior_terms(evidence, p)
    m0 = sigmoid(_base(evidence, p) + terms.said + terms.usual + terms.kin)
    w = _trust(m0, rooms, held, p)
    share = w * p.kappa / (p.kappa + rooms) + (1 - w) * DOUBTED / (DOUBTED + rooms)
    m1 = share * m0 + (1 - share) * held / np.maximum(rooms, 1)
    strength = 1 / (1 / p.tau + 1 / (w * p.kappa + (1 - w) * DOUBTED + rooms))
    unstated = evidence.statements - evidence.stated
    return Belief(
        prior=m0,
        counted=m1,
        share=share,
        strength=strength,
        alpha=strength * m1 + evidence.seen_with + STATED * evidence.stated,
        beta=strength * (1 - m1) + evidence.seen_without + STATED * unstated,
    )


def _trust(m0: Matrix, rooms: Matrix, held: Matrix, p: Parameters) -> Matrix:
    """w: how probable it is, given the counts, that the prior is worth `kappa` rooms."""
    firm = log_chance(p.kappa * m0, p.kappa * (1 - m0), rooms, held)
    vague = log_chance(DOUBTED * m0, DOUBTED * (1 - m0), rooms, held)
    return sigmoid(logit(p.trust) + firm - vague)


def prior_terms(evidence: Evidence, parameters: Parameters) -> Terms:
    """What m0 is made of; each part is measured against what the parts before it lead to expect."""
    p, rooms, held = parameters, evidence.rooms, evidence.rooms_with
    said = said_log_odds(evidence, p)
    base = _base(evidence, p)
    expected = rooms * sigmoid(base + said)
    usual = p.usual * excess(_others(held), _others(rooms), _others(expected), p.kappa)
    expected = rooms * sigmoid(base + said + usual)
    similar, kindred = evidence.similar, evidence.kindred
    alike = excess(held @ similar, rooms @ similar, expected @ similar, p.kappa)
    kin = excess(kindred @ held, kindred @ rooms, kindred @ expected, p.kappa)
    return Terms(said, usual + p.usual * alike, p.kin * kin)


def _base(evidence: Evidence, parameters: Parameters) -> Matrix:
    """(n, 1) the log-odds of an object of which nothing is said."""
    counted = evidence.rooms.any(-1, keepdims=True)
    return np.asarray(parameters.base + parameters.lift * counted)


def _others(counts: Matrix) -> Matrix:
    """(n, m) the counts of all other places together."""
    return np.asarray(counts.sum(-1, keepdims=True) - counts)


def excess(held: Matrix, rooms: Matrix, expected: Matrix, kappa: float) -> Matrix:
    """The log-odds of a rate over those of the `expected` one; 0 where nothing was counted.

    The rate is shrunk towards the expected one by `kappa` rooms.
    """
    rate = np.clip(expected / np.maximum(rooms, 1e-9), 1e-4, 1 - 1e-4)
    shrunk = (held + kappa * rate) / (rooms + kappa)
    return np.where(rooms > 0, logit(shrunk) - logit(rate), 0.0)


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


def log_chance(alpha: Matrix, beta: Matrix, rooms: Matrix, held: Matrix) -> Matrix:
    """ln of the Beta-binomial probability of one order of `held` with and the rest without."""
    return (
        log_gamma(alpha + held)
        - log_gamma(alpha)
        + log_gamma(beta + rooms - held)
        - log_gamma(beta)
        - log_gamma(alpha + beta + rooms)
        + log_gamma(alpha + beta)
    )


def log_gamma(x: Matrix | float) -> Matrix:
    """ln Gamma(x) for x > 0, to 1e-9: Stirling's series after six steps of the recurrence."""
    y = np.asarray(x, dtype=np.float64)
    steps = np.log(y * (y + 1) * (y + 2) * (y + 3) * (y + 4) * (y + 5))
    z = y + 6
    series = 1 / (12 * z) - 1 / (360 * z**3) + 1 / (1260 * z**5)
    return np.asarray((z - 0.5) * np.log(z) - z + _HALF_LOG_TWO_PI + series - steps)


def sigmoid(x: Matrix) -> Matrix:
    """1 / (1 + exp(-x)), kept away from 0 and 1."""
    return np.asarray(1 / (1 + np.exp(-np.clip(x, -_FARTHEST, _FARTHEST))))


def logit(p: Matrix | float) -> Matrix:
    """ln(p / (1 - p)), bounded for p at 0 or 1."""
    clipped = np.clip(p, 1e-6, 1 - 1e-6)
    return np.asarray(np.log(clipped / (1 - clipped)))
