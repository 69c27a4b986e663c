"""Depth of one camera seen by another: forward projection with a depth buffer."""

from __future__ import annotations

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
    v, u = np.nonzero(depth > 0)
    z = depth[v, u].astype(np.float64)
    rays = np.linalg.inv(K_depth) @ np.stack([u, v, np.ones_like(u)])
    p = T_colour_depth[:3, :3] @ (rays * z) + T_colour_depth[:3, 3:]
    ahead = p[2] > 0
    q = K_colour @ p[:, ahead]
    column, row, z = q[0] / q[2], q[1] / q[2], p[2, ahead]
    if np.linalg.norm(K_colour[0, 0]) > K_depth[0, 0]:  # magnified: one pixel covers several
        column = np.concatenate([np.floor(column), np.ceil(column)] * 2)
        row = np.concatenate([np.floor(row)] * 2 + [np.ceil(row)] * 2)
        z = np.tile(z, 4)
    column, row = np.rint(column).astype(int), np.rint(row).astype(int)
    inside = (column >= 0) & (column < size[0]) & (row >= 0) & (row < size[1])
    seen = np.full(size[0] * size[1], np.inf, np.float32)
    np.minimum.at(seen, row[inside] * size[0] + column[inside], z[inside].astype(np.float32))
    seen[np.isinf(seen)] = np.nan
    return seen.reshape(size[1], size[0])
