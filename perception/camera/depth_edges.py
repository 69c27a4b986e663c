"""Edges of depth against edges of colour: is depth registered, and of the same scene?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

WIDTH: Final = 320  # [px] of the images compared
STEP: Final = 0.05  # [m] and ...
STEP_SHARE: Final = 0.05  # ... share of depth by which the two sides of an edge differ
SCALES: Final = np.arange(0.84, 1.161, 0.04)
SHIFTS: Final = np.arange(-20, 20.1, 2.0)  # [px of WIDTH]
BLUR: Final = 1.5  # [px of WIDTH]
SAMPLES: Final = 1500  # of edge pixels a frame
MIN_PIXELS: Final = 500  # edge pixels over all frames, to conclude anything
ENOUGH: Final = 8000  # edge pixels, after which no more images are looked at
GAIN: Final = 1.2  # by which colour's gradient along the moved edges must be stronger
MIN_STRENGTH: Final = 1.7  # of colour's gradient along the moved edges; its mean is 1
NEAR: Final = 3  # [px of WIDTH] to surfaces that two images may both show
STRONG: Final = 4.0  # gradient from which an edge of colour counts no more
MIN_IMAGES: Final = 6  # with edges that others do not have, to conclude anything
BLANK: Final = 3.0  # standard deviation of the grey levels of an image that shows nothing
MIN_EDGES: Final = 20  # such pixels of an image
ONE_SCENE: Final = 1.4  # `colour_fit` below which colour and depth show different scenes

Image = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class EdgeOffset:
    """The shift that moves the edges of depth onto those of colour."""

    scale: float  # about the middle of the image
    right: float  # [px of an image 640 wide]
    down: float

    @property
    def pixels(self) -> float:
        """Mean distance over the image [px of an image 640 wide], about."""
        return float(np.hypot(self.right, self.down) + abs(self.scale - 1) * 0.38 * 2 * WIDTH)


def edge_offset(
    images: Sequence[tuple[NDArray[np.uint8], NDArray[np.float32]]],
) -> EdgeOffset | None:
    """Offset between depth's edges and colour's over `images`, of (H, W, 3) and (H, W) [m] each.

    The strength of colour's gradient along depth's edges is compared over scalings and shifts.
    No offset where the edges as they are do about as well, or none does well; None where there are
    too few.
    """
    total = np.zeros((len(SCALES), len(SHIFTS), len(SHIFTS)))
    count = 0
    for rgb, depth in images:
        points = _depth_edges(depth)
        count += len(points)
        if len(points):
            total += len(points) * _strength(_gradient(rgb), points)
        if count >= ENOUGH:
            break
    if count < MIN_PIXELS:
        return None
    middle = (len(SCALES) // 2, len(SHIFTS) // 2, len(SHIFTS) // 2)
    best = np.unravel_index(int(total.argmax()), total.shape)
    if total[best] < max(GAIN * total[middle], MIN_STRENGTH * count):
        return EdgeOffset(1.0, 0.0, 0.0)
    i, j, k = (int(n) for n in best)
    return EdgeOffset(float(SCALES[i]), 2 * float(SHIFTS[j]), 2 * float(SHIFTS[k]))


def colour_fit(
    images: Sequence[tuple[NDArray[np.uint8], NDArray[np.float32]]],
) -> float | None:
    """Strength of colour's edges along depth's, over that in the colour of other images.

    About 2 where colour and depth of `images`, (H, W, 3) and (H, W) [m] each, show one scene, and
    about 1 where they do not. Edges that the other image's depth has, too, are left out: they may
    move with the camera, and images without any contrast. None where there are too few edges, or
    the images differ in shape.
    """
    images = [(rgb, depth) for rgb, depth in images if _spread(rgb) > BLANK]
    points = [_depth_edges(depth).astype(np.intp) for _, depth in images]
    gradients = [np.minimum(_gradient(rgb), STRONG) for rgb, _ in images]
    nearest = [_nearest(depth) for _, depth in images]
    if len({gradient.shape for gradient in gradients}) != 1:
        return None
    ratios = []
    for i, own in enumerate(points):
        z = nearest[i][own[:, 1], own[:, 0]]
        logarithms = []
        for j, other in enumerate(gradients):
            with np.errstate(invalid="ignore"):
                apart = np.abs(nearest[j][own[:, 1], own[:, 0]] - z) > STEP * z
            across, down = own[apart].T
            if j != i and len(across) >= MIN_EDGES:
                here, there = gradients[i][down, across].mean(), other[down, across].mean()
                logarithms.append(np.log(max(here, 0.1) / max(there, 0.1)))
        if logarithms:
            ratios.append(np.mean(logarithms))
    return float(np.exp(np.mean(ratios))) if len(ratios) >= MIN_IMAGES else None


def _nearest(depth: NDArray[np.float32]) -> Image:
    """Nearest depth [m] within NEAR of each pixel; infinite where there is none."""
    small = cv2.resize(depth, _small(depth.shape), interpolation=cv2.INTER_NEAREST)
    known = np.where(np.isfinite(small), small, np.float32(np.inf)).astype(np.float32)
    size = 2 * NEAR + 1
    return np.asarray(cv2.erode(known, np.ones((size, size), np.uint8)), np.float32)


def _small(shape: tuple[int, ...]) -> tuple[int, int]:
    return WIDTH, max(1, round(shape[0] * WIDTH / shape[1]))


def _spread(rgb: NDArray[np.uint8]) -> float:
    """Standard deviation of the grey levels."""
    return float(cv2.meanStdDev(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY))[1].item())


def _gradient(rgb: NDArray[np.uint8]) -> Image:
    """Strength of the edges of colour, mean 1."""
    small = cv2.resize(rgb, _small(rgb.shape), interpolation=cv2.INTER_AREA)
    grey = np.asarray(cv2.cvtColor(small, cv2.COLOR_RGB2GRAY), np.float32)
    grey = np.asarray(cv2.GaussianBlur(grey, (0, 0), BLUR), np.float32)
    across = cv2.Sobel(grey, cv2.CV_32F, 1, 0)
    along = cv2.Sobel(grey, cv2.CV_32F, 0, 1)
    strength = np.minimum(cv2.magnitude(across, along), np.float32(200.0))
    return np.asarray(strength / max(float(strength.mean()), 1e-6), np.float32)


def _depth_edges(depth: NDArray[np.float32]) -> NDArray[np.float32]:
    """Pixels (n, 2), column and row, on the nearer side of depth edges."""
    small = cv2.resize(depth, _small(depth.shape), interpolation=cv2.INTER_NEAREST)
    edge = np.zeros(small.shape, bool)
    with np.errstate(invalid="ignore"):
        least = STEP + STEP_SHARE * small
        down, right = np.diff(small, axis=0), np.diff(small, axis=1)
        edge[:-1] |= down > least[:-1]
        edge[1:] |= -down > least[1:]
        edge[:, :-1] |= right > least[:, :-1]
        edge[:, 1:] |= -right > least[:, 1:]
    rows, columns = np.nonzero(edge)
    if len(rows) > SAMPLES:
        chosen = np.linspace(0, len(rows) - 1, SAMPLES).astype(int)
        rows, columns = rows[chosen], columns[chosen]
    return np.column_stack([columns, rows]).astype(np.float32)


def _strength(gradient: Image, points: NDArray[np.float32]) -> NDArray[np.float64]:
    """Mean gradient at the points, by scale and shift (cross-correlation by FFT).

    Points that leave the image count as 1, the mean.
    """
    height, width = gradient.shape
    pad = int(SHIFTS.max())
    field = np.ones((height + 2 * pad, width + 2 * pad))
    field[pad : pad + height, pad : pad + width] = gradient
    spectrum = np.fft.rfft2(field)
    middle = np.array([width / 2, height / 2], np.float32)
    shifts = SHIFTS.astype(int)
    found = np.empty((len(SCALES), len(SHIFTS), len(SHIFTS)))
    for i, scale in enumerate(SCALES):
        moved = np.rint(middle + np.float32(scale) * (points - middle)).astype(int) + pad
        size = (field.shape[1], field.shape[0])
        inside = ((moved >= 0) & (moved < size)).all(axis=1)
        mask = np.zeros(field.shape)
        np.add.at(mask, (moved[inside, 1], moved[inside, 0]), 1.0)
        sums = np.fft.irfft2(spectrum * np.conj(np.fft.rfft2(mask)), field.shape)
        found[i] = (sums[np.ix_(shifts, shifts)].T + (~inside).sum()) / len(points)
    return found
