"""Features of an RGB-D image: corners with depth that move with the scene, and their matches.

ORB corners (Rublee et al., ICCV 2011) cost a tenth of SIFT's (Lowe, IJCV 60, 2004), which match
between views that are farther apart. SIFT's descriptors are compared by the square roots of their
parts (Arandjelovic and Zisserman, CVPR 2012).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.camera.depth_agreement import DepthSamples, depth_samples
from perception.frames import Frame

Floats = NDArray[np.float64]

MAX_FEATURES: Final = 1000
MAX_RANGE: Final = 8.0  # [m] of depth that is used
MIN_RANGE: Final = 0.1  # [m]
CELLS: Final = (12, 9)  # parts of the image, across and down, that corners are spread over
ORB_BYTES: Final = 32  # of a descriptor
MAX_HAMMING: Final = 64  # bits of 256 that differ between the descriptors of one corner
RATIO: Final = 0.85  # of the distances of the best and the second-best match
_EDGE: Final = 0.05  # relative change of depth around a corner that lies on an edge
_MIN_AROUND: Final = 6  # of 9 pixels around a corner that have depth
_CORNERS: Final = 12  # grey levels by which a corner differs from its surroundings
_CONTRAST: Final = 0.015  # of a corner of SIFT


@dataclass(frozen=True, slots=True, eq=False)
class Image:
    """A grey image with depth."""

    grey: NDArray[np.uint8]  # (H, W)
    depth: NDArray[np.float32]  # (H, W) [m], nan = no return
    K: Floats  # (3, 3)
    samples: DepthSamples
    still: NDArray[np.bool_] | None = None  # (H, W) what moves with the camera; it has no depth

    @classmethod
    def of(cls, frame: Frame, still: NDArray[np.bool_] | None = None) -> Image:
        """The image of a frame without its `still` parts; its pose is not read."""
        # brightness and contrast alike, whatever the exposure
        grey = np.asarray(cv2.equalizeHist(cv2.cvtColor(frame.rgb, cv2.COLOR_RGB2GRAY)), np.uint8)
        depth = frame.depth
        if still is not None:
            depth = np.where(still, np.float32(np.nan), depth)
        return cls(grey, depth, frame.K, depth_samples(depth, frame.K), still)


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """An image's corners that have depth, and what is compared with other images.

    The first ones are the strongest of all parts of the image, then come the second strongest.
    """

    grey: NDArray[np.uint8]  # (H, W)
    samples: DepthSamples
    pixels: Floats  # (n, 2) [px]
    points: Floats  # (n, 3) [m] camera frame
    descriptors: NDArray[np.uint8]  # (n, 32) of ORB, or (n, 128) of SIFT

    def __len__(self) -> int:
        return len(self.pixels)

    @classmethod
    def none(cls) -> Features:
        """No features, and no image."""
        grid = np.zeros((0, 0), np.float32)
        samples = DepthSamples(grid, np.eye(3), np.zeros((0, 3), np.float32))
        pixels, points = np.zeros((0, 2)), np.zeros((0, 3))
        return cls(
            grid.astype(np.uint8), samples, pixels, points, np.zeros((0, ORB_BYTES), np.uint8)
        )


class FeatureDetector:
    """ORB corners spread over the image, at the pyramid's best level."""

    def __init__(self) -> None:
        self._orb = cv2.ORB.create(MAX_FEATURES, 1.2, 8, fastThreshold=_CORNERS)
        self._last: tuple[Image, Features] | None = None

    def features(self, image: Image) -> Features:
        """Features of an image; those of the last one are kept."""
        if self._last is None or self._last[0] is not image:
            corners, descriptors = self._orb.detectAndCompute(image.grey, None)
            self._last = image, _with_depth(image, corners, np.asarray(descriptors))
        return self._last[1]


class ScaleFeatureDetector:
    """SIFT corners spread over the image."""

    def __init__(self) -> None:
        self._sift = cv2.SIFT.create(MAX_FEATURES, contrastThreshold=_CONTRAST)

    def features(self, image: Image) -> Features:
        """Features of an image."""
        corners, descriptors = self._sift.detectAndCompute(image.grey, None)
        if not corners:
            return _with_depth(image, corners, np.zeros((0, 128)))
        whole = np.maximum(np.asarray(descriptors).sum(axis=1, keepdims=True), 1.0)
        return _with_depth(image, corners, np.rint(255 * np.sqrt(descriptors / whole)))


