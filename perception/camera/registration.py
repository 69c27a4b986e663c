"""Depth of one camera seen by another: forward projection with a depth buffer."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def register_depth(
    depth: NDArray[np.float32],
    K_depth: NDArray[np.float64],
    K_colour: NDArray[np.float64],
    T_colour_depth: NDArray[np.float64],
    size: tuple[int, int],
) -> NDArray[np.float32]:
    """Depth as the colour camera sees it, (H, W) [m], nan = no return.

    `depth` (h, w) [m] of the depth camera, `T_colour_depth` (4, 4) takes its coordinates to the
    colour camera's, `size` is (W, H) [px] of the colour image. Where two surfaces fall on one pixel
    the nearer wins; each point covers the pixels its own pixel spreads over (2 x 2 at most).
    """
    M = K_colour @ T_colour_depth[:3, :3] @ np.linalg.inv(K_depth)
    b = K_colour @ T_colour_depth[:3, 3]
    v, u = np.nonzero(depth > 0)
    z = depth[v, u].astype(np.float64)
    x, y, z = (z * (m[0] * u + m[1] * v + m[2]) + t for m, t in zip(M, b, strict=True))
    ahead = z > 0
    column, row, z = x[ahead] / z[ahead], y[ahead] / z[ahead], z[ahead].astype(np.float32)
    magnified = np.linalg.norm(K_colour[0, 0]) > K_depth[0, 0]  # one pixel covers several
    steps: Sequence[np.ufunc] = (np.floor, np.ceil) if magnified else (np.rint,)
    columns, rows = (
        [np.clip(step(at), -1, end).astype(np.int32) for step in steps]
        for at, end in zip((column, row), size, strict=True)
    )
    seen = np.full(size[0] * size[1], np.inf, np.float32)
    for c, r in itertools.product(columns, rows):
        inside = (c >= 0) & (c < size[0]) & (r >= 0) & (r < size[1])
        np.minimum.at(seen, (r * size[0] + c)[inside], z[inside])
    seen[np.isinf(seen)] = np.nan
    return seen.reshape(size[1], size[0])
