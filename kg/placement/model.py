"""The placement model: evidence about (object, place) pairs to Beta distributions; numpy only.

    x_e = logit(p) - logit(base rate), 0 without an edge       x_c = ln(1 + ConceptNet weight)
    x_u = object found more often than expected, in all other and in similar places
    x_k = related objects found more often there than expected
    m0 = sigmoid(base + max(edge x_e, conceptnet x_c) + across_places x_u + across_objects x_k)
    m1 = w (kappa m0 + with) / (kappa + rooms) + (1 - w) (0.02 m0 + with) / (0.02 + rooms)
    s  = 1 / (1 / tau + 1 / (w kappa + (1 - w) 0.02 + rooms))
    alpha = s m1 + rooms with it + 8 stated,  beta = s (1 - m1) + rooms without + 8 (1 - stated)

w is the probability that m0 is worth kappa rooms: `trust` a priori, updated by Bayes' rule.

Sources: logistic regression for m0; Beta-binomial shrinkage (Gelman et al., Bayesian Data Analysis,
chapter 5); the robust mixture of an informative and a vague prior is that of Schmidli et al.,
Biometrics 70 (2014), 1023-1032. docs/explanation/placement.md explains each term.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.placement.settings import BASE_RATE, STATEMENT_STRENGTH, VAGUE_STRENGTH, PlacementParameters

Matrix = NDArray[np.float64]

#: Bound of log-odds, so that probabilities lie strictly between 0 and 1.
_MAX_LOG_ODDS: Final = 9.0
_HALF_LOG_TWO_PI: Final = 0.5 * float(np.log(2 * np.pi))


@dataclass(frozen=True, slots=True)
class EvidenceArrays:
    """Evidence about n objects in m places; arrays (n, m) unless noted, counts >= 0.

    `rooms` and `rooms_with` may have leading axes, for several cases at once; the outcome has them.
    """

    listed: Matrix  # probability on an ontology's edge, 0 where there is none
    weight: Matrix  # ConceptNet's weight for, less that against, >= 0
    rooms: Matrix  # rooms of other buildings of the place that were searched for the object
    rooms_with: Matrix  # of those, the ones that held it
    similar: Matrix  # (m, m) 1 where two different places are alike, else 0
    related: Matrix  # (n, n) 1 where two different objects share a supercategory, else 0
    building_with: Matrix  # rooms of this building that hold it
    building_without: Matrix  # rooms of this building that were searched and do not
    stated: Matrix  # sum of the probabilities that people stated
    statements: Matrix  # number of these probabilities


@dataclass(frozen=True, slots=True)
class BetaBelief:
    """Posterior Beta distributions, arrays (n, m), with m0 and m1."""

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
class LogOddsTerms:
    """Terms of the log-odds of m0 except the base, arrays (n, m)."""

    stated: Matrix  # an ontology or ConceptNet
    across_places: Matrix  # shrinkage over places: the object in other places
    across_objects: Matrix  # shrinkage over objects: related objects in the place


def posterior_belief(evidence: EvidenceArrays, parameters: PlacementParameters) -> BetaBelief:
    """Posterior given the evidence; every probability lies strictly between 0 and 1."""
    p, rooms, held = parameters, evidence.rooms, evidence.rooms_with
    terms = prior_terms(evidence, p)
    m0 = sigmoid(_base(evidence, p) + terms.stated + terms.across_places + terms.across_objects)
    w = _trust(m0, rooms, held, p)
    share = w * p.kappa / (p.kappa + rooms) + (1 - w) * VAGUE_STRENGTH / (VAGUE_STRENGTH + rooms)
    m1 = share * m0 + (1 - share) * held / np.maximum(rooms, 1)
    strength = 1 / (1 / p.tau + 1 / (w * p.kappa + (1 - w) * VAGUE_STRENGTH + rooms))
    unstated = evidence.statements - evidence.stated
    return BetaBelief(
        prior=m0,
        counted=m1,
        share=share,
        strength=strength,
        alpha=strength * m1 + evidence.building_with + STATEMENT_STRENGTH * evidence.stated,
        beta=strength * (1 - m1) + evidence.building_without + STATEMENT_STRENGTH * unstated,
    )


def _trust(m0: Matrix, rooms: Matrix, held: Matrix, p: PlacementParameters) -> Matrix:
    """w: posterior probability, given the counts, that the prior is worth `kappa` rooms."""
    informative = log_beta_binomial(p.kappa * m0, p.kappa * (1 - m0), rooms, held)
    vague = log_beta_binomial(VAGUE_STRENGTH * m0, VAGUE_STRENGTH * (1 - m0), rooms, held)
    return sigmoid(logit(p.trust) + informative - vague)


def prior_terms(evidence: EvidenceArrays, parameters: PlacementParameters) -> LogOddsTerms:
    """Terms of m0; each is measured against the expectation from the terms before it."""
    p, rooms, held = parameters, evidence.rooms, evidence.rooms_with
    stated = stated_log_odds(evidence, p)
    base = _base(evidence, p)
    expected = rooms * sigmoid(base + stated)
    across_places = p.across_places * log_odds_excess(
        _other_places(held), _other_places(rooms), _other_places(expected), p.kappa
    )
    expected = rooms * sigmoid(base + stated + across_places)
    similar, related = evidence.similar, evidence.related
    similar_excess = log_odds_excess(held @ similar, rooms @ similar, expected @ similar, p.kappa)
    across_objects = log_odds_excess(related @ held, related @ rooms, related @ expected, p.kappa)
    return LogOddsTerms(
        stated, across_places + p.across_places * similar_excess, p.across_objects * across_objects
    )


def _base(evidence: EvidenceArrays, parameters: PlacementParameters) -> Matrix:
    """(n, 1) base log-odds of an object without further evidence."""
    counted = evidence.rooms.any(-1, keepdims=True)
    return np.asarray(parameters.base + parameters.lift * counted)


def _other_places(counts: Matrix) -> Matrix:
    """(n, m) the counts of all other places together."""
    return np.asarray(counts.sum(-1, keepdims=True) - counts)


def log_odds_excess(held: Matrix, rooms: Matrix, expected: Matrix, kappa: float) -> Matrix:
    """Log-odds ratio of the observed rate to the `expected` one; 0 where nothing was counted.

    The rate is shrunk towards the expected one by `kappa` rooms.
    """
    rate = np.clip(expected / np.maximum(rooms, 1e-9), 1e-4, 1 - 1e-4)
    shrunk = (held + kappa * rate) / (rooms + kappa)
    return np.where(rooms > 0, logit(shrunk) - logit(rate), 0.0)


def stated_log_odds(evidence: EvidenceArrays, parameters: PlacementParameters) -> Matrix:
    """Log-odds from an ontology or ConceptNet, the larger of both.

    The larger, not the sum: lists like the thesis' are made from ConceptNet, so that what both
    contain should count once.
    """
    listed = parameters.edge * listed_log_odds(evidence.listed)
    return np.maximum(listed, parameters.conceptnet * np.log1p(evidence.weight))


def listed_log_odds(listed: Matrix) -> Matrix:
    """x_e: log-odds of an edge over those without one; 0 without an edge."""
    return np.maximum(logit(np.maximum(listed, BASE_RATE)) - logit(BASE_RATE), 0.0)


def log_beta_binomial(alpha: Matrix, beta: Matrix, rooms: Matrix, held: Matrix) -> Matrix:
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
    return np.asarray(1 / (1 + np.exp(-np.clip(x, -_MAX_LOG_ODDS, _MAX_LOG_ODDS))))


def logit(p: Matrix | float) -> Matrix:
    """ln(p / (1 - p)), bounded for p at 0 or 1."""
    clipped = np.clip(p, 1e-6, 1 - 1e-6)
    return np.asarray(np.log(clipped / (1 - clipped)))