def _with_depth(
    image: Image, corners: Sequence[cv2.KeyPoint], descriptors: NDArray[np.generic]
) -> Features:
    """Features of the corners that have depth."""
    if not corners:
        none = Features.none()
        return replace(none, grey=image.grey, samples=image.samples)
    pixels = np.array([corner.pt for corner in corners])
    strength = np.array([corner.response for corner in corners])
    z = depth_at(image.depth, pixels)
    good = np.flatnonzero(np.isfinite(z))
    good = good[_spread(pixels[good], strength[good], image.grey.shape)]
    pixels, K = pixels[good], image.K
    rays = np.column_stack([(pixels - K[:2, 2]) / K[[0, 1], [0, 1]], np.ones(len(good))])
    return Features(
        image.grey, image.samples, pixels, rays * z[good, None],
        np.asarray(descriptors, np.uint8)[good],
    )  # fmt: skip


def _spread(pixels: Floats, strength: Floats, shape: tuple[int, ...]) -> NDArray[np.intp]:
    """Order of corners: the strongest of each cell of the image, the second strongest, ..."""
    column, row = (pixels * CELLS / (shape[1], shape[0])).astype(int).T
    cell = row * CELLS[0] + column
    by_cell = np.lexsort((-strength, cell))
    starts = np.searchsorted(cell[by_cell], cell[by_cell])
    rank = np.arange(len(cell)) - starts
    return by_cell[np.lexsort((-strength[by_cell], rank))]


