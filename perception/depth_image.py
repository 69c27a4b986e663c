"""Depth images: points, normals and noise of each, on a grid of at most about 320 columns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

COLUMNS: Final = 320
_NEAR, _FAR = 0.3, 4.0  # [m] between which depth is used
_HALF: Final = 3  # pixels around one whose depth gives its normal
_MARGIN: Final = 3  # pixels of unknown depth around an image
_BETWEEN: Final = 2  # pixels to the two neighbours in line, between which noise is measured
_MIN_PIXELS: Final = 500  # pixels that noise is measured on
_USUAL: Final = 0.001  # noise where it cannot be measured
_SPREAD: Final = 1.48 / 1.22  # from the median of differences to the deviation of one depth
_MIN_OFFSET: Final = 0.004  # [m] in front of a plane, from which on a point is no part of it ...
_DEVIATIONS: Final = 3.0  # ... and so many deviations of its depth

Floats = NDArray[np.float64]
Pixels = NDArray[Any]


@dataclass(frozen=True, slots=True, eq=False)
class DepthImage:
    """Points and normals in the axes of the map; depth 0 and normal (0, 0, 0) are unknown."""

    depth: Floats  # (h, w) [m]
    points: Floats  # (h, w, 3) [m]
    normals: Floats  # (h, w, 3) towards the camera
    apart: Floats  # (h, w) [m] in front of a plane at which a point is surely not on it
    area: Floats  # (h, w) [m^2] of the surface that a pixel shows

    @classmethod
    def of(cls, depth: NDArray[np.float32], K: Floats, T_map_cam: Floats) -> DepthImage:
        """The image of `depth` (h, w) [m], 0 or not finite where it is unknown."""
        step = max(1, round(depth.shape[1] / COLUMNS))
        z = np.pad(_sampled(depth, step), _MARGIN)
        v, u = (np.mgrid[: z.shape[0], : z.shape[1]] - _MARGIN) * step + step // 2
        rays = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(z.shape)], -1)
        normals = _normals(z, rays)
        p_cam = rays * z[:, :, None]
        apart = _MIN_OFFSET + _DEVIATIONS * _noise(p_cam, normals) * z**2
        slant = np.abs((normals * rays).sum(-1)) / np.linalg.norm(rays, axis=-1)
        area = (z * step / K[0, 0]) ** 2 / np.maximum(slant, 0.15)
        R = T_map_cam[:3, :3]
        return cls(z, p_cam @ R.T + T_map_cam[:3, 3], normals @ R.T, apart, area)


def _sampled(depth: NDArray[np.float32], step: int) -> Floats:
    """Depth of every `step`-th pixel without single holes and outliers; 0 where it is unknown."""
    import cv2  # as late as possible: commands that need no depth start faster

    known = np.nan_to_num(depth, nan=0.0, posinf=0.0).astype(np.float32)
    filled = np.where(known > 0, known, cv2.dilate(known, np.ones((3, 3))))
    z = cv2.medianBlur(filled, 5)[step // 2 :: step, step // 2 :: step].astype(np.float64)
    return np.where((z > _NEAR) & (z < _FAR), z, 0.0)


def _normals(z: Floats, rays: Floats) -> Floats:
    """(h, w, 3) normals in the camera's axes: of planes, along which 1/z is linear in the image."""
    import cv2

    side, known = 2 * _HALF + 1, (z > 0).astype(np.float64)
    x, y = rays[:, :, 0], rays[:, :, 1]
    q = known / np.where(z > 0, z, 1.0)

    def total(values: Floats) -> Floats:
        square = (side, side)
        sums = cv2.boxFilter(values, -1, square, normalize=False, borderType=cv2.BORDER_CONSTANT)
        return np.asarray(sums, np.float64)

    count = total(known)
    share = 1 / np.maximum(count, 1)
    mx, my, mq = total(known * x) * share, total(known * y) * share, total(q) * share
    xx, yy = total(known * x * x) * share - mx * mx, total(known * y * y) * share - my * my
    xy = total(known * x * y) * share - mx * my
    xq, yq = total(q * x) * share - mx * mq, total(q * y) * share - my * mq
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (xq * yy - yq * xy), (yq * xx - xq * xy)
        plane = np.stack([a, b, mq * (xx * yy - xy**2) - a * mx - b * my], -1)
        normals = -plane / np.linalg.norm(plane, axis=-1, keepdims=True)
    good = (z > 0) & (count >= side**2 / 2) & np.isfinite(normals).all(-1)
    return np.where(good[:, :, None], normals, 0.0)


def _noise(p_cam: Floats, normals: Floats) -> float:
    """Deviation of depth [m] at a depth of 1 m, if it grows with the square of that."""
    k = _BETWEEN
    left, middle, right = p_cam[:, : -2 * k], p_cam[:, k:-k], p_cam[:, 2 * k :]
    normal = normals[:, k:-k]
    known = (normal != 0).any(-1) & (left[..., 2] > 0) & (right[..., 2] > 0)
    if known.sum() < _MIN_PIXELS:
        return _USUAL
    off = ((middle - (left + right) / 2) * normal).sum(-1)[known]
    return float(np.median(np.abs(off) / middle[known][:, 2] ** 2)) * _SPREAD
