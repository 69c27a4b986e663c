"""Spread poses: which poses are apart from others, and which one is spare where there are many."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from perception.camera.poses import Pose

APART: Final = (0.2, np.deg2rad(15))  # [m], [rad] from each view to the next

Floats = NDArray[np.float64]


def is_new(T: Pose, poses: Sequence[Pose]) -> bool:
    """Whether a pose is apart from all others."""
    return not len(poses) or float(_differences(T, np.array(poses)).min()) >= 1.0


def spare(poses: Sequence[Pose]) -> int:
    """The pose that others replace best: the earlier of the nearest two."""
    all_ = np.array(poses)
    nearest = [_differences(T, all_[:n]).min(initial=np.inf) for n, T in enumerate(all_)]
    last = int(np.argmin(nearest))
    return int(_differences(all_[last], all_[:last]).argmin())


def _differences(T: Pose, poses: Floats) -> Floats:
    """Difference (n,) of a pose to others (n, 4, 4): 1 where it is far enough or turned enough."""
    far = np.linalg.norm(poses[:, :3, 3] - T[:3, 3], axis=1)
    cosine = (np.einsum("nij,ij->n", poses[:, :3, :3], T[:3, :3]) - 1) / 2
    turned = np.arccos(np.clip(cosine, -1, 1))
    result: Floats = np.maximum(far / APART[0], turned / APART[1])
    return result
