"""Sightings: detections with a position in the map, one by one or grouped by thing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Box = tuple[float, float, float, float]  # xyxy [px]


@dataclass(frozen=True, slots=True)
class Sighting:
    """Localised detection, from a depth image or from a robot that measures positions."""

    category: str  # IRI of its class
    score: float  # D of eq. 3.1, 0..1
    p_map: Floats  # (3,) [m]
    depth: float | None = None  # [m] along the optical axis; None: not from a depth image
    box: Box | None = None  # xyxy [px]; None: no pixels known
    frame: str = ""  # id of the image that `box` is in


@dataclass(frozen=True, slots=True)
class ThingSighting:
    """One thing in one frame: its detections, position and extent."""

    scores: Mapping[tuple[str, str], float]  # (detector, category IRI) -> best score
    p_map: Floats  # (3,) [m] mean of the visible surface
    low: Floats  # (3,) [m] corners of the visible points' box, in the map's axes
    high: Floats
    size: float  # [m] longer side of the box at its depth
    depth: float | None  # [m] along the optical axis; None: not from a depth image
    box: Box | None  # of the strongest detection
    cut: bool  # whether the image's border cuts the box
    categories: frozenset[str] = frozenset()  # IRIs of its detections' categories
    point: bool = False  # whether nothing but its position was measured; `size` is the usual one

    @property
    def best(self) -> dict[str, float]:
        """Best score of each category."""
        found: dict[str, float] = {}
        for (_, category), score in self.scores.items():
            found[category] = max(found.get(category, 0.0), score)
        return found
