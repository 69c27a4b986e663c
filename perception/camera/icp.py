"""ICP of two depth images: the small correction of the motion between them.

Iterative closest points, point to plane (Chen and Medioni, Image and Vision Computing 10, 1992),
with projective association as in `perception.camera.depth_agreement`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from perception.camera.depth_agreement import Agreement, DepthSamples, agreement, nearest_pixels
from perception.camera.rigid_motions import motion_of

Floats = NDArray[np.float64]

STEPS: Final = 12
GATES: Final = (0.5, 0.06)  # [m] distance of a point from its plane that still counts: first, last
MIN_POINTS: Final = 60  # points
DAMPING: Final = 0.02  # of a point's weight: what few surfaces hold stays as it is


@dataclass(frozen=True, slots=True)
class Correction:
    """Correction of a motion that makes two depth images agree."""

    T_a_b: Floats  # (4, 4) the corrected motion, camera b to camera a
    after: Agreement  # of the images by it
    offset: float  # [m] by which the points of b move, median


def register(a: DepthSamples, b: DepthSamples, T_a_b: Floats) -> Correction:
    """Correction of the motion `T_a_b` (4, 4), right to some decimetres."""
    T, normals = T_a_b.copy(), surface_normals(a)
    for gate in np.geomspace(*GATES, STEPS):
        step = _step(a, normals, b.points @ T[:3, :3].T + T[:3, 3], float(gate))
        if step is None:
            break
        T = step @ T
    moved = b.points @ (T[:3, :3] - T_a_b[:3, :3]).T + (T[:3, 3] - T_a_b[:3, 3])
    offset = float(np.median(np.linalg.norm(moved, axis=1))) if len(moved) else 0.0
    return Correction(T, agreement(a, b, T), offset)


def _step(a: DepthSamples, normals: Floats, points: Floats, gate: float) -> Floats | None:
    """One Gauss-Newton step (4, 4) of the points (n, 3) [m] of camera a; None with too few."""
    found = plane_residuals(a, normals, points, gate)
    if found is None:
        return None
    J, off, _ = found
    weight = 1 / (1 + (off / (0.3 * gate)) ** 2)
    H = (J * weight[:, None]).T @ J + DAMPING * weight.sum() * np.eye(6)
    twist = np.linalg.solve(H, (J * weight[:, None]).T @ off)
    return motion_of(twist)


def plane_residuals(
    a: DepthSamples, normals: Floats, points: Floats, gate: float
) -> tuple[Floats, Floats, Floats] | None:
    """Jacobian (n, 6), distance (n,) [m] and depth (n,) [m] of points off the planes of camera a.

    None with too few points nearer than `gate` [m] to the plane that the camera shows there.
    """
    seen, rows, columns = nearest_pixels(a, points)
    z = a.depth[rows, columns]
    target = np.column_stack(
        [
            (columns - a.K[0, 2]) * z / a.K[0, 0],
            (rows - a.K[1, 2]) * z / a.K[1, 1],
            z,
        ]
    )
    p, n = points[seen], normals[rows, columns]
    with np.errstate(invalid="ignore"):
        off = np.einsum("ij,ij->i", target - p, n)
        used = np.abs(off) < gate  # nan compares false
    if used.sum() < MIN_POINTS:
        return None
    p, n, off = p[used], n[used], off[used]
    return np.hstack([np.cross(p, n), n]), off, p[:, 2]


def surface_normals(camera: DepthSamples) -> Floats:
    """Unit normals (h, w, 3) by central differences; nan at edges and borders."""
    height, width = camera.depth.shape
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    z, K = camera.depth, camera.K
    p = np.stack([(columns - K[0, 2]) * z / K[0, 0], (rows - K[1, 2]) * z / K[1, 1], z], axis=2)
    found = np.full(p.shape, np.nan)
    n = np.cross(p[2:, 1:-1] - p[:-2, 1:-1], p[1:-1, 2:] - p[1:-1, :-2])
    with np.errstate(invalid="ignore", divide="ignore"):
        found[1:-1, 1:-1] = n / np.linalg.norm(n, axis=2, keepdims=True)
    return found
