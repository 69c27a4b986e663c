"""Average precision and recall of boxes, as COCO counts them (https://cocodataset.org/#detection-eval).

Detections of a class in an image, at most 100, take true boxes in the order of their scores, each
the one it overlaps most, at ten thresholds of IoU from 0.5 to 0.95. Precision is interpolated at
101 levels of recall. Crowds, and things outside a range of sizes, count neither way. The numbers
are those of pycocotools.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from lab.networks.coco_dataset import TrueBoxes

OVERLAPS: Final = np.linspace(0.5, 0.95, 10)  # IoU
RECALLS: Final = np.linspace(0.0, 1.0, 101)
MAX_DETECTIONS: Final = 100  # detections of a class in an image that count
#: [px^2] areas of things: all of them, and COCO's small, medium and large ones
AREAS: Final = {
    "all": (0.0, 1e10),
    "small": (0.0, 32.0**2),
    "medium": (32.0**2, 96.0**2),
    "large": (96.0**2, 1e10),
}

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class ClassPrecision:
    """Scores of one class; None: it has no true box."""

    name: str
    true: int  # boxes that count
    ap: float | None
    ap50: float | None
    ap75: float | None
    ar: float | None


@dataclass(frozen=True, slots=True)
class DetectionScores:
    """Scores of a detector: means over the classes that have true boxes."""

    images: int
    true: int
    ap: float | None  # over IoU 0.5 to 0.95
    ap50: float | None
    ap75: float | None
    ap_small: float | None
    ap_medium: float | None
    ap_large: float | None
    ar: float | None  # recall with at most 100 detections a class
    classes: tuple[ClassPrecision, ...]

    def to_json(self) -> dict[str, Any]:
        """Plain values, for `--json`."""
        return asdict(self)


@dataclass(slots=True)
class _Outcomes:
    """Detections of one class and one range of areas, over images."""

    true: int = 0
    scores: list[Floats] = field(default_factory=list)
    hits: list[Flags] = field(default_factory=list)  # (thresholds, n)
    ignored: list[Flags] = field(default_factory=list)


class AveragePrecision:
    """Collects the detections of image after image; `categories` has the name of each id."""

    def __init__(self, categories: Mapping[int, str]) -> None:
        self._categories = categories
        self._outcomes = {(c, area): _Outcomes() for c in categories for area in AREAS}
        self._images = 0

    def add(
        self,
        xyxy: NDArray[np.floating],
        score: NDArray[np.floating],
        category: NDArray[np.int64],
        truth: TrueBoxes,
    ) -> None:
        """Compare boxes (n, 4), scores (n,) and category ids (n,) with the truth of their image."""
        self._images += 1
        boxes, scores = xyxy.astype(np.float64), score.astype(np.float64)
        for one in np.union1d(category, truth.category).tolist():
            chosen = np.nonzero(category == one)[0]
            chosen = chosen[np.argsort(-scores[chosen], kind="stable")][:MAX_DETECTIONS]
            there = truth.category == one
            overlaps = _overlaps(boxes[chosen], truth.xyxy[there], truth.crowd[there])
            sides = boxes[chosen, 2:] - boxes[chosen, :2]
            for area, (low, high) in AREAS.items():
                outcomes = self._outcomes[one, area]
                size = truth.area[there]
                aside = truth.crowd[there] | (size < low) | (size > high)
                hits, ignored = _matched(overlaps, truth.crowd[there], aside)
                outside = (sides.prod(1) < low) | (sides.prod(1) > high)
                outcomes.true += int(np.sum(~aside))
                outcomes.scores.append(scores[chosen])
                outcomes.hits.append(hits)
                outcomes.ignored.append(ignored | (~hits & outside))

    def scores(self) -> DetectionScores:
        """Scores of all images so far."""
        curves = {key: _curve(outcomes) for key, outcomes in self._outcomes.items()}
        by_area = {
            area: [curve for (_, a), curve in curves.items() if a == area and curve is not None]
            for area in AREAS
        }
        means = {area: _mean([precision for precision, _ in by_area[area]]) for area in AREAS}
        precisions = [precision for precision, _ in by_area["all"]]
        return DetectionScores(
            images=self._images,
            true=sum(self._outcomes[c, "all"].true for c in self._categories),
            ap=means["all"],
            ap50=_mean([precision[0] for precision in precisions]),
            ap75=_mean([precision[5] for precision in precisions]),
            ap_small=means["small"],
            ap_medium=means["medium"],
            ap_large=means["large"],
            ar=_mean([recall for _, recall in by_area["all"]]),
            classes=tuple(
                _class_score(name, self._outcomes[c, "all"].true, curves[c, "all"])
                for c, name in self._categories.items()
            ),
        )


_Curve = tuple[Floats, Floats]  # precision (thresholds, recalls), recall (thresholds,)


def _class_score(name: str, true: int, curve: _Curve | None) -> ClassPrecision:
    if curve is None:
        return ClassPrecision(name, true, None, None, None, None)
    precision, recall = curve
    parts = (precision, precision[0], precision[5], recall)
    return ClassPrecision(name, true, *(float(np.mean(part)) for part in parts))


def _mean(parts: Sequence[Floats]) -> float | None:
    return float(np.mean([np.mean(part) for part in parts])) if parts else None


def _overlaps(found: Floats, true: Floats, crowd: Flags) -> Floats:
    """(n, m) IoU of boxes (n, 4) with true ones (m, 4); of crowds the share that lies in them."""
    low = np.maximum(found[:, None, :2], true[None, :, :2])
    high = np.minimum(found[:, None, 2:], true[None, :, 2:])
    shared = np.clip(high - low, 0, None).prod(2)
    areas = (found[:, 2:] - found[:, :2]).prod(1)[:, None]
    others = np.where(crowd, 0.0, (true[:, 2:] - true[:, :2]).prod(1) - shared)
    union: Floats = areas + others
    share: Floats = np.divide(shared, union, out=np.zeros_like(shared), where=union > 0)
    return share


def _matched(overlaps: Floats, crowd: Flags, aside: Flags) -> tuple[Flags, Flags]:
    """Masks (thresholds, n) of the matched detections, and of those matched to ignored things.

    Things that count are taken first; a crowd can be taken again.
    """
    n, m = overlaps.shape
    matched = np.zeros((len(OVERLAPS), n), bool)
    ignored = np.zeros_like(matched)
    if not n or not m:
        return matched, ignored
    free = np.ones((len(OVERLAPS), m), bool)
    rows = np.arange(len(OVERLAPS))
    for one in range(n):
        enough = free & (overlaps[one] >= OVERLAPS[:, None])
        counted = enough & ~aside
        choice = np.where(counted.any(1)[:, None], counted, enough)
        # the last of equals, as pycocotools has it
        best = m - 1 - np.argmax(np.where(choice, overlaps[one], -1.0)[:, ::-1], axis=1)
        hit = choice[rows, best]
        matched[:, one], ignored[:, one] = hit, hit & aside[best]
        free[rows, best] &= ~hit | crowd[best]
    return matched, ignored


def _curve(outcomes: _Outcomes) -> _Curve | None:
    """Interpolated precision and final recall; None where nothing is to be found."""
    if not outcomes.true:
        return None
    score = np.concatenate([*outcomes.scores, np.zeros(0)])
    order = np.argsort(-score, kind="stable")
    empty = np.zeros((len(OVERLAPS), 0), bool)
    hits = np.concatenate([*outcomes.hits, empty], axis=1)[:, order]
    counted = ~np.concatenate([*outcomes.ignored, empty], axis=1)[:, order]
    right = np.cumsum(hits & counted, axis=1, dtype=np.float64)
    wrong = np.cumsum(~hits & counted, axis=1, dtype=np.float64)
    recall = right / outcomes.true
    precision = right / np.maximum(right + wrong, np.spacing(1))
    precision = np.maximum.accumulate(precision[:, ::-1], axis=1)[:, ::-1]
    levels = np.zeros((len(OVERLAPS), len(RECALLS)))
    for row, (rising, falling) in enumerate(zip(recall, precision, strict=True)):
        at = np.searchsorted(rising, RECALLS, side="left")
        inside = at < len(falling)
        levels[row, inside] = falling[at[inside]]
    return levels, recall[:, -1] if len(score) else np.zeros(len(OVERLAPS))
