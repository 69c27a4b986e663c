"""Every number of belief about where something is, in one place."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class BeliefSettings:
    """How candidates become probabilities on cells."""

    stays: float = 0.5  # share of what has moved that is still in its room
    leaves: float = 0.3  # share of what has moved that is on this floor no longer
    noticed: float = 0.6  # chance that mapping a room would have shown what stands in it
    beside: float = 0.5  # share of a room's belief that lies around objects it is found near
    site_sigma: float = 0.4  # [m] around a remembered position
    beside_sigma: float = 0.8  # [m] around an object it is found near
    even: float = 0.05  # share of every candidate's belief that is spread over the whole floor
    outside: float = 1.5  # [m] of floor assumed around an object that is in no place
    frontier: float = 0.3  # chance that a room begins where seen floor ends at unseen floor
    give_up: float = 0.005  # a look that finds less than this share of all is worth no way
    rest: float = 0.01  # chance that all looks missed a thing, at which to give up
    stale: float = 0.5  # a look that shows less than this share of its worth has become stale


BELIEF: Final = BeliefSettings()
#: [m/s] driving speed, fitted to the thesis' Table 4.5 (R^2 0.965)
SPEED: Final = 0.2412
#: [s] to turn once and look at a place; thesis section 4.4
LOOK_AROUND: Final = 41.79
#: chance to be found from which on a plan needs no more looks, of all that looking can find
ENOUGH: Final = 0.97
#: a look that finds less than this share of what its plan finds is left out
IDLE: Final = 0.005
#: ... and one that finds with less than this
LEAST_CHANCE: Final = 0.002
#: looks of a plan, at most
MOST_LOOKS: Final = 80
#: rooms that are planned for, at most; the others count as left over
MOST_ROOMS: Final = 48
#: times that a search in vain takes fresh positions, and is then content with looks half as good
MOST_ROUNDS: Final = 4
#: orders tried beyond the first, at most
TRIALS: Final = 60
