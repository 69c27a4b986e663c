"""Rectification: lens distortion undone, depth resampled or registered to the image of colour."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.camera.intrinsics import Intrinsics


@dataclass(frozen=True, slots=True)
class Rectifier:
    """Rectification of one camera's colour and depth onto colour's undistorted pixel grid.

    Depth of another size than colour is resampled to colour's (nearest, since averaging across an
    edge invents points in mid air); the two must have one aspect, as registered images have.
    """

    camera: Intrinsics  # fitted to the colour image
    maps: tuple[NDArray[np.float32], NDArray[np.float32]] | None  # (H, W) source column and row

    @classmethod
    def for_camera(cls, camera: Intrinsics) -> Rectifier:
        """A rectifier for intrinsics fitted to the colour image."""
        if not camera.distorted:
            return cls(camera, None)
        model = cv2.fisheye if camera.fisheye else cv2
        columns, lines = model.initUndistortRectifyMap(
            camera.K, np.array(camera.dist), np.eye(3), camera.K, camera.size, cv2.CV_32FC1
        )
        return cls(camera, (columns.astype(np.float32), lines.astype(np.float32)))

    def colour(self, rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """(H, W, 3) with distortion undone, bilinear; black where the camera saw nothing."""
        if self.maps is None:
            return rgb
        return cv2.remap(rgb, *self.maps, cv2.INTER_LINEAR).astype(np.uint8, copy=False)

    def depth(self, depth: NDArray[np.float32]) -> NDArray[np.float32]:
        """(H, W) [m] at the colour image's size with distortion undone, nearest."""
        size = self.camera.size
        if depth.shape[::-1] != size:
            depth = cv2.resize(depth, size, interpolation=cv2.INTER_NEAREST_EXACT).astype(
                np.float32, copy=False
            )
        if self.maps is None:
            return depth
        return cv2.remap(
            depth, *self.maps, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=np.nan
        ).astype(np.float32, copy=False)


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
