"""Rectification: lens distortion undone, depth resampled to the size of colour."""

from __future__ import annotations

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
