"""Rigid motions: their matrices, and a rotation vector [rad] and translation [m] as six numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def motions(steps: Floats) -> Floats:
    """Rigid motions (n, 4, 4) of rotation vectors and translations (n, 6)."""
    angle = np.linalg.norm(steps[:, :3], axis=1)
    S = skew(steps[:, :3])
    a = np.sinc(angle / np.pi)[:, None, None]
    b = (0.5 * np.sinc(angle / (2 * np.pi)) ** 2)[:, None, None]
    T = np.tile(np.eye(4), (len(steps), 1, 1))
    T[:, :3, :3] += a * S + b * (S @ S)
    T[:, :3, 3] = steps[:, 3:]
    return T


def rigid(T: Floats) -> Floats:
    """The rigid motion (4, 4) nearest to a product of many, whose rounding would add up."""
    U, _, Vt = np.linalg.svd(T[:3, :3])
    made = np.eye(4)
    made[:3, :3], made[:3, 3] = U @ Vt, T[:3, 3]
    return made


def inverse(T: Floats) -> Floats:
    """Inverse of a rigid motion (4, 4)."""
    made = np.eye(4)
    made[:3, :3] = T[:3, :3].T
    made[:3, 3] = -T[:3, :3].T @ T[:3, 3]
    return made


def motion_of(step: Floats) -> Floats:
    """Rigid motion (4, 4) of a rotation vector and a translation (6,)."""
    T: Floats = motions(step[None])[0]
    return T


def logarithms(T: Floats) -> Floats:
    """Rotation vectors [rad] and translations [m] (n, 6) of motions (n, 4, 4), less than a turn."""
    R = T[:, :3, :3]
    axis = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], 1)
    sine = np.linalg.norm(axis, axis=1) / 2
    cosine = np.clip((np.trace(R, axis1=1, axis2=2) - 1) / 2, -1, 1)
    angle = np.arctan2(sine, cosine)
    scale = np.where(sine > 1e-9, angle / np.maximum(2 * sine, 1e-12), 0.5)
    return np.hstack([axis * scale[:, None], T[:, :3, 3]])


def adjoints(T: Floats) -> Floats:
    """(n, 6, 6) takes a small motion before T to the equal small motion after T."""
    R = T[:, :3, :3]
    made = np.zeros((len(T), 6, 6))
    made[:, :3, :3] = made[:, 3:, 3:] = R
    made[:, 3:, :3] = skew(T[:, :3, 3]) @ R
    return made


def skew(p: Floats) -> Floats:
    """(..., 3, 3) with `skew(p) @ q` the cross product of p (..., 3) and q."""
    made = np.zeros((*p.shape[:-1], 3, 3))
    made[..., 0, 1], made[..., 0, 2], made[..., 1, 2] = -p[..., 2], p[..., 1], -p[..., 0]
    made[..., 1, 0], made[..., 2, 0], made[..., 2, 1] = p[..., 2], -p[..., 1], p[..., 0]
    return made
