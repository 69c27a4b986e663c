"""Frames, detections and scene scores, and the protocols of their sources.

Pixels are (column, row) with the origin at the centre of the top left pixel; the camera looks along
+z with x right and y down; `T_map_cam` takes camera coordinates to map coordinates.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import FrameError
from perception.no_return import without_constants

Names = Sequence[str] | Mapping[int, str]  # of classes, by their numbers
_MAX_SCORE: Final = 1.0001  # by rounding
_MAX_MASK: Final = 1 << 26  # pixels


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
    camera: str = ""  # its name, where several cameras give the frames of one stream

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

    @property
    def blank(self) -> bool:
        """Whether it shows nothing, in colour and in depth, as where its image cannot be read."""
        return not self.rgb.any() and not np.isfinite(self.depth).any()


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

    @classmethod
    def from_supervision(cls, found: Any, names: Names | None = None) -> Detections:
        """Of a `supervision.Detections`, with its masks.

        Names of classes are those of its data (`class_name`), or `names` by their numbers. Raises
        FrameError, a ValueError, where names, scores or sizes do not fit.
        """
        given = found.data.get("class_name") if names is None else None
        labels = _names(found.class_id, names) if given is None else tuple(map(str, given))
        return _converted(found.xyxy, found.confidence, labels, found.mask)

    @classmethod
    def from_ultralytics(cls, found: Any) -> Detections:
        """Of the `Results` of one image from Ultralytics' models, with the masks of its outlines.

        Raises FrameError where names or sizes do not fit.
        """
        boxes, masks = found.boxes, None
        if boxes is None:
            raise FrameError("the results have no boxes; those of a detector would work")
        if found.masks is not None:
            masks = [_filled([outline], found.orig_shape) for outline in found.masks.xy]
        labels = _names(_array(boxes.cls), found.names)
        return _converted(_array(boxes.xyxy), _array(boxes.conf), labels, masks)

    @classmethod
    def from_coco(cls, found: Sequence[Mapping[str, Any]], names: Names) -> Detections:
        """Of one image's entries of COCO's results: `bbox` (x, y, width, height) [px], `score`,
        `category_id`, and perhaps `segmentation`, in runs or polygons.

        `names` are those of the categories, by their numbers. Raises FrameError for others.
        """
        try:
            boxes = np.array([one["bbox"] for one in found], np.float32).reshape(-1, 4)
            score = [float(one["score"]) for one in found]
            labels = _names([one["category_id"] for one in found], names)
            shown = [
                _segment(one.get("segmentation"), box)
                for one, box in zip(found, boxes, strict=True)
            ]
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise FrameError(
                f"an entry of COCO's results has bbox, score and category_id, and a segmentation "
                f"in whole numbers; got {found[0] if found else found!r:.80} ({error})"
            ) from error
        boxes[:, 2:] += boxes[:, :2]
        masks = shown if any(one is not None for one in shown) else None
        return _converted(boxes, score, labels, masks)

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


def _names(numbers: Any, names: Names | None) -> tuple[str, ...]:
    """Names of classes by their numbers; raises FrameError for numbers without one."""
    if numbers is not None and not len(numbers):
        return ()
    if names is None or numbers is None:
        raise FrameError("the classes have no names; names=('cup', 'chair', ...) would work")
    known = names if isinstance(names, Mapping) else dict(enumerate(names))
    found = [int(number) for number in numbers]
    if missing := sorted({number for number in found if number not in known}):
        raise FrameError(f"classes {missing[:5]} have no name; there are {len(known)} names")
    return tuple(str(known[number]) for number in found)


def _array(values: Any) -> NDArray[Any]:
    """An array of a tensor, on whichever device."""
    return np.asarray(values.cpu() if hasattr(values, "cpu") else values)


def _converted(
    xyxy: Any, score: Any, labels: tuple[str, ...], masks: Sequence[Any] | None
) -> Detections:
    """Detections best first, of boxes, scores, and masks (H, W) of the whole image."""
    if score is None:
        raise FrameError("the detections have no scores; those of a detector have some")
    found = Detections(
        np.array(xyxy, np.float32).reshape(-1, 4), np.array(score, np.float32), labels
    )
    if masks is not None and len(masks):
        if len(masks) != len(found):
            raise FrameError(f"masks must be ({len(found)}, H, W), got {len(masks)} of them")
        cut = tuple(_inside(mask, box) for mask, box in zip(masks, found.xyxy, strict=True))
        found = replace(found, mask=cut)
    return found.chosen(np.argsort(-found.score, kind="stable"))


def _inside(mask: Any, box: NDArray[np.float32]) -> NDArray[np.bool_] | None:
    """The part of a mask (H, W) in its box; None without a pixel of it there."""
    if mask is None:
        return None
    whole = np.asarray(mask, np.bool_)
    if whole.ndim != 2:
        raise FrameError(f"a mask must be (H, W) as the image, got {whole.shape}")
    at = box_pixels(box, (whole.shape[0], whole.shape[1]))
    part = whole[:0] if at is None else whole[at[0] : at[1], at[2] : at[3]]
    return part if part.any() else None


def _filled(outlines: Sequence[Any], shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Mask (H, W) of the polygons (k, 2) x, y [px]."""
    import cv2  # as late as possible: what needs no masks starts faster

    mask = np.zeros(shape, np.uint8)
    corners = [np.round(np.reshape(one, (-1, 2))).astype(np.int32) for one in outlines]
    cv2.fillPoly(mask, [one for one in corners if len(one)], 1)
    return mask.astype(np.bool_)


