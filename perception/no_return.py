"""Depth values that mean no return: far planes of simulators and constants of drivers.

Programs write a constant where nothing was measured: the far plane of a renderer (8, 10 or 1000 m
for sky), the largest number of a type, or a little more than zero. Many pixels of an image share
it, few have a depth near it, and none shares it with a surface that a camera measures. It is the
depth along the optical axis, or the length of the ray.

Beyond the distances that objects are mapped from, one image is enough to tell. Between them such a
value may be a wall straight ahead, as a simulator without noise shows it; it is no return where it
stays the same while the camera moves.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

NEAREST: Final = 0.25  # [m] surfaces that objects are mapped from lie farther ...
FARTHEST: Final = 5.05  # [m] ... and nearer than this
LARGEST: Final = 50.0  # [m] depth of a room
ACROSS: Final = 160  # samples across an image, about
MIN_PIXELS: Final = 4800  # of an image; the values of fewer tell nothing
SAME: Final = 1e-3  # share of a value by which equal ones differ, by rounding
AROUND: Final = 30  # such steps to both sides, where few other depths are ...
FEW: Final = 0.25  # ... at most this share of the pixels of the value
SHARE: Final = 0.005  # of all pixels, from which a value counts
LARGE_SHARE: Final = 0.02  # the same, of a value that may be a surface's
FRAMES: Final = 3  # that show the same value while the camera moves
AHEAD: Final = 0.1  # [m] of that motion along the optical axis, or ...
MAX_TOLD: Final = 4  # values in a line
MAX_SEEN: Final = 100  # values that are followed
TURNED: Final = np.cos(np.radians(5.0))  # ... cosine of the turn of that axis
_LOW: Final = 1e-3  # [m] that logarithms begin at
_HIGH: Final = 1e6  # [m] that they end at: larger values are one


class Constant(NamedTuple):
    """A depth that many pixels share."""

    value: float  # [m]
    along_ray: bool  # whether it is the length of the ray, not the depth along the optical axis
    share: float  # of the image's pixels

    @property
    def measurable(self) -> bool:
        """Whether a surface that objects are mapped from may have this depth."""
        return NEAREST <= self.value <= FARTHEST


def without_constants(
    depth: NDArray[np.float32], K: NDArray[np.float64], known: Iterable[Constant] = ()
) -> NDArray[np.float32]:
    """`depth` (H, W) [m] with nan at the pixels of constants; the same array where it has none.

    Those are the `known` ones, and the ones of the image itself that no surface has.
    """
    told = [*known, *(c for c in shared_values(depth, K) if not c.measurable)]
    if not told:
        return depth
    kept = depth.copy()
    for one in told:
        distance = kept * ray_lengths(depth.shape, _numbers(K)) if one.along_ray else kept
        with np.errstate(invalid="ignore", over="ignore"):
            kept[np.abs(distance / np.float32(one.value) - 1) <= 1.5 * SAME] = np.nan
            if one.value >= _HIGH:
                kept[distance >= _HIGH] = np.nan
            if one.value <= _LOW:
                kept[distance <= _LOW] = np.nan
    return kept


def shared_values(depth: NDArray[np.float32], K: NDArray[np.float64]) -> list[Constant]:
    """Values of an image (H, W) [m] that many pixels have and few are near to."""
    if depth.size < MIN_PIXELS:
        return []
    step = max(1, depth.shape[1] // ACROSS)
    z = depth[step // 2 :: step, step // 2 :: step]
    found = _peaks(z, along_ray=False)
    if not found and np.isfinite(K).all() and min(K[0, 0], K[1, 1]) > 0:
        rays = ray_lengths(depth.shape, _numbers(K))[step // 2 :: step, step // 2 :: step]
        found = _peaks(z * rays, along_ray=True)
    return found


class UnmovedValues:
    """Constants that surfaces might have, but which stay the same while the camera moves."""

    def __init__(self) -> None:
        self._seen: list[tuple[Constant, list[NDArray[np.float64]]]] = []

    def add(
        self, depth: NDArray[np.float32], K: NDArray[np.float64], T: NDArray[np.float64]
    ) -> list[Constant]:
        """The shared values of depth (H, W) [m]; its camera (3, 3) is at a pose (4, 4).

        The poses are in any fixed frame.
        """
        shared = shared_values(depth, K)
        for one in shared:
            if one.measurable and one.share >= LARGE_SHARE:
                poses = next((poses for other, poses in self._seen if _equal(one, other)), None)
                if poses is None and len(self._seen) < MAX_SEEN:
                    self._seen.append((one, poses := []))
                if poses is not None and all(_moved(pose, T) for pose in poses):
                    poses.append(T)
        return shared

    @property
    def found(self) -> tuple[Constant, ...]:
        """Those of at least FRAMES views."""
        return tuple(one for one, poses in self._seen if len(poses) >= FRAMES)


def _equal(a: Constant, b: Constant) -> bool:
    return a.along_ray == b.along_ray and abs(a.value / b.value - 1) <= SAME


def _moved(a: NDArray[np.float64], b: NDArray[np.float64]) -> bool:
    """Whether a surface straight ahead cannot have the same depth from both poses (4, 4)."""
    ahead = a[:3, 2]
    return bool(abs(ahead @ (b[:3, 3] - a[:3, 3])) >= AHEAD or ahead @ b[:3, 2] < TURNED)


def _peaks(distance: NDArray[np.float32], *, along_ray: bool) -> list[Constant]:
    with np.errstate(invalid="ignore", over="ignore"):
        known = distance[(distance > 0) & (distance < np.inf)]
    if not len(known) or known.min() == known.max() > LARGEST:
        return []  # a wall in millimetres, which is refused elsewhere
    clipped = np.clip(known, _LOW, _HIGH)
    steps = (np.log(clipped / np.float32(_LOW)) / SAME).astype(np.intp)
    first = int(steps.min())
    counts = np.bincount(steps - first)
    pairs = counts + np.append(counts[1:], 0)  # a value may lie at the border of two
    total = np.concatenate([[0], np.cumsum(counts)])
    found: list[Constant] = []
    many = np.flatnonzero(pairs >= max(SHARE * distance.size, 2))
    low, high = np.maximum(many - AROUND, 0), np.minimum(many + 2 + AROUND, len(counts))
    near = total[high] - total[low] - pairs[many]
    for at in many[near <= FEW * pairs[many]].tolist():
        here = int(pairs[at])
        if here < max(int(p) for p in pairs[max(at - 1, 0) : at + 2]):
            continue
        if found and found[-1].value * (1 + 3 * SAME) > _LOW * np.exp((first + at) * SAME):
            continue  # the same value, as a pair with the bin before
        value = float(np.median(clipped[(steps - first == at) | (steps - first == at + 1)]))
        found.append(Constant(value, along_ray, here / distance.size))
    return found


def _numbers(K: NDArray[np.float64]) -> tuple[float, float, float, float]:
    return float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])


@lru_cache(maxsize=4)
def ray_lengths(
    shape: tuple[int, int], camera: tuple[float, float, float, float]
) -> NDArray[np.float32]:
    """Lengths (H, W) of the rays of an image's pixels to depth 1; `camera` is fx, fy, cx, cy."""
    fx, fy, cx, cy = camera
    v, u = np.mgrid[: shape[0], : shape[1]]
    lengths: NDArray[np.float32] = np.sqrt(1 + ((u - cx) / fx) ** 2 + ((v - cy) / fy) ** 2).astype(
        np.float32
    )
    return lengths


def told(constants: Iterable[Constant]) -> str:
    """Constants for a message; "" without any."""
    texts = []
    for one in constants:
        over, along = "over " * (one.value >= _HIGH), " along the ray" * one.along_ray
        texts.append(f"{over}{one.value:.4g} m{along} ({100 * one.share:.0f} % of pixels)")
    return ", ".join(texts[:MAX_TOLD]) + " and others" * (len(texts) > MAX_TOLD)
