"""Self-calibration: the focal length and principal point by which pairs of views fit best.

Two RGB-D views that a turn separates show one rigid scene by the right intrinsics only: a wrong
focal length scales what lies across the view and leaves depth as it is. The motions of all pairs
and the intrinsics are adjusted together, so no poses are needed (bundle adjustment of a camera's
interior: Triggs et al., Vision Algorithms, 1999). A unit of depth that is wrong is not noticed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.camera.poses import Pose, motion_of
from perception.odometry.features import Features, matched
from perception.odometry.relative_motion import consensus, linearised

Floats = NDArray[np.float64]

MIN_MATCHES: Final = 25  # of a pair
EPIPOLAR: Final = 1.5  # [px] of a match, by no intrinsics at all
COARSE: Final = 8.0  # [px] of a match, by intrinsics that may be wrong
STEPS: Final = 15
WIDTHS: Final = np.maximum(8.0 * 0.6 ** np.arange(STEPS), 1.5)  # [px] from which residuals fade
MAX_STEP: Final = 0.15  # of a parameter in a step
_TOGETHER: Final = 4.0  # neighbouring corners share errors: so many count as one
_NUDGE: Final = 1e-5


@dataclass(frozen=True, slots=True, eq=False)
class MatchedPair:
    """Corners that two views show, and a first guess of the motion between them."""

    pixels: tuple[Floats, Floats]  # (n, 2) [px] of each view
    depth: tuple[Floats, Floats]  # (n,) [m]
    T: Pose  # (4, 4) takes points of the first camera to the second


@dataclass(frozen=True, slots=True)
class CalibrationFit:
    """Intrinsics that fit: the given ones, changed by this much."""

    focal: float  # natural logarithm of the focal length's factor
    right: float  # principal point, in given focal lengths
    down: float
    deviation: float  # largest standard deviation of the three

    def adjusted(self, K: Floats) -> Floats:
        """The intrinsics (3, 3) [px] that fit."""
        changed: Floats = K * np.array(
            [[np.exp(self.focal), 1, 1], [1, np.exp(self.focal), 1], [1, 1, 1]]
        )
        changed[:2, 2] += K[0, 0] * np.array([self.right, self.down])
        return changed


def matched_pair(first: Features, second: Features, K: Floats) -> MatchedPair | None:
    """The corners that two views share; None where there are too few."""
    a, b = matched(first, second)
    if len(a) < MIN_MATCHES:
        return None
    _, mask = cv2.findFundamentalMat(
        first.pixels[a], second.pixels[b], cv2.USAC_MAGSAC, EPIPOLAR, 0.999, 2000
    )
    good = np.zeros(len(a), np.bool_) if mask is None else mask.ravel() > 0
    if good.sum() < MIN_MATCHES:
        return None
    a, b = a[good], b[good]
    T, inliers = consensus(first.points[a], second.pixels[b], K, COARSE, confidence=0.99)
    if T is None or 2 * len(inliers) < MIN_MATCHES:
        return None
    return MatchedPair(
        (first.pixels[a], second.pixels[b]), (first.points[a, 2], second.points[b, 2]), T
    )


def self_calibrated(pairs: Sequence[MatchedPair], K: Floats) -> CalibrationFit | None:
    """The intrinsics near `K` (3, 3) [px] that fit all pairs best; None where nothing tells.

    Gauss-Newton; the motions are eliminated from the normal equations (Schur complement).
    """
    fit, T = np.zeros(3), [pair.T for pair in pairs]
    for width in WIDTHS:
        A, g, steps = np.zeros((3, 3)), np.zeros(3), []
        cost = weights = 0.0
        for pair, at in zip(pairs, T, strict=True):
            r, J = _residuals(fit, pair, K, at)
            nudged = [_residuals(fit + _NUDGE * axis, pair, K, at)[0] for axis in np.eye(3)]
            Jk = (np.stack(nudged, axis=2) - r[:, :, None]) / _NUDGE
            w = 1 / (1 + (r**2).sum(axis=1) / width**2) ** 2
            cost, weights = cost + float(w @ (r**2).sum(axis=1)), weights + float(w.sum())
            Jw, Jkw = J * w[:, None, None], Jk * w[:, None, None]
            across = np.tensordot(Jw, Jk, ((0, 1), (0, 1)))
            right = np.column_stack([across, np.tensordot(Jw, r, ((0, 1), (0, 1)))])
            H = np.tensordot(Jw, J, ((0, 1), (0, 1))) + 1e-6 * np.eye(6)
            solved = np.linalg.solve(H, right)
            A += np.tensordot(Jkw, Jk, ((0, 1), (0, 1))) - across.T @ solved[:, :3]
            g += np.tensordot(Jkw, r, ((0, 1), (0, 1))) - across.T @ solved[:, 3]
            steps.append(solved)
        if not weights or not np.isfinite(A).all() or np.linalg.cond(A) > 1e9:
            return None
        step = np.clip(-np.linalg.solve(A, g), -MAX_STEP, MAX_STEP)
        T = [
            motion_of(-(solved[:, 3] + solved[:, :3] @ step)) @ at
            for solved, at in zip(steps, T, strict=True)
        ]
        fit = fit + step
    variance = np.diag(np.linalg.inv(A)) * _TOGETHER * cost / (2 * weights)
    return _fit(fit, float(np.sqrt(variance.max())))


def _residuals(fit: Floats, pair: MatchedPair, K: Floats, T: Pose) -> tuple[Floats, Floats]:
    """Residuals (n, 3) [px] of a pair by changed intrinsics, and their Jacobian (n, 3, 6)."""
    changed = _fit(fit).adjusted(K)
    z = pair.depth[0]
    across = (pair.pixels[0] - changed[:2, 2]) / changed[[0, 1], [0, 1]] * z[:, None]
    return linearised(np.column_stack([across, z]), pair.pixels[1], pair.depth[1], changed, T)


def _fit(numbers: Floats, deviation: float = 0.0) -> CalibrationFit:
    return CalibrationFit(float(numbers[0]), float(numbers[1]), float(numbers[2]), deviation)