def depth_at(depth: NDArray[np.float32], pixels: Floats) -> Floats:
    """Median depth [m] of 3 x 3 pixels around each corner; nan without depth or on an edge."""
    height, width = depth.shape
    column = np.clip(np.rint(pixels[:, 0]).astype(int), 1, width - 2)
    row = np.clip(np.rint(pixels[:, 1]).astype(int), 1, height - 2)
    around = np.stack([depth[row + i, column + j] for i in (-1, 0, 1) for j in (-1, 0, 1)], axis=1)
    sorted_ = np.sort(around, axis=1)  # nan last
    count = np.isfinite(around).sum(axis=1)
    rows = np.arange(len(around))
    middle = sorted_[rows, np.maximum(count - 1, 0) // 2].astype(np.float64)
    spread = sorted_[rows, np.maximum(count - 1, 0)] - sorted_[:, 0]
    with np.errstate(invalid="ignore"):
        good = (count >= _MIN_AROUND) & (spread < _EDGE * middle + 0.02)
        good &= (middle > MIN_RANGE) & (middle < MAX_RANGE)
    return np.where(good, middle, np.nan)


def matched(first: Features, second: Features) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Indices of the features of both that look alike, each of both once."""
    none = np.zeros(0, np.intp)
    if len(first) < 2 or len(second) < 2:
        return none, none
    table = np.array(
        [
            (a.trainIdx, a.queryIdx, a.distance, b.distance)
            for a, b in _nearest_two(second.descriptors, first.descriptors)
        ]
    ).reshape(-1, 4)
    table = table[table[:, 2] < RATIO * table[:, 3]]
    table = table[np.argsort(table[:, 2], kind="stable")]
    table = table[np.unique(table[:, 0], return_index=True)[1]]
    return table[:, 0].astype(np.intp), table[:, 1].astype(np.intp)


def _nearest_two(
    asked: NDArray[np.uint8], stored: NDArray[np.uint8]
) -> Iterable[tuple[cv2.DMatch, cv2.DMatch]]:
    """The two nearest stored descriptors of each one that may have a match."""
    if asked.shape[1] != ORB_BYTES:
        floats = asked.astype(np.float32), stored.astype(np.float32)
        return [(a, b) for a, b in cv2.BFMatcher(cv2.NORM_L2).knnMatch(*floats, k=2)]
    found = cv2.BFMatcher(cv2.NORM_HAMMING).knnMatch(asked, stored, k=2)
    return [(a, b) for a, b in found if a.distance <= MAX_HAMMING]


MAX_SIDE: Final = 1280  # [px]


def shrunk(frame: Frame) -> Frame:
    """The frame with images of MAX_SIDE at most: means of colour, depth of the middle pixels."""
    factor = -(-max(frame.depth.shape) // MAX_SIDE)
    if factor == 1:
        return frame
    height, width = (size // factor for size in frame.depth.shape)
    rgb = cv2.resize(
        frame.rgb[: height * factor, : width * factor],
        (width, height),
        interpolation=cv2.INTER_AREA,
    )
    middle = slice(factor // 2, None, factor)
    K = frame.K.copy()
    K[:2] /= factor
    K[:2, 2] += 0.5 / factor - 0.5  # pixel (0, 0) is the centre of the first
    depth = np.ascontiguousarray(frame.depth[middle, middle][:height, :width])
    return replace(frame, rgb=np.asarray(rgb, np.uint8), depth=depth, K=K)


SIZE: Final = (64, 48)  # pixels that are compared, across and down
SAME: Final = (0.005, 0.02)  # [m], and share of the depth, that sensors are off by
MIN_CHANGED: Final = 0.5  # share of the pixels with depth that has changed, before any is still
MIN_STILL: Final = 0.1  # share of the image
AFTER: Final = 3  # times as many images as it took most of the image to change


@dataclass(slots=True)
class StillParts:
    """Which pixels have kept their depth since the first image."""

    _first: NDArray[np.float32] | None = None
    _changed: NDArray[np.bool_] | None = None
    _images: int = 0
    _half: int | None = None  # images after which most of the depth had changed

    def add(self, depth: NDArray[np.float32]) -> None:
        """Compare the depth of another image."""
        now = np.asarray(cv2.resize(depth, SIZE, interpolation=cv2.INTER_NEAREST), np.float32)
        self._images += 1
        if self._first is None or self._changed is None:
            self._first, self._changed = now, ~np.isfinite(now)
            return
        with np.errstate(invalid="ignore"):
            self._changed |= np.abs(now - self._first) > SAME[0] + SAME[1] * self._first
        if self._half is None:
            known = np.isfinite(self._first).sum()
            if (~self._changed).sum() <= (1 - MIN_CHANGED) * known:
                self._half = self._images

    def found(self, shape: tuple[int, int]) -> NDArray[np.bool_] | None:
        """The still pixels (H, W) of images of that shape; None where there are none."""
        if self._changed is None or self._half is None or self._images < AFTER * self._half:
            return None
        still = ~self._changed
        if still.mean() < MIN_STILL:
            return None
        shown = cv2.resize(still.astype(np.uint8), shape[::-1], interpolation=cv2.INTER_NEAREST)
        return np.asarray(cv2.dilate(shown, np.ones((15, 15), np.uint8)), np.uint8) > 0


THUMBNAIL: Final = (40, 30)  # [px] of the images by which a change of the view is noticed
MOVED: Final = 3.0  # mean difference of grey levels where the view changes
MOVED_DEPTH: Final = 0.03  # the same of depth, relative; ...
MOVED_SHARE: Final = 90  # ... percentile, since a turn moves little but edges

_View = tuple[NDArray[np.float32], NDArray[np.float32]]  # grey levels and depth, of THUMBNAIL


@dataclass(slots=True)
class FrozenImages:
    """Notices frames whose colour and depth are of two moments."""

    count: int = 0  # of such frames
    _held: dict[str, tuple[NDArray[Any], _View]] = field(default_factory=dict)

    def add(self, frame: Frame) -> bool:
        """Whether an image of the next frame is a copy of the last, and the other moves on."""
        view, frozen = _view(frame), False
        for name, image, other in (("depth", frame.depth, 0), ("rgb", frame.rgb, 1)):
            held = self._held.get(name)
            nan = image.dtype == np.float32
            if held is None or not np.array_equal(held[0], image, equal_nan=nan):
                self._held[name] = image, view  # the image, and the view where it began
            else:
                frozen |= _moved(held[1], view, other)
        self.count += frozen
        return frozen


def _view(frame: Frame) -> _View:
    grey = cv2.resize(
        cv2.cvtColor(frame.rgb, cv2.COLOR_RGB2GRAY), THUMBNAIL, interpolation=cv2.INTER_AREA
    )
    depth = cv2.resize(frame.depth, THUMBNAIL, interpolation=cv2.INTER_NEAREST)
    return np.asarray(grey, np.float32), np.asarray(depth, np.float32)


def _moved(before: _View, now: _View, image: int) -> bool:
    """Whether grey levels (0) or depth (1) changed as in another view."""
    change = np.abs(now[image] - before[image])
    if image == 0:
        return bool(change.mean() > MOVED)
    known = np.isfinite(change)
    relative = change[known] / before[1][known]
    return bool(known.any() and np.percentile(relative, MOVED_SHARE) > MOVED_DEPTH)
