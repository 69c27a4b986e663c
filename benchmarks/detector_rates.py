"""Hit and false-alarm rates of a detector, fitted to photographs with complete boxes.

    python -m benchmarks.detector_rates NETWORK.onnx --photographs DIR [DIR ...]

Each folder has `instances.json` (COCO) and `images/`. A photograph is seen through random crops,
with motion blur, defocus, noise and JPEG artefacts, as so many views of what it shows. Detections
of one spot and label over the views are a track, true where it is an annotated thing. The rates of
`mapping.objects.detector_rates` follow by logistic regression of true tracks on sums of their
views; the line that is printed goes into the network's card in the registry.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from mapping.objects.settings import ObjectSettings
from mapping.objects.sightings import intersection_over_union
from perception.inference.detector import OnnxDetector, load_detector

VIEWS: Final = 8  # of each photograph
CORRELATION: Final = 0.5  # of views of one photograph, about the best for four networks
PRIOR: Final = ObjectSettings().prior
THRESHOLD: Final = 0.15  # least score
MATCH: Final = 0.4  # IoU of one spot
LEAST_VISIBLE: Final = 0.8  # share of a box inside a crop for it to count as a view
LEAST_AREA: Final = 0.003  # share of the image; smaller things are not what a mapper looks for

Floats = NDArray[np.float64]
Image = NDArray[np.uint8]


@dataclass(slots=True)
class _Track:
    """A label in a spot of a photograph, over its views."""

    label: str
    box: Floats  # (4,) xyxy [px] of the photograph
    true: bool
    scores: dict[int, float] = field(default_factory=dict)  # by view


@dataclass(frozen=True, slots=True)
class _View:
    """A degraded crop of a photograph."""

    image: Image
    offset: Floats  # (4,) [px] of the crop, twice x and y
    frame: Floats  # (4,) xyxy [px]


@dataclass(frozen=True, slots=True)
class TrackViews:
    """The views of one track: scores, 0 where it was missed, and the share of the image's side."""

    scores: Floats
    true: bool
    side: float


def photographs(folder: Path) -> Iterator[tuple[Image, list[tuple[Floats, str]]]]:
    """Images with their boxes (4,) xyxy [px] and labels."""
    data: Any = json.loads((folder / "instances.json").read_text())
    names = {category["id"]: category["name"] for category in data["categories"]}
    for entry in data["images"]:
        path = folder / "images" / Path(entry["file_name"]).name
        things = [
            (_corners(one["bbox"]), names[one["category_id"]])
            for one in data["annotations"]
            if one["image_id"] == entry["id"] and not one.get("iscrowd")
        ]
        yield cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB), things


def _corners(box: Sequence[float]) -> Floats:
    x, y, width, height = box
    return np.array([x, y, x + width, y + height], float)


def degraded(image: Image, rng: np.random.Generator) -> Image:
    """`image` as a moving camera of low quality sees it."""
    length = int(rng.integers(2, 9))
    kernel = np.zeros((length, length), np.float32)
    kernel[length // 2] = 1 / length
    centre = (length / 2 - 0.5, length / 2 - 0.5)
    turn = cv2.getRotationMatrix2D(centre, rng.uniform(0, 180), 1)
    kernel = cv2.warpAffine(kernel, turn, (length, length))
    blurred = cv2.filter2D(image, -1, kernel / max(float(kernel.sum()), 1e-6))
    blurred = cv2.GaussianBlur(blurred, (0, 0), rng.uniform(0.6, 1.6))
    contrast, brightness = rng.uniform(0.6, 1.0), rng.uniform(0.8, 1.1)
    noise = rng.normal(0, rng.uniform(2, 7), image.shape)
    noisy = (blurred.astype(np.float32) - 128) * contrast + 128 * brightness + noise
    quality = [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(55, 85))]
    _, packed = cv2.imencode(".jpg", np.clip(noisy, 0, 255).astype(np.uint8), quality)
    return np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR), np.uint8)


def _views(image: Image, rng: np.random.Generator) -> Iterator[_View]:
    height, width = image.shape[:2]
    for _ in range(VIEWS):
        scale = rng.uniform(0.6, 1.0)
        h, w = int(height * scale), int(width * scale)
        y, x = int(rng.integers(0, height - h + 1)), int(rng.integers(0, width - w + 1))
        crop = degraded(np.ascontiguousarray(image[y : y + h, x : x + w]), rng)
        yield _View(crop, np.array([x, y, x, y], float), np.array([x, y, x + w, y + h], float))


def _clipped(box: Floats, frame: Floats) -> Floats:
    return np.concatenate([np.maximum(box[:2], frame[:2]), np.minimum(box[2:], frame[2:])])