def _segment(found: Any, box: NDArray[np.float32]) -> NDArray[np.bool_] | None:
    """Mask of COCO's runs (by columns), or of polygons, up to the end of its box x, y, w, h."""
    if not isinstance(found, Mapping):
        end = np.ceil(box[:2] + box[2:]).astype(np.int64) + 1
        if not 0 < end.prod() <= _MAX_MASK:
            raise ValueError(f"a box of {box.tolist()} px has no mask")
        return _filled(found, (int(end[1]), int(end[0]))) if found else None
    height, width = found["size"]
    return mask_of_runs(_lengths(found["counts"]), (width, height)).T


def mask_of_runs(lengths: Sequence[int], shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Mask of `shape` by lengths of runs of pixels outside and inside by turns, outside first.

    Raises ValueError where they do not fill it.
    """
    height, width = map(operator.index, shape)  # whole numbers
    runs = np.array(lengths, np.int64)
    if min(height, width) < 1 or height * width > _MAX_MASK or (runs < 0).any():
        raise ValueError("a mask needs a size [h, w] and lengths of runs")
    if runs.max(initial=0) > _MAX_MASK or int(runs.sum()) != height * width:
        raise ValueError(f"runs of a mask of {height} x {width} need that many pixels in all")
    return np.repeat(np.arange(len(runs)) % 2 == 1, runs).reshape(height, width)


def _lengths(counts: Any) -> Sequence[int]:
    """Lengths of COCO's runs: as numbers, or in its text of five bits a character.

    The sixth bit says that more follow; from the fourth number on each is a difference to the last
    but one.
    """
    if not isinstance(counts, str | bytes):
        return list(counts)
    lengths, value, shift = list[int](), 0, 0
    for code in counts.encode() if isinstance(counts, str) else counts:
        bits = code - 48
        value |= (bits & 0x1F) << shift
        shift += 5
        if bits & 0x20:
            continue
        value -= (bits & 0x10 and 1) << shift
        lengths.append(value + (lengths[-2] if len(lengths) > 2 else 0))
        value = shift = 0
    return lengths


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


NO_DETECTIONS: Final = Detections(np.zeros((0, 4), np.float32), np.zeros(0, np.float32), ())
