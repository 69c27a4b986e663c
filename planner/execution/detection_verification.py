"""Detection verification: whether a detection of a target is certain or needs a second view."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.history.reports.comparison import PRESENT
from mapping.reference.settings import ReferenceSettings
from planner.execution.object_updates import AssociatedDetection
from planner.execution.protocol import Detected
from planner.search.goals.targets import Target

SURE: Final = 0.6  # score from which on a single detection can be certain
MAX_VERIFICATIONS: Final = 3  # views taken to verify one spot
SAME_SPOT: Final = ReferenceSettings().kappa  # [m] between detections of one object
#: existence from which on a detection is verified again after a second view missed it
POSSIBLE: Final = 0.2
ASIDE: Final = 0.6  # [rad] around the object to the next viewpoint, since it may be occluded

Spot = tuple[str, int, int]  # category's IRI, and a square metre of the floor


@dataclass(frozen=True, slots=True)
class TargetDetection:
    """Detection that may be a target."""

    target: Target
    category: str  # IRI
    thing: Detected
    object: str | None  # IRI of the associated object
    certain: bool

    @property
    def p_map(self) -> NDArray[np.float64]:
        """(3,) [m]."""
        return np.array([self.thing.x, self.thing.y, self.thing.z])

    def shows(self, other: TargetDetection) -> bool:
        """Whether both show the same object, or the same category at the same spot."""
        if self.object is not None and self.object == other.object:
            return True
        distance = float(np.linalg.norm(self.p_map - other.p_map))
        return self.category == other.category and distance < SAME_SPOT

    @property
    def spot(self) -> Spot:
        """Category and rough position; IRIs differ when an object is removed and detected again."""
        return self.category, round(self.thing.x), round(self.thing.y)


class DetectionVerifier:
    """Judges detections of targets, and counts the views that verify each spot."""

    def __init__(self) -> None:
        self._earlier: list[tuple[str, NDArray[np.float64]]] = []  # category and position
        self._views: Counter[Spot] = Counter()

    def judge(self, target: Target, detection: AssociatedDetection) -> TargetDetection:
        """Judge a detection: certain if it is likely, and repeated or of a high score."""
        thing, category = detection.thing, detection.category
        p_map = np.array([thing.x, thing.y, thing.z])
        repeated = any(
            category == other and float(np.linalg.norm(p_map - p_other)) < SAME_SPOT
            for other, p_other in self._earlier
        )
        self._earlier.append((category, p_map))
        likely = detection.iri is not None and detection.existence >= PRESENT
        certain = likely and (repeated or thing.score >= SURE)
        return TargetDetection(target, category, thing, detection.iri, certain)

    def open(self, detection: TargetDetection) -> bool:
        """Whether another view may verify the detection."""
        return self._views[detection.spot] < MAX_VERIFICATIONS

    def doubtful(self, detections: Sequence[TargetDetection]) -> list[TargetDetection]:
        """Uncertain detections that another view may verify, one for each spot."""
        return list({d.spot: d for d in detections if not d.certain and self.open(d)}.values())

    def aside(self, detection: TargetDetection) -> float:
        """[rad] around the object to the next viewpoint; the first view is straight."""
        return ASIDE if self._views[detection.spot] else 0.0

    def count_view(self, detection: TargetDetection) -> None:
        """Count a view taken to verify the detection."""
        self._views[detection.spot] += 1
