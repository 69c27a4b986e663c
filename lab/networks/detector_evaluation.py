"""Evaluation of a detector on photographs with true boxes."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import ModelError
from lab.networks.average_precision import AveragePrecision, DetectionScores
from lab.networks.coco_dataset import CocoDataset, CocoImage
from perception.frames import Detections
from perception.inference.detector import OnnxDetector
from perception.sources.folders.image_files import read_colour

THRESHOLD: Final = 0.001  # least score; precision at high recall needs the weak ones


@dataclass(frozen=True, slots=True)
class DetectorEvaluation:
    """Scores of a detector, and what of its answers no class of the data set is called."""

    detector: str
    scores: DetectionScores
    unknown_labels: Mapping[str, int]  # of the network -> detections left out

    def to_json(self) -> dict[str, Any]:
        """Plain values, for `--json`."""
        unknown = {"unknown_labels": dict(self.unknown_labels)}
        return {"detector": self.detector} | self.scores.to_json() | unknown


@dataclass(slots=True)
class ResultsFile:
    """Detections in the format that COCO's own evaluation reads, written when all are known."""

    path: Path
    rows: list[str]

    def add(self, image: CocoImage, found: Detections, category: NDArray[np.int64]) -> None:
        """Keep the detections of an image whose category is known."""
        for box, score, one in zip(found.xyxy.tolist(), found.score, category, strict=True):
            if one >= 0:
                x1, y1, x2, y2 = box
                row = {
                    "image_id": image.id,
                    "category_id": int(one),
                    "bbox": [x1, y1, x2 - x1, y2 - y1],
                    "score": float(score),
                }
                self.rows.append(json.dumps(row))

    def write(self) -> None:
        """Write the file; raises ModelError where that fails."""
        try:
            self.path.write_text("[\n" + ",\n".join(self.rows) + "\n]\n", "utf-8")
        except OSError as error:
            raise ModelError(f"cannot write {self.path}: {error.strerror}") from error


def evaluate_detector(
    detector: OnnxDetector,
    dataset: CocoDataset,
    *,
    images: int | None = None,
    results: Path | None = None,
    on_image: Callable[[int], None] | None = None,
) -> DetectorEvaluation:
    """Scores of `detector` on the first `images` images (None: all) of a data set.

    Labels belong to the categories of the same name. `results` is where the detections are written
    as COCO results. `on_image` gets the number of images done. Raises ModelError where no label is
    a category, RecordingError for an unreadable image.
    """
    ids = {name.lower(): number for number, name in dataset.categories.items()}
    if not any(label.lower() in ids for label in detector.labels):
        raise ModelError(
            f"{detector.name} and {dataset.path} share no class: it has "
            f"{_some(detector.labels)}, the data set {_some(dataset.categories.values())}"
        )
    measured = AveragePrecision(dataset.categories)
    unknown: Counter[str] = Counter()
    written = None if results is None else ResultsFile(results, [])
    for number, image in enumerate(dataset.images[:images], start=1):
        found = detector.detect_image(read_colour(image.path))
        category = np.array([ids.get(label.lower(), -1) for label in found.label], np.int64)
        unknown.update(label for label in found.label if label.lower() not in ids)
        known = category >= 0
        measured.add(found.xyxy[known], found.score[known], category[known], image.truth)
        if written is not None:
            written.add(image, found, category)
        if on_image is not None:
            on_image(number)
    if written is not None:
        written.write()
    return DetectorEvaluation(detector.name, measured.scores(), dict(unknown.most_common()))


def _some(names: Iterable[str]) -> str:
    names = list(names)
    return ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")
