"""When a detection is believed: a sure one at once, a doubtful one when a second agrees."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapping.settings import ReferenceSettings
from planner.executive.protocol import Detected
from planner.finding.targets import Target

#: A score from which one detection is enough.
SURE: Final = 0.6


@dataclass(frozen=True, slots=True)
class Sighting:
    """Something that may be a target."""

    target: Target
    category: str  # IRI
    thing: Detected
    certain: bool
    again: bool  # something was seen there before

    @property
    def p_map(self) -> NDArray[np.float64]:
        """(3,) [m]."""
        return np.array([self.thing.x, self.thing.y, self.thing.z])


class Sightings:
    """All that might have been a target so far; remembers what did not convince."""

    def __init__(self, settings: ReferenceSettings | None = None) -> None:
        self._kappa = (settings or ReferenceSettings()).kappa
        self._seen: list[tuple[str, NDArray[np.float64]]] = []

    def judge(self, target: Target, category: str, thing: Detected) -> Sighting:
        """Whether `thing`, of `category` (IRI), is believed to be there."""
        p_map = np.array([thing.x, thing.y, thing.z])
        again = any(
            category == other and float(np.linalg.norm(p_map - p_other)) < self._kappa
            for other, p_other in self._seen
        )
        self._seen.append((category, p_map))
        return Sighting(target, category, thing, again or thing.score >= SURE, again)
