"""Depth images: points, normals and noise of each, on a grid of at most about 320 columns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

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
Planes = NDArray[
    np.floating
]  # 32 bits, of pixels, x, y and z apart, which is several times as fast


@dataclass(frozen=True, slots=True, eq=False)
class DepthImage:
    """Points and normals in the axes of the map; depth 0 and normal (0, 0, 0) are unknown."""

    depth: Planes  # (h, w) [m]
    points: Planes  # (3, h, w) [m]
    normals: Planes  # (3, h, w) towards the camera
    apart: Planes  # (h, w) [m] in front of a plane at which a point is surely not on it
    area: Planes  # (h, w) [m^2] of the surface that a pixel shows

    @classmethod
    def of(cls, depth: NDArray[np.float32], K: Floats, T_map_cam: Floats) -> DepthImage:
        """The image of `depth` (h, w) [m], 0 or not finite where it is unknown."""
        step = max(1, round(depth.shape[1] / COLUMNS))
        z = np.pad(_sampled(depth, step), _MARGIN)
        x, y = (
            ((((np.arange(n) - _MARGIN) * step + step // 2) - K[k, 2]) / K[k, k]).astype(np.float32)
            for k, n in enumerate(z.shape[::-1])
        )
        y = y[:, None]
        normals = _normals(z, x, y)
        p_cam = np.stack([x * z, y * z, z])
        apart = np.float32(_MIN_OFFSET) + np.float32(_DEVIATIONS * _noise(p_cam, normals)) * z * z
        slant = np.abs(normals[0] * x + normals[1] * y + normals[2]) / np.sqrt(x * x + y * y + 1)
        area = (z * np.float32(step / K[0, 0])) ** 2 / np.maximum(slant, np.float32(0.15))
        R, t = T_map_cam[:3, :3].astype(np.float32), T_map_cam[:3, 3:].astype(np.float32)
        points, turned = R @ p_cam.reshape(3, -1) + t, R @ normals.reshape(3, -1)
        return cls(z, points.reshape(p_cam.shape), turned.reshape(p_cam.shape), apart, area)


def dot(a: Planes, b: Planes) -> Planes:
    """Scalar products of vectors, whose x, y and z are the first axis."""
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def _sampled(depth: NDArray[np.float32], step: int) -> Planes:
    """Depth of every `step`-th pixel without single holes and outliers; 0 where it is unknown."""
    import cv2  # as late as possible: commands that need no depth start faster

    depth = depth.astype(np.float32, copy=False)  # OpenCV's filter takes no other floats
    known = np.where((depth > 0) & (depth < np.inf), depth, np.float32(0))  # nan: 0
    filled = cv2.dilate(known, np.ones((3, 3)))
    np.copyto(filled, known, where=known > 0)
    z = cv2.medianBlur(filled, 5)[step // 2 :: step, step // 2 :: step]
    return np.where((z > np.float32(_NEAR)) & (z < np.float32(_FAR)), z, np.float32(0))


def _normals(z: Planes, x: Planes, y: Planes) -> Planes:
    """(3, h, w) normals in the camera's axes: of planes, along which 1/z is linear in the image."""
    import cv2

    known = (z > 0).astype(np.float32)
    q = known / np.where(z > 0, z, np.float32(1))
    steps = np.arange(-_HALF, _HALF + 1, dtype=np.float32)
    one, dx, dy = np.ones_like(steps), steps * (x[1] - x[0]), steps * (y[1, 0] - y[0, 0])

    def total(values: Planes, across: Planes, down: Planes) -> Planes:
        """Sums around each pixel, weighted by the place beside it."""
        sums = cv2.sepFilter2D(values, -1, across, down, borderType=cv2.BORDER_CONSTANT)
        return np.asarray(sums, np.float32)

    count = total(known, one, one)
    share = 1 / np.maximum(count, 1)
    mx, my, mq = (total(known, dx, one), total(known, one, dy), total(q, one, one))
    mx, my, mq = mx * share, my * share, mq * share
    xx = total(known, dx * dx, one) * share - mx * mx
    yy = total(known, one, dy * dy) * share - my * my
    xy = total(known, dx, dy) * share - mx * my
    xq, yq = total(q, dx, one) * share - mx * mq, total(q, one, dy) * share - my * mq
    a, b = (xq * yy - yq * xy), (yq * xx - xq * xy)
    plane = np.stack([a, b, mq * (xx * yy - xy * xy) - a * (x + mx) - b * (y + my)])
    length = np.sqrt(dot(plane, plane))
    good = (z > 0) & (count >= (2 * _HALF + 1) ** 2 / 2) & (length > 0)
    plane /= -np.where(good, length, np.float32(1))
    np.copyto(plane, np.float32(0), where=~good)
    return plane


def _noise(p_cam: Planes, normals: Planes) -> float:
    """Deviation of depth [m] at a depth of 1 m, if it grows with the square of that."""
    k = _BETWEEN
    left, middle, right = p_cam[:, :, : -2 * k], p_cam[:, :, k:-k], p_cam[:, :, 2 * k :]
    normal = normals[:, :, k:-k]
    known = (dot(normal, normal) > 0) & (left[2] > 0) & (right[2] > 0)
    if known.sum() < _MIN_PIXELS:
        return _USUAL
    off = dot(middle - (left + right) / 2, normal)[known]
    return float(np.median(np.abs(off) / middle[2][known] ** 2)) * _SPREAD
