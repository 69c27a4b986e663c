"""When a detection is believed: when it, or with a second that agrees, makes the object likely."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapping.reference.settings import ReferenceSettings
from planner.execution.object_updates import AssociatedDetection
from planner.execution.protocol import Detected
from planner.goals.status import PRESENT
from planner.goals.targets import Target

#: A score from which one detection may be enough.
SURE: Final = 0.6
#: Looks straight at one spot that may hold a target.
MAX_VERIFICATIONS: Final = 3
#: [m] between detections that agree.
SAME_SPOT: Final = ReferenceSettings().kappa
#: Existence from which on what a look did not show again is looked for once more ...
POSSIBLE: Final = 0.2
#: [rad] ... from so far aside, as something may stand before it.
ASIDE: Final = 0.6

Spot = tuple[str, int, int]  # category's IRI, and a square metre of the floor


@dataclass(frozen=True, slots=True)
class TargetDetection:
    """Something that may be a target."""

    target: Target
    category: str  # IRI
    thing: Detected
    object: str | None  # IRI of the object that it was associated with
    certain: bool

    @property
    def p_map(self) -> NDArray[np.float64]:
        """(3,) [m]."""
        return np.array([self.thing.x, self.thing.y, self.thing.z])

    def shows(self, other: TargetDetection) -> bool:
        """Whether both show one thing: one object, or one spot while it is none yet."""
        if self.object is not None and self.object == other.object:
            return True
        distance = float(np.linalg.norm(self.p_map - other.p_map))
        return self.category == other.category and distance < SAME_SPOT

    @property
    def spot(self) -> Spot:
        """About where it is: an object that is doubted away and detected anew has another IRI."""
        return self.category, round(self.thing.x), round(self.thing.y)


class DetectionVerifier:
    """All that might have been a target so far; remembers what did not convince."""

    def __init__(self) -> None:
        self._seen: list[tuple[str, NDArray[np.float64]]] = []
        self._looks: Counter[Spot] = Counter()

    def judge(self, target: Target, detection: AssociatedDetection) -> TargetDetection:
        """Whether `detection` is believed to be there: what is found is an object, and likely."""
        thing, category = detection.thing, detection.category
        p_map = np.array([thing.x, thing.y, thing.z])
        again = any(
            category == other and float(np.linalg.norm(p_map - p_other)) < SAME_SPOT
            for other, p_other in self._seen
        )
        self._seen.append((category, p_map))
        likely = detection.iri is not None and detection.existence >= PRESENT
        certain = likely and (again or thing.score >= SURE)
        return TargetDetection(target, category, thing, detection.iri, certain)

    def open(self, detection: TargetDetection) -> bool:
        """Whether another look straight at it is worth while."""
        return self._looks[detection.spot] < MAX_VERIFICATIONS

    def aside(self, detection: TargetDetection) -> float:
        """[rad] from how far aside the next look at it is taken: straight at first."""
        return ASIDE if self._looks[detection.spot] else 0.0

    def note_look(self, detection: TargetDetection) -> None:
        """A look straight at it is taken."""
        self._looks[detection.spot] += 1
