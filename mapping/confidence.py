"""How sure the map is of an object, and where its mean lies (thesis section 3.3.1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def raised(confidence: float, score: float, phi: float, nu: float) -> float:
    """Eq. 3.1 with its misprint corrected: C_k = min(C_{k-1} + phi D_k, nu).

    A new object starts from C_{k-1} = 0. C is not a probability.
    """
    return min(confidence + phi * score, nu)


def lowered(confidence: float, xi: float) -> float:
    """Eq. 3.4: C_k = C_{k-1} - xi; the object leaves the map when this is not positive."""
    return confidence - xi


def existence(confidence: float, nu: float) -> float:
    """C / nu: the share of full confidence, 0..1. An ordering, not a calibrated probability."""
    return confidence / nu


def mean_position(
    p_map: NDArray[np.float64], observations: int, seen: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Iterative arithmetic mean: (3,) [m] after `observations` earlier ones and `seen` (3,)."""
    return np.asarray(p_map + (seen - p_map) / (observations + 1), dtype=np.float64)
