"""Frames, detections and scene scores, and the protocols of their sources.

Pixels are (column, row) with the origin at the centre of the top left pixel; the camera looks along
+z with x right and y down; `T_map_cam` takes camera coordinates to map coordinates.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import FrameError
from perception.no_return import without_constants

_MAX_SCORE: Final = 1.0001  # by rounding


@dataclass(frozen=True, slots=True)
class Frame:
    """RGB-D image, registered, with its pose.

    Depth becomes nan where many pixels share a value that no surface has, as the far plane of a
    simulator (`perception.no_return`); the array that was given stays as it is. Raises FrameError,
    a ValueError, where shapes or types are not the ones below. The values are checked where frames
    are mapped (`mapping.frames.frame_checks`).
    """

    id: str
    rgb: NDArray[np.uint8]  # (H, W, 3)
    depth: NDArray[np.float32]  # (H, W) [m] along the optical axis, nan = no return
    K: NDArray[np.float64]  # (3, 3) pinhole intrinsics [px], distortion already undone
    T_map_cam: NDArray[np.float64]  # (4, 4) camera -> map
    stamp: float  # [s] since 1970-01-01 UTC

    def __post_init__(self) -> None:
        _check_arrays(rgb=self.rgb, depth=self.depth, K=self.K, T_map_cam=self.T_map_cam)
        if self.depth.ndim != 2:
            raise FrameError(f"depth must be (H, W), got {self.depth.shape}")
        shape = (*self.depth.shape, 3)
        if self.rgb.shape != shape or self.rgb.dtype != np.uint8:
            raise FrameError(f"rgb must be uint8 {shape}, got {self.rgb.dtype} {self.rgb.shape}")
        if self.K.shape != (3, 3) or self.T_map_cam.shape != (4, 4):
            raise FrameError(
                f"K must be (3, 3) and T_map_cam (4, 4), got {self.K.shape}, {self.T_map_cam.shape}"
            )
        if self.depth.dtype.kind == "f":
            object.__setattr__(self, "depth", without_constants(self.depth, self.K))


@dataclass(frozen=True, slots=True)
class Detections:
    """Detections of one image: parallel arrays of length n, best score first.

    Raises FrameError, a ValueError, where shapes or types are not the ones below, where a box is
    no x1, y1, x2, y2 in pixels, and for a score above 1. Whether the boxes lie in the image is
    checked where they are mapped (`mapping.frames.frame_checks`).
    """

    xyxy: NDArray[np.float32]  # (n, 4) [px] in the frame's own pixels
    score: NDArray[np.float32]  # (n,) 0..1
    label: tuple[str, ...]  # (n,) the network's own label
    source: tuple[str, ...] = ()  # (n,) name of each one's detector; (): there is only one
    detectors: tuple[str, ...] = ()  # names of all that ran on the image; (): there is only one
    # (n,) the thing's pixels in its box, (h, w) as `box_pixels` counts; None: no mask; (): of none
    mask: tuple[NDArray[np.bool_] | None, ...] = ()

    def __post_init__(self) -> None:
        _check_arrays(xyxy=self.xyxy, score=self.score)
        if isinstance(self.label, str) or not all(isinstance(one, str) for one in self.label):
            raise FrameError(
                f"label must be texts, one a box, as in ('cup', 'chair'); got {self.label!r:.80}"
            )
        n = len(self.label)
        if self.mask and len(self.mask) != n:
            raise FrameError(f"mask must be ({n},), got ({len(self.mask)},)")
        if self.source and len(self.source) != n:
            raise FrameError(f"source must be ({n},), got ({len(self.source)},)")
        if self.xyxy.shape != (n, 4) or self.score.shape != (n,):
            raise FrameError(
                f"xyxy must be ({n}, 4) and score ({n},) as there are {n} labels, "
                f"got {self.xyxy.shape}, {self.score.shape}"
            )
        if n:
            _check_boxes(self.xyxy, self.label)
            _check_scores(self.score, self.label)

    def __len__(self) -> int:
        return len(self.label)

    def chosen(self, indices: NDArray[np.integer]) -> Detections:
        """Detections at `indices`, in that order."""
        at = [int(index) for index in indices]
        return Detections(
            self.xyxy[at],
            self.score[at],
            tuple(self.label[i] for i in at),
            tuple(self.source[i] for i in at) if self.source else (),
            self.detectors,
            tuple(self.mask[i] for i in at) if self.mask else (),
        )


def _check_arrays(**arrays: object) -> None:
    for name, given in arrays.items():
        if not isinstance(given, np.ndarray):
            raise FrameError(
                f"{name} must be a numpy array, got {type(given).__name__}; "
                f"np.asarray({name}) would work"
            )


def _check_boxes(xyxy: NDArray[np.floating], label: Sequence[str]) -> None:
    """Raise FrameError for corners in another order, and where all are shares of an image."""
    wrong = (xyxy[:, 2] < xyxy[:, 0]) | (xyxy[:, 3] < xyxy[:, 1])  # nan compares false
    if wrong.any():
        n = int(np.argmax(wrong))
        raise FrameError(
            f"box {n} ({label[n]}) must be x1, y1, x2, y2 [px] with x1 <= x2 and y1 <= y2, got "
            f"{xyxy[n].tolist()}; np.hstack([b[:, :2], b[:, :2] + b[:, 2:]]) would work for boxes "
            "b of x, y, width, height"
        )
    if xyxy.min() >= 0 and xyxy.max() <= 1 and (xyxy[:, 2:] > xyxy[:, :2]).all():
        raise FrameError(
            f"boxes must be in pixels, and all are within 0..1, as in {xyxy[0].tolist()} "
            f"({label[0]}); xyxy * (width, height, width, height) of the image would work for "
            "shares of it"
        )


def _check_scores(score: NDArray[np.floating], label: Sequence[str]) -> None:
    """Raise FrameError for scores that are no probabilities."""
    wrong = (score > _MAX_SCORE) | (score < 0)
    if wrong.any():
        n = int(np.argmax(wrong))
        conversion = (
            "score / 100 would work for percent"
            if (score >= 0).all()
            else ("1 / (1 + np.exp(-score)) would work for logits")
        )
        raise FrameError(
            f"score {n} ({label[n]}) must be within 0..1, got {score[n]:g}; {conversion}"
        )


def box_pixels(
    box: NDArray[np.floating], shape: tuple[int, int]
) -> tuple[int, int, int, int] | None:
    """Pixel range of a box: first and one past the last row and column with centres in it, or None.

    `box` is xyxy [px], `shape` (height, width); the result is (top, bottom, left, right).
    """
    x1, y1, x2, y2 = (float(v) for v in box)
    if not all(math.isfinite(v) for v in (x1, y1, x2, y2)):
        return None
    left, right = math.ceil(max(x1, 0)), math.floor(min(x2, shape[1] - 1)) + 1
    top, bottom = math.ceil(max(y1, 0)), math.floor(min(y2, shape[0] - 1)) + 1
    return (top, bottom, left, right) if left < right and top < bottom else None


@dataclass(frozen=True, slots=True)
class SceneScores:
    """Scene classification of an image: the network's own label -> probability."""

    probability: Mapping[str, float]


@runtime_checkable
class Detector(Protocol):
    """Object detector."""

    @property
    def name(self) -> str:
        """Short name, as kept with each observation."""

    def detect(self, frame: Frame) -> Detections:
        """All objects of `frame` with a score above the detector's threshold."""


class SceneClassifier(Protocol):
    """Scene classifier: what kind of place a frame shows."""

    @property
    def name(self) -> str:
        """Short name, as kept with each belief."""

    def classify(self, frame: Frame) -> SceneScores:
        """Probability of each scene category for `frame`."""


class Recording(Protocol):
    """A sequence of frames that can be read again from any index."""

    @property
    def name(self) -> str:
        """Name that identifies the recording within a map."""

    @property
    def T_map_world(self) -> NDArray[np.float64]:  # noqa: N802 - names its frames
        """(4, 4) takes the recording's own world frame to the map frame."""

    def __len__(self) -> int: ...

    def frames(self, start: int = 0) -> Iterator[Frame]:
        """Frames from index `start` on; raises RecordingError at the first unreadable one."""
