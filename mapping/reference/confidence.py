"""Confidence update (eq. 3.1, 3.4), existence and running mean of an object (section 3.3.1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def reinforced(confidence: float, score: float, phi: float, nu: float) -> float:
    """Eq. 3.1 with its misprint corrected: C_k = min(C_{k-1} + phi D_k, nu).

    A new object starts from C_{k-1} = 0. C is not a probability.
    """
    return min(confidence + phi * score, nu)


def decayed(confidence: float, xi: float) -> float:
    """Eq. 3.4: C_k = C_{k-1} - xi; the object leaves the map when this is not positive."""
    return confidence - xi


def existence(confidence: float, nu: float) -> float:
    """Existence score C / nu, 0..1: orders objects, is not a calibrated probability."""
    return confidence / nu


def mean_position(
    p_map: NDArray[np.float64], observations: int, observed: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Running mean (3,) [m] of `observations` earlier positions and `observed` (3,)."""
    return np.asarray(p_map + (observed - p_map) / (observations + 1), dtype=np.float64)
