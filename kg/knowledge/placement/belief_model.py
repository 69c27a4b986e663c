"""The placement model: evidence about (object, place) pairs to Beta distributions; numpy only.

    logit m0 = base + listed [an ontology lists the pair] + conceptnet ln(1 + weight)
               + sum over surveys of their four weighted features
               (`kg.knowledge.placement.surveys`); objects that no survey looked for have a base and
               weights of their own
    m1 = (kappa m0 + rooms with it) / (kappa + rooms)           imported statistics
    s  = 1 / (1 / tau + 1 / (kappa + rooms))
    alpha = s m1 + rooms of this map with it + 8 stated
    beta = s (1 - m1) + rooms of this map without it + 8 (1 - stated)

Sources: logistic regression for m0, Beta-binomial shrinkage for the counts (Gelman et al., Bayesian
Data Analysis, chapter 5). docs/explanation/placement.md explains each term.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from kg.knowledge.placement.surveys import SurveyFeatures


@dataclass(frozen=True, slots=True)
class SurveyWeights:
    """Weights of the four features of one survey of rooms (`kg.knowledge.placement.surveys`)."""

    covers_object: float  # log-odds of an object in the survey
    object_rate: float  # for each unit of the log-odds of the object's rate in all rooms
    covers_place: float  # log-odds of a kind of place in the survey
    lift: float  # for each unit of log-odds of this kind of place above those of all rooms


@dataclass(frozen=True, slots=True)
class KnowledgeWeights:
    """Weights of the stated knowledge about a pair."""

    base: float  # log-odds of an object in a place without further evidence
    listed: float  # log-odds where an ontology lists the pair
    conceptnet: float  # log-odds for each unit of ln(1 + weight) in ConceptNet


@dataclass(frozen=True, slots=True)
class PlacementParameters:
    """Fitted parameters of the model (docs/explanation/placement.md has the formula)."""

    knowledge: KnowledgeWeights  # of objects in a survey
    unsurveyed: KnowledgeWeights  # of all other objects
    surveys: Mapping[str, SurveyWeights]  # by the name of the survey
    kappa: float  # strength of m0 relative to imported statistics [rooms]
    tau: float  # maximum strength of other buildings relative to this one [rooms]


#: Fitted by `lab.placement.fit` to 15 homes: logistic regression with a ridge penalty of
#: 1 on all weights except the base, then kappa and tau by the Beta-binomial likelihood of each home
#: given the statistics of the others. Kappa is the lower end of its likely range (5 to 12), since
#: m0 fits other buildings less well.
FITTED: Final = PlacementParameters(
    knowledge=KnowledgeWeights(base=-3.9271, listed=0.0804, conceptnet=0.4949),
    unsurveyed=KnowledgeWeights(base=-3.583, listed=0.7004, conceptnet=1.808),
    surveys={
        "BEHAVIOR-1K homes": SurveyWeights(0.9349, 0.5315, 0.2678, 0.4788),
        "COCO val2017": SurveyWeights(0.0, 0.6251, 0.1931, 0.563),
    },
    kappa=5.0,
    tau=5.6,
)

#: Strength of a probability stated by a person [rooms].
STATEMENT_STRENGTH: Final = 8.0

#: Scene categorisations below which a place does not count as searched.
MIN_VIEWS: Final = 3
#: Views after which half of a room counts as searched: its weight is views / (views + this).
HALF_SEARCHED_VIEWS: Final = 3.0

#: Detection rate and false-positive rate of objects in a room.
DETECTION_RATE: Final = 0.8
FALSE_POSITIVE_RATE: Final = 0.02
#: Weight of each log-likelihood ratio: objects of one room are not independent.
LIKELIHOOD_DAMPING: Final = 0.7
#: Bound of one object's log-likelihood ratio between two kinds of place.
MAX_LOG_RATIO: Final = 3.0

Matrix = NDArray[np.float64]
Vector = NDArray[np.float64]

#: Bound of log-odds, so that probabilities lie strictly between 0 and 1.
_MAX_LOG_ODDS: Final = 9.0


@dataclass(frozen=True, slots=True)
class EvidenceArrays:
    """Evidence about n objects in m places; arrays (n, m), counts >= 0.

    `rooms` and `rooms_with` may have leading axes, for several cases at once; the outcome has them.
    """

    listed: Matrix  # 1 where an ontology lists the pair, else 0
    weight: Matrix  # ConceptNet's weight for, less that against, >= 0
    surveys: tuple[SurveyFeatures, ...]
    rooms: Matrix  # rooms of the place in imported statistics that were searched for the object
    rooms_with: Matrix  # of those, the ones that held it
    building_with: Matrix  # rooms of this building that hold it
    building_without: Matrix  # rooms of this building that were searched and do not
    stated: Matrix  # sum of the probabilities that people stated
    statements: Matrix  # number of these probabilities


@dataclass(frozen=True, slots=True)
class BetaBelief:
    """Posterior Beta distributions, arrays (n, m), with m0 and m1."""

    prior: Matrix  # m0
    counted: Matrix  # m1
    share: Matrix  # of `prior` in `counted`; the rest is the rate in the counted rooms
    strength: Matrix  # s: rooms that `counted` is worth
    alpha: Matrix
    beta: Matrix

    @property
    def mean(self) -> Matrix:
        """The probability: the mean of the Beta distribution."""
        return self.alpha / (self.alpha + self.beta)


def posterior_belief(evidence: EvidenceArrays, parameters: PlacementParameters) -> BetaBelief:
    """Posterior given the evidence; every probability lies strictly between 0 and 1."""
    p, rooms, held = parameters, evidence.rooms, evidence.rooms_with
    terms = log_odds_terms(evidence, p)
    m0 = sigmoid(np.sum([term for _, term in terms], axis=0))
    share = p.kappa / (p.kappa + rooms)
    m1 = (p.kappa * m0 + held) / (p.kappa + rooms)
    strength = 1 / (1 / p.tau + 1 / (p.kappa + rooms))
    unstated = evidence.statements - evidence.stated
    return BetaBelief(
        prior=m0,
        counted=m1,
        share=share,
        strength=strength,
        alpha=strength * m1 + evidence.building_with + STATEMENT_STRENGTH * evidence.stated,
        beta=strength * (1 - m1) + evidence.building_without + STATEMENT_STRENGTH * unstated,
    )


BASE: Final = "model"
LISTED: Final = "ontology"
CONCEPTNET: Final = "ConceptNet"


def log_odds_terms(
    evidence: EvidenceArrays, parameters: PlacementParameters
) -> tuple[tuple[str, Matrix], ...]:
    """The terms (n, m) of logit m0: `BASE`, `LISTED`, `CONCEPTNET`, and each survey by its name."""
    known, other = parameters.knowledge, parameters.unsurveyed
    nobody = np.zeros_like(evidence.weight)
    surveyed = sum((survey.covers_object for survey in evidence.surveys), nobody) > 0
    return (
        (BASE, np.where(surveyed, known.base, other.base)),
        (LISTED, np.where(surveyed, known.listed, other.listed) * (evidence.listed > 0)),
        (
            CONCEPTNET,
            np.where(surveyed, known.conceptnet, other.conceptnet) * np.log1p(evidence.weight),
        ),
        *(
            (survey.name, survey.log_odds(parameters.surveys[survey.name]))
            for survey in evidence.surveys
        ),
    )


def sigmoid(x: Matrix) -> Matrix:
    """1 / (1 + exp(-x)), kept away from 0 and 1."""
    return np.asarray(1 / (1 + np.exp(-np.clip(x, -_MAX_LOG_ODDS, _MAX_LOG_ODDS))))


def posterior(
    present: Matrix, observed: NDArray[np.bool_], prior: Vector, weight: Vector | None = None
) -> Vector:
    """Posterior over place categories given the objects in the place, (m,), adding up to 1.

    Naive Bayes, made robust: detectors have misses and false positives, objects of a room are not
    independent (damping), and the log-likelihood ratio of a single object is bounded.

    Args:
        present: (n, m) p(object in place) of n objects.
        observed: (n,) whether each object was found or missed.
        prior: (m,) prior of the place categories, >= 0, with a positive sum.
        weight: (n,) weight of each object, 0..1; None: all 1.
    """
    detected = DETECTION_RATE * present + FALSE_POSITIVE_RATE * (1 - present)
    likelihood = np.log(np.where(observed[:, None], detected, 1 - detected))
    base = prior / prior.sum()
    # log-likelihood ratio of each object to the average place
    relative = likelihood - likelihood @ base[:, None]
    counts = np.ones(len(observed)) if weight is None else weight
    score = LIKELIHOOD_DAMPING * (counts @ np.clip(relative, -MAX_LOG_RATIO, MAX_LOG_RATIO))
    product = base * np.exp(score - score[base > 0].max(initial=-np.inf))
    return np.asarray(product / product.sum())
