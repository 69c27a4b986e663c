"""Parameters of the placement model; `benchmarks.placement.fit` fits them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final


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


#: Fitted by `benchmarks.placement.fit` to 15 homes: logistic regression with a ridge penalty of
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
