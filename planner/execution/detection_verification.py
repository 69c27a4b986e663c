"""Detection verification: whether a detection of a target is certain or needs a second view."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapping.reference.settings import ReferenceSettings
from planner.execution.object_updates import AssociatedDetection
from planner.execution.protocol import Detected
from planner.search.goals.status import PRESENT
from planner.search.goals.targets import Target

#: Score from which a single detection can be certain.
SURE: Final = 0.6
#: Views taken to verify one spot.
MAX_VERIFICATIONS: Final = 3
#: [m] between detections that agree.
SAME_SPOT: Final = ReferenceSettings().kappa
#: Existence from which a detection that a second view missed is verified once more ...
POSSIBLE: Final = 0.2
#: [rad] ... from this far aside, since something may occlude it.
ASIDE: Final = 0.6

Spot = tuple[str, int, int]  # category's IRI, and a square metre of the floor


@dataclass(frozen=True, slots=True)
class TargetDetection:
    """Detection that may be a target."""

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
        """Whether both show the same object, or the same spot while there is no object yet."""
        if self.object is not None and self.object == other.object:
            return True
        distance = float(np.linalg.norm(self.p_map - other.p_map))
        return self.category == other.category and distance < SAME_SPOT

    @property
    def spot(self) -> Spot:
        """Category and rough position; IRIs differ when an object is removed and detected again."""
        return self.category, round(self.thing.x), round(self.thing.y)


class DetectionVerifier:
    """Judges detections of targets, and remembers those that were not certain."""

    def __init__(self) -> None:
        self._seen: list[tuple[str, NDArray[np.float64]]] = []
        self._looks: Counter[Spot] = Counter()

    def judge(self, target: Target, detection: AssociatedDetection) -> TargetDetection:
        """Judge a detection: certain if likely and seen again or with a high score."""
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
        """Whether another view of it is worth while."""
        return self._looks[detection.spot] < MAX_VERIFICATIONS

    def aside(self, detection: TargetDetection) -> float:
        """[rad] how far aside the next view of it is taken; the first is straight."""
        return ASIDE if self._looks[detection.spot] else 0.0

    def note_look(self, detection: TargetDetection) -> None:
        """Count a view taken to verify it."""
        self._looks[detection.spot] += 1
