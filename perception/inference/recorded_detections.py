"""Recorded detections: what a detector found in each frame of a recording, read from a JSON file.

{"name": NAME, "frames": {FRAME_ID: [[x1, y1, x2, y2, score, label], ...]}}, boxes in pixels of the
recording's colour images. A frame in which nothing was found has an empty list. A mask may follow
the label: {"size": [h, w], "runs": [...]}, lengths of runs of pixels outside and inside by turns,
row by row over the pixels of the box (`perception.frames.box_pixels`), outside first.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import ExtensionError, ModelError
from kg.model.extensions import DETECTORS, extensions, load_extension
from kg.model.regular_files import read_text
from perception.frames import Detections, Detector, Frame, mask_of_runs
from perception.inference.detector import load_detector
from perception.inference.detector_pair import DetectorPair
from perception.inference.model_zoo import bundled_pair, cards


@dataclass(frozen=True, slots=True)
class RecordedDetector:
    """A detector that repeats what was recorded for each frame."""

    name: str
    path: Path
    frames: Mapping[str, Detections]
    threshold: float

    def detect(self, frame: Frame) -> Detections:
        """Detections recorded for `frame`; raises ModelError where the file does not list it."""
        found = self.frames.get(frame.id)
        if found is None:
            raise ModelError(
                f"{self.path} has no frame {frame.id!r}; an entry for each frame of the recording, "
                "with an empty list where nothing was found, would work"
            )
        return found.chosen(np.nonzero(found.score > self.threshold)[0])


@runtime_checkable
class DetectorFactory(Protocol):
    """Makes a detector: the object of an entry point in `hereabouts.detectors`."""

    def __call__(self, *, threshold: float, device: str) -> Detector:
        """A detector that gives scores above `threshold`; `device` is "auto", "cpu", "cuda"."""


def open_detector(
    name_or_path: str | Path,
    *,
    threshold: float = 0.25,
    device: str = "cpu",
    head: str | None = None,
) -> Detector:
    """A detector by name, from an ONNX file, or from a JSON file of recorded detections.

    "default" is the bundled pair; a name may be that of an extension. `device` and `head`:
    see `load_detector`. Raises ModelError for anything else, ExtensionError for a broken extension.
    """
    name = str(name_or_path)
    recorded = Path(name).suffix == ".json"
    listed = name == "default" or recorded or name in {card.name for card in cards()}
    of_extension = not listed and name in extensions(DETECTORS)
    if head is not None and (name == "default" or recorded or of_extension):
        raise ModelError(
            f"{name} has no outputs of two meanings; --head with --detector FILE.onnx would work"
        )
    if name == "default":
        first, second = (
            load_detector(name, threshold=threshold, device=device) for name in bundled_pair()
        )
        return DetectorPair(first, second)
    if recorded:
        return load_recorded_detections(Path(name), threshold=threshold)
    if of_extension:
        return _extension(name, threshold, device)
    return load_detector(name_or_path, threshold=threshold, device=device, head=head)


def _extension(name: str, threshold: float, device: str) -> Detector:
    """The detector that the factory of an extension makes."""
    factory = load_extension(DETECTORS, name, DetectorFactory)  # type: ignore[type-abstract]
    detector = factory(threshold=threshold, device=device)
    if not isinstance(detector, Detector):
        raise ExtensionError(f"the extension {name!r} made {detector!r}, which is no Detector")
    return detector


def load_recorded_detections(path: Path, *, threshold: float = 0.0) -> RecordedDetector:
    """Read recorded detections; raises ModelError, naming the frame, for anything else."""
    try:
        data: Any = json.loads(read_text(path))
    except (OSError, ValueError, RecursionError) as error:
        raise ModelError(f"cannot read detections from {path}: {error}") from error
    frames = data.get("frames") if isinstance(data, dict) else None
    if not isinstance(frames, dict):
        raise ModelError(
            f'{path} holds no detections; {{"frames": {{FRAME_ID: [[x1, y1, x2, y2, score, '
            "label], ...]}} would work"
        )
    read = {frame: _detections(path, frame, rows) for frame, rows in frames.items()}
    return RecordedDetector(str(data.get("name") or path.stem), path, read, threshold)


def save_recorded_detections(
    path: Path, name: str, frames: Mapping[str, Detections], *, exact: bool = False
) -> None:
    """Write `frames` (frame id -> detections) as a file of recorded detections.

    Boxes are rounded to 0.1 px and scores to 0.0001, unless they are to come back `exact`.
    """
    rows = {frame: _rows(found, exact) for frame, found in frames.items()}
    body = ",\n".join(f"{json.dumps(frame)}: {json.dumps(found)}" for frame, found in rows.items())
    try:
        path.write_text(f'{{"name": {json.dumps(name)},\n"frames": {{\n{body}\n}}}}\n', "utf-8")
    except OSError as error:
        raise ModelError(f"cannot write {path}: {error.strerror}") from error


def _rows(found: Detections, exact: bool) -> list[list[Any]]:
    rows: list[list[Any]] = []
    for number, (box, score, label) in enumerate(
        zip(found.xyxy, found.score, found.label, strict=True)
    ):
        mask = found.mask[number] if found.mask else None
        # a box that is rounded may have other pixels than its mask
        sides = _sides(box, exact=exact or mask is not None)
        rows.append([*sides, float(score) if exact else round(float(score), 4), label])
        if mask is not None:
            rows[-1].append({"size": list(mask.shape), "runs": _runs(mask)})
    return rows


def _sides(box: NDArray[np.floating], *, exact: bool) -> list[float]:
    """x1, y1, x2, y2 [px] of a box, to 0.1 px where that leaves it a width and a height."""
    sides = [float(c) for c in box]
    x1, y1, x2, y2 = rounded = [round(c, 1) for c in sides]
    return sides if exact or x1 >= x2 or y1 >= y2 else rounded


def _runs(mask: NDArray[np.bool_]) -> list[int]:
    """Lengths of the runs of pixels outside and inside by turns, outside first."""
    flat = np.concatenate([[False], mask.ravel()])
    changes = np.nonzero(flat[1:] != flat[:-1])[0]
    lengths: list[int] = np.diff([0, *changes.tolist(), mask.size]).tolist()
    return lengths


def _detections(path: Path, frame: str, rows: Any) -> Detections:
    try:
        numbers = np.array([row[:5] for row in rows], np.float32).reshape(len(rows), 5)
        labels = [row[5] for row in rows]
        masks = [
            mask_of_runs(row[6]["runs"], row[6]["size"]) if row[6:] not in ([], [None]) else None
            for row in rows
        ]
        sound = np.isfinite(numbers).all() and all(isinstance(label, str) for label in labels)
        in_order = np.all(numbers[:, 2:4] > numbers[:, :2])
        if not (sound and in_order and np.all((numbers[:, 4] >= 0) & (numbers[:, 4] <= 1))):
            raise ValueError("a box needs x1 < x2 and y1 < y2, a score in 0..1 and a label")
    except (IndexError, KeyError, OverflowError, TypeError, ValueError) as error:
        raise ModelError(
            f"{path}, frame {frame!r}: {error}; [x1, y1, x2, y2, score, label] would work"
        ) from error
    found = Detections(numbers[:, :4], numbers[:, 4], tuple(labels))
    if any(mask is not None for mask in masks):
        found = replace(found, mask=tuple(masks))
    return found.chosen(np.argsort(-numbers[:, 4], kind="stable"))
