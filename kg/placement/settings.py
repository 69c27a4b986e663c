"""Every number of the placement model; `benchmarks/fit_placement.py` fits the first eight."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final


@dataclass(frozen=True, slots=True)
class Parameters:
    """The fitted numbers of the model (docs/placement.md has the formulas); all finite.

    All but `base` are at least 0, `trust` is a probability: where nothing was counted, more
    evidence for an object never makes it less likely.
    """

    base: float  # log-odds of a place holding an object of which nothing else is known
    edge: float  # share of the log-odds that an ontology states which count
    conceptnet: float  # log-odds for each unit of ln(1 + weight) in ConceptNet
    usual: float  # share of the log-odds in similar places and in the whole building that count
    kin: float  # share of the log-odds by which objects of one supercategory favour a place
    kappa: float  # rooms of statistics that everything above is worth, where it is to be trusted
    trust: float  # probability that it is to be trusted, before anything is counted
    tau: float  # rooms of one building that all statistics of other buildings are worth
    lift: float = 0.0  # log-odds beyond `base` of objects that were counted, in a kind of building


#: Fitted by `benchmarks/fit_placement.py` on 15 homes and 4 areas of S3DIS: 3,400 cells in the four
#: ways of `kg.placement.trial.fitting`, log-likelihood -4373.18.
FITTED: Final = Parameters(
    base=-3.14,
    edge=0.702,
    conceptnet=1.93,
    usual=0.481,
    kin=0.618,
    kappa=2.55,
    trust=0.754,
    tau=4.38,
)
#: The same for one kind of building, where rooms of its kind were counted: lift, kappa, trust
#: and tau are its own.
HOMES: Final = replace(FITTED, lift=0.626, kappa=7.64, trust=0.846, tau=5.29)
OFFICES: Final = replace(FITTED, lift=1.87, kappa=78.8, trust=0.789, tau=12.7)

#: Rooms that what is expected is worth where it is not to be trusted.
DOUBTED: Final = 0.02
#: Share of rooms without an edge that hold the object (docs/ontology.md: 97 of 7,616).
SILENT: Final = 97 / 7616
#: Rooms that a probability stated by a person is worth.
STATED: Final = 8.0

#: Scene categorisations below which a place does not count as looked at.
LEAST_VIEWS: Final = 3
#: Views at which half of a room counts as seen: the negative count weighs views / (views + this).
HALF_SEEN: Final = 3.0

#: Of objects that are there, the share that is mapped; of those not there, the share that is.
DETECTED: Final = 0.8
MISTAKEN: Final = 0.02
#: Objects of one room are not independent: each log-likelihood ratio counts for this share.
INDEPENDENCE: Final = 0.7
#: No object moves the log-odds between two kinds of place by more than this.
MOST: Final = 3.0
