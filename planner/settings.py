"""Settings of the belief about a target's position, and of plans."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class BeliefSettings:
    """Settings by which candidates become probabilities on cells."""

    p_same_room: float = 0.5  # that a moved object is still in its room
    p_left_floor: float = 0.3  # that a moved object is no longer on this floor
    noticed: float = 0.6  # probability that mapping a room shows an object in it
    beside: float = 0.5  # share of a room's belief that lies around objects the target is near
    site_sigma: float = 0.4  # [m] standard deviation around a position of unknown deviation
    min_sigma: float = 0.15  # [m] least one: the middle of a thing is not all of it
    found: float = 0.9  # existence of what a search found, as long as it is probable at all
    beside_sigma: float = 0.8  # [m] standard deviation around an object the target is near
    uniform_share: float = 0.05  # share of each candidate's belief that is even over the floor
    outside: float = 1.5  # [m] floor that is assumed around an object in no place
    frontier: float = 0.3  # probability that a room begins beyond a frontier
    give_up: float = 0.005  # share of all probability that a view must gain
    likely: float = 0.25  # probability to find a known thing from which on its views come first
    stop_below: float = 0.005  # probability that all views missed it, at which a search gives up
    stale: float = 0.5  # a view that gains less than this share of its first gain is stale


BELIEF: Final = BeliefSettings()
#: [m/s] driving speed, fitted to the thesis' Table 4.5 (R^2 0.965)
SPEED: Final = 0.2412
#: [s] to turn once and look at a place; thesis section 4.4
LOOK_AROUND: Final = 41.79
#: share of the probability that any views can find, at which a plan is complete
ENOUGH: Final = 0.97
#: probability to find a target below which a view of a plan is not worth its time
WORTH: Final = 0.02
MAX_VIEWS: Final = 80  # of a plan
MAX_ROOMS: Final = 48  # rooms with viewpoints
MAX_FLOOR: Final = 1000.0  # [m2] of them together
#: times that a failed search takes fresh viewpoints; each time the gain asked for is halved
MAX_ROUNDS: Final = 4
TRIALS: Final = 60  # orders of views that are tried beyond the first
