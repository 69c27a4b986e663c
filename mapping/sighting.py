"""Sighting: a localised detection, from a depth image or from a robot that measures positions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Sighting:
    """Localised detection: a category, a score and a position in the map."""

    category: str  # IRI of its class
    score: float  # D of eq. 3.1, 0..1
    p_map: NDArray[np.float64]  # (3,) [m]
    depth: float | None = None  # [m] along the optical axis; None: not from a depth image
    box: tuple[float, float, float, float] | None = None  # xyxy [px]; None: no pixels known
    frame: str = ""  # id of the image that `box` is in
