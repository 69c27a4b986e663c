"""What each network sees in each frame, kept in a folder: a network looks once at each frame.

A file holds one network's detections of one recording. Its name has a digest of the network, but
not of the code that prepares images and reads outputs: after a change there the folder is to go.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from benchmarks.rooms.real_room import shared_data
from kg.errors import ModelError
from perception.frames import Detections, Detector
from perception.inference.detector import OnnxDetector, load_detector
from perception.inference.detector_pair import DetectorPair
from perception.inference.model_zoo import bundled_pair, resolve
from perception.inference.recorded_detections import (
    RecordedDetector,
    load_recorded_detections,
    save_recorded_detections,
)
from perception.recordings.recording import open_recording

PAIR: Final = "default"
THRESHOLD: Final = 0.05  # least score that is kept

Networks = dict[str, tuple[str, ...]]  # name -> networks that look, by name or file


def networks() -> Networks:
    """The bundled pair, and each detector among the shared networks."""
    found: Networks = {PAIR: bundled_pair()}
    for path in sorted((shared_data() / "models").glob("*.onnx")):
        try:
            load_detector(path)
        except ModelError as error:
            sys.stderr.write(f"{path.name} is no detector: {' '.join(str(error).split())}\n")
        else:
            found[path.stem] = (str(path),)
    return found


def look(folder: Path, looking: Iterable[str], cache: Path) -> None:
    """Let networks look at the recording in `folder`, those that have not yet."""
    missing: dict[Path, OnnxDetector] = {}
    for network in looking:
        path = _file(cache, folder, network)
        if path not in missing and not path.exists():
            missing[path] = load_detector(network, threshold=THRESHOLD, threads=1)
    if not missing:
        return
    found: dict[Path, dict[str, Detections]] = {path: {} for path in missing}
    for frame in open_recording(folder).frames():
        for path, detector in missing.items():
            found[path][frame.id] = detector.detect(frame)
    for path, detector in missing.items():
        unfinished = path.with_suffix(".part")
        save_recorded_detections(unfinished, detector.name, found[path])
        unfinished.replace(path)


def looks(folder: Path, looking: Sequence[str], cache: Path) -> tuple[RecordedDetector, ...]:
    """What networks saw in the recording in `folder`, as `look` left it."""
    return tuple(load_recorded_detections(_file(cache, folder, network)) for network in looking)


def detector(seen: Sequence[RecordedDetector], threshold: float) -> Detector:
    """A detector of scores above `threshold`: one network, or the second where views are new."""
    ones = [replace(one, threshold=threshold) for one in seen]
    return DetectorPair(*ones) if len(ones) == 2 else ones[0]


def _file(cache: Path, folder: Path, network: str) -> Path:
    path, _ = resolve(network, "detector")
    digest = hashlib.sha256(path.read_bytes()).hexdigest()[:12]
    return cache / f"{folder.name}-{digest}.json"
