"""Parameters of the placement model; `benchmarks/placement/fit.py` fits the first eight."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final


@dataclass(frozen=True, slots=True)
class PlacementParameters:
    """Fitted parameters of the model (docs/explanation/placement.md has the formulas); all finite.

    All but `base` are at least 0, `trust` is a probability: where nothing was counted, more
    evidence for an object never makes it less likely.
    """

    base: float  # log-odds of an object in a place without further evidence
    edge: float  # weight of the log-odds that an ontology states
    conceptnet: float  # log-odds for each unit of ln(1 + weight) in ConceptNet
    across_places: float  # shrinkage weight of similar places and of the whole building
    across_objects: float  # shrinkage weight of objects of the same supercategory
    kappa: float  # strength of the informative prior, in rooms of statistics
    trust: float  # prior probability that the informative prior holds
    tau: float  # strength of other buildings' statistics, in rooms of this building
    lift: float = 0.0  # log-odds added for objects counted in that kind of building


#: Fitted by `benchmarks/placement/fit.py` on 15 homes and 4 areas of S3DIS: 3,400 cells in the four
#: ways of `benchmarks.placement.fitting`, log-likelihood -4373.18.
FITTED: Final = PlacementParameters(
    base=-3.14,
    edge=0.702,
    conceptnet=1.93,
    across_places=0.481,
    across_objects=0.618,
    kappa=2.55,
    trust=0.754,
    tau=4.38,
)
#: For one kind of building, where rooms of its kind were counted: lift, kappa, trust
#: and tau are its own.
HOMES: Final = replace(FITTED, lift=0.626, kappa=7.64, trust=0.846, tau=5.29)
OFFICES: Final = replace(FITTED, lift=1.87, kappa=78.8, trust=0.789, tau=12.7)

#: Strength of the vague prior [rooms].
VAGUE_STRENGTH: Final = 0.02
#: Base rate: share of rooms without an edge that hold the object (97 of 7,616,
#: docs/explanation/ontology.md).
BASE_RATE: Final = 97 / 7616
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
