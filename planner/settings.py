"""Settings of the belief about where a target is, and of the plans made from it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class BeliefSettings:
    """Settings by which candidates become probabilities on cells."""

    #: probability that an object that was moved is still in its room
    p_same_room: float = 0.5
    #: probability that an object that was moved is no longer on this floor
    p_left_floor: float = 0.3
    #: probability that mapping a room would have shown an object that is in it
    noticed: float = 0.6
    #: share of a room's belief that lies around objects that the target is found near
    beside: float = 0.5
    #: standard deviation around a remembered position [m]
    site_sigma: float = 0.4
    #: standard deviation around an object that the target is found near [m]
    beside_sigma: float = 0.8
    #: share of every candidate's belief that is spread evenly over the whole floor
    uniform_share: float = 0.05
    #: floor that is assumed around an object in no place [m]
    outside: float = 1.5
    #: probability that a room begins where seen floor ends at unseen floor
    frontier: float = 0.3
    #: share of all probability that a view must gain to be worth its way
    give_up: float = 0.005
    #: a search gives up when the probability that all views missed the target is below this
    stop_below: float = 0.01
    #: a view is stale when it gains less than this share of its gain without earlier views
    stale: float = 0.5


BELIEF: Final = BeliefSettings()
#: [m/s] driving speed, fitted to the thesis' Table 4.5 (R^2 0.965)
SPEED: Final = 0.2412
#: [s] to turn once and look at a place; thesis section 4.4
LOOK_AROUND: Final = 41.79
#: share of all that views can find at which a plan is complete
ENOUGH: Final = 0.97
#: views that gain less than this share of what their plan finds are left out ...
IDLE: Final = 0.005
#: ... and so are views that gain less than this probability
MIN_CHANCE: Final = 0.002
#: views of a plan
MAX_VIEWS: Final = 80
#: rooms that are planned for; the belief in others stays where it is
MAX_ROOMS: Final = 48
#: times that a failed search takes fresh viewpoints; each time, views may gain half as much
MAX_ROUNDS: Final = 4
#: orders that are tried beyond the first
TRIALS: Final = 60
