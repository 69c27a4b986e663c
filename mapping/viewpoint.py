"""Whether a view can describe one place (thesis section 3.3.2, Fig. 3.12 and 3.13)."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from mapping.localisation import back_project, to_map
from perception.frame import Frame


def map_points(frame: Frame, stride: int, max_depth: float = math.inf) -> NDArray[np.float64]:
    """Every `stride`-th pixel with depth up to `max_depth` [m], as points (n, 3) [m] of the map."""
    sampled = frame.depth[::stride, ::stride]
    rows, columns = np.nonzero((sampled > 0) & (sampled <= max_depth))
    depths = sampled[rows, columns].astype(np.float64)
    return to_map(frame.T_map_cam, back_project(rows * stride, columns * stride, depths, frame.K))


def unknown_share(frame: Frame, stride: int) -> float:
    """Share, 0..1, of every `stride`-th pixel that has no depth."""
    return 1 - float(np.mean(frame.depth[::stride, ::stride] > 0))


def main_owner(owners: NDArray[np.intp], purity: float) -> int | None:
    """The place that holds at least `purity` of the points; `owners` (n,) names each one's, or -1.

    Points in no place count against every place.
    """
    inside = owners[owners >= 0]
    if len(inside) == 0:
        return None
    counts = np.bincount(inside)
    best = int(np.argmax(counts))
    return best if counts[best] >= purity * len(owners) else None


def turn(T_a: NDArray[np.float64], T_b: NDArray[np.float64]) -> float:
    """Angle [rad] of the rotation between two poses (4, 4)."""
    trace = float(np.sum(T_a[:3, :3] * T_b[:3, :3]))
    return math.acos(min(max((trace - 1) / 2, -1.0), 1.0))


def used_up(
    T: NDArray[np.float64], history: Iterable[NDArray[np.float64]], distance: float, angle: float
) -> bool:
    """Whether pose `T` (4, 4) is within `distance` [m] and `angle` [rad] of one in `history`."""
    return any(
        float(np.linalg.norm(T[:3, 3] - past[:3, 3])) <= distance and turn(T, past) <= angle
        for past in history
    )
