"""Encoding of views: a few kilobytes of features and coarse depth, without an image."""

from __future__ import annotations

import zlib
from typing import Final

import numpy as np

from perception.camera.depth_agreement import COLUMNS, gridded_samples
from perception.camera.poses import Pose
from perception.odometry.features import Features
from perception.odometry.recognition import KEPT, KeyView

_STEPS: Final = 1000  # of a metre, in which points and depth are kept
_HEAD: Final = np.dtype([("points", "<u2"), ("shape", "<u2", 2), ("K", "<f4", (3, 3))])
_POINT: Final = np.dtype([("xyz", "<i2", 3), ("descriptor", "u1", 32)])
_MAX_DEPTH: Final = 32.0  # [m] of depth and points that are kept
_MAX_SIDE: Final = 4 * COLUMNS  # of the grid of depth


def encoded(view: KeyView) -> bytes:
    """A view without its pose."""
    f = view.features
    near = np.flatnonzero((np.abs(f.points) < _MAX_DEPTH).all(axis=1))[:KEPT]
    points = np.zeros(len(near), _POINT)
    points["xyz"] = np.rint(f.points[near] * _STEPS)
    points["descriptor"] = f.descriptors[near]
    depth = np.where(f.samples.depth < _MAX_DEPTH, f.samples.depth, 0.0)  # nan: 0
    head = np.zeros((), _HEAD)
    head["points"], head["shape"], head["K"] = len(near), depth.shape, f.samples.K
    grid = np.rint(depth * _STEPS).astype("<u2").tobytes()
    return head.tobytes() + points.tobytes() + zlib.compress(grid)


def decoded(data: bytes, pose: Pose) -> KeyView:
    """The view of `encoded` with its pose; raises ValueError for anything else."""
    head = np.frombuffer(data, _HEAD, 1)[0]
    count, (height, width) = int(head["points"]), map(int, head["shape"])
    K = head["K"].astype(np.float64)
    if count > KEPT or not (0 < height <= _MAX_SIDE and 0 < width <= _MAX_SIDE):
        raise ValueError(f"a view has up to {KEPT} points and a grid of {_MAX_SIDE} a side")
    if not (np.isfinite(K).all() and K[0, 0] > 0 and K[1, 1] > 0):
        raise ValueError("a view has a focal length")
    points = np.frombuffer(data, _POINT, count, _HEAD.itemsize)
    start, size = _HEAD.itemsize + points.nbytes, 2 * height * width
    try:
        grid = zlib.decompressobj().decompress(data[start:], size + 1)
    except zlib.error as error:
        raise ValueError(f"its depth is damaged: {error}") from error
    if len(grid) != size:
        raise ValueError("its depth is damaged")
    depth = np.frombuffer(grid, "<u2").reshape(height, width).astype(np.float32) / _STEPS
    features = Features(
        grey=np.zeros((0, 0), np.uint8),
        samples=gridded_samples(np.where(depth > 0, depth, np.float32(np.nan)), K),
        pixels=np.zeros((count, 2)),
        points=points["xyz"] / float(_STEPS),
        descriptors=np.ascontiguousarray(points["descriptor"]),
    )
    return KeyView(features, pose)