def sequences(
    detector: OnnxDetector, image: Image, things: Sequence[tuple[Floats, str]], seed: int
) -> Iterator[TrackViews]:
    """Tracks of one photograph over its views."""
    tracks = [_Track(label, box, true=True) for box, label in things]
    views = list(_views(image, np.random.default_rng(seed)))
    for number, view in enumerate(views):
        found = detector.detect_image(view.image)
        for corners, score, label in zip(found.xyxy, found.score, found.label, strict=True):
            box = corners + view.offset
            free = [t for t in tracks if t.label == label and number not in t.scores]
            overlaps = [
                intersection_over_union(tuple(box), tuple(_clipped(t.box, view.frame)))
                for t in free
            ]
            best = int(np.argmax(overlaps)) if overlaps else -1
            if best < 0 or overlaps[best] <= MATCH:
                tracks.append(_Track(label, box, true=False))
                free, best = tracks, len(tracks) - 1
            free[best].scores[number] = float(score)
    area = float(image.shape[0] * image.shape[1])
    for track in tracks:
        whole = float((track.box[2:] - track.box[:2]).prod())
        shown = [
            track.scores.get(number, 0.0)
            for number, view in enumerate(views)
            if _share(_clipped(track.box, view.frame), whole) > LEAST_VISIBLE
        ]
        if len(shown) > 1:
            yield TrackViews(np.array(shown), track.true, float(np.sqrt(whole / area)))


def _share(part: Floats, whole: float) -> float:
    return float(np.clip(part[2:] - part[:2], 0, None).prod() / max(whole, 1e-9))


def fit_scores(found: Sequence[TrackViews]) -> tuple[float, float]:
    """Offset and slope of a hit's log-likelihood ratio.

    Logistic regression of `true` on the hits, their logits and the misses, each sum saturating with
    the views, from the mapper's prior.
    """
    rng, rows, truth = np.random.default_rng(0), list[list[float]](), list[bool]()
    for one in found:
        for count in (1, 2, 4, 8):
            scores = rng.permutation(one.scores)[:count]
            if len(scores) == count and scores.max() > 0:
                hits = np.clip(scores[scores > 0], 0, 0.99)
                logits = float(np.log(hits / (1 - hits)).sum())
                saturation = 1 + (count - 1) * CORRELATION
                sums = np.array([len(hits), logits, count - len(hits)]) / saturation
                rows.append([*sums])
                truth.append(one.true)
    weights = _logistic(np.array(rows), np.array(truth, float))
    return float(weights[0]), float(weights[1])


def _logistic(x: Floats, y: Floats) -> Floats:
    """Weights of a logistic regression, by Newton's method."""
    weights = np.zeros(x.shape[1])
    for _ in range(30):
        p = 1 / (1 + np.exp(-np.clip(PRIOR + x @ weights, -30, 30)))
        hessian = (x * (p * (1 - p))[:, None]).T @ x + 1e-3 * np.eye(x.shape[1])
        weights = weights + np.linalg.solve(hessian, x.T @ (y - p) - 1e-3 * weights)
    return weights


def fit_recall(found: Sequence[TrackViews]) -> tuple[float, float]:
    """Recall of large things, and the share of the image's side at which it is half of that."""
    true = [one for one in found if one.true]
    side = np.array([one.side for one in true])
    seen = np.array([float((one.scores > 0).mean()) for one in true])
    options = [
        (float(((recall / (1 + (half / side) ** 2) - seen) ** 2).sum()), recall, half)
        for recall in np.arange(0.5, 0.96, 0.02)
        for half in np.arange(0.02, 0.2, 0.005)
    ]
    _, recall, half = min(options)
    return float(recall), float(half)


def repeat_rate(found: Sequence[TrackViews]) -> float:
    """Probability that a false detection is made again in another view."""
    false = [one.scores for one in found if not one.true and one.scores.max() > 0]
    again = sum(int((scores > 0).sum()) - 1 for scores in false)
    return again / max(sum(len(scores) - 1 for scores in false), 1)


def main() -> None:
    """Fit, and print the card's line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("network")
    parser.add_argument("--labels", type=Path, help="labels of a network without a card")
    parser.add_argument("--photographs", type=Path, nargs="+", required=True, metavar="DIR")
    arguments = parser.parse_args()
    detector = load_detector(arguments.network, threshold=THRESHOLD, labels=arguments.labels)
    found = [
        one
        for folder in arguments.photographs
        for seed, (image, things) in enumerate(photographs(folder))
        for one in sequences(detector, image, things, seed)
    ]
    large = [one for one in found if not one.true or one.side**2 > LEAST_AREA]
    offset, slope = fit_scores(large)
    recall, half = fit_recall(found)
    sys.stdout.write(
        f"rates = {{ offset = {offset:.2f}, slope = {slope:.2f}, recall = {recall:.2f}, "
        f"half = {half:.3f}, repeat = {repeat_rate(found):.2f} }}  # {len(found)} tracks\n"
    )


if __name__ == "__main__":
    main()
