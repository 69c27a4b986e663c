"""Real rooms, and what each network sees in them: recordings that have a complete truth.

A network looks once at each frame of a recording. Its output is kept in a file, whose name has a
digest of the network but not of the code around it: after a change there the files are to go.
"""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np

from kg.model.errors import ModelError, RecordingError
from perception.frames import Detections, Detector, Frame
from perception.inference.detector import load_detector
from perception.inference.detector_pair import DetectorPair
from perception.inference.model_zoo import bundled_pair, resolve
from perception.inference.recorded_detections import (
    RecordedDetector,
    load_recorded_detections,
    save_recorded_detections,
)
from perception.sources.recording import open_recording

TRUTH: Final = "objects_full_gt.json"
THRESHOLD: Final = 0.05  # least score that is kept
_CHECKOUT: Final = Path(__file__).resolve().parents[2]

Networks = dict[str, tuple[str, ...]]  # name -> one network or a pair, by name or file


def shared_data() -> Path:
    """The shared data folder: HEREABOUTS_SHARED, or `shared` beside the checkout."""
    folder = Path(os.environ.get("HEREABOUTS_SHARED", _CHECKOUT.parent / "shared"))
    if not folder.is_dir():
        raise RecordingError(f"no shared data at {folder}: HEREABOUTS_SHARED=FOLDER would work")
    return folder


def room_folders() -> dict[str, Path]:
    """Name -> folder of each recording with a complete truth."""
    found = sorted((shared_data() / "data/rgbd").glob(f"*/{TRUTH}"))
    return {path.parent.name: path.parent for path in found}


@lru_cache(maxsize=1)
def frames_of(folder: Path) -> tuple[Frame, ...]:
    """Frames of a recording without their colours; those last read stay in memory."""
    frames = list[Frame]()
    for frame in open_recording(folder).frames():
        same = frames and frames[0].rgb.shape == frame.rgb.shape
        frames.append(replace(frame, rgb=frames[0].rgb if same else np.zeros_like(frame.rgb)))
    return tuple(frames)


def networks() -> Networks:
    """The bundled pair, and each detector among the shared networks."""
    found: Networks = {"default": bundled_pair()}
    for path in sorted((shared_data() / "models").glob("*.onnx")):
        try:
            load_detector(path)
        except ModelError as error:
            sys.stderr.write(f"{path.name} is left out: {' '.join(str(error).split())}\n")
        else:
            found[path.stem] = (str(path),)
    return found


def look(folder: Path, looking: Iterable[str], cache: Path) -> None:
    """Let networks look at the recording in `folder`, those that have not yet."""
    files = {_file(cache, folder, network): network for network in looking}
    detectors = {
        path: load_detector(network, threshold=THRESHOLD, threads=1)
        for path, network in files.items()
        if not path.exists()
    }
    if not detectors:
        return
    found: dict[Path, dict[str, Detections]] = {path: {} for path in detectors}
    for frame in open_recording(folder).frames():
        for path, detector in detectors.items():
            found[path][frame.id] = detector.detect(frame)
    for path, detector in detectors.items():
        unfinished = path.with_suffix(".part")
        save_recorded_detections(unfinished, detector.name, found[path], exact=True)
        unfinished.replace(path)


def looks(folder: Path, looking: Sequence[str], cache: Path) -> tuple[RecordedDetector, ...]:
    """Detections in the recording in `folder`, as `look` saved them."""
    return tuple(load_recorded_detections(_file(cache, folder, network)) for network in looking)


def detector_of(seen: Sequence[RecordedDetector], threshold: float) -> Detector:
    """Detector of scores above `threshold`: of a pair, the second looks where views are new."""
    ones = [replace(one, threshold=threshold) for one in seen]
    return DetectorPair(*ones) if len(ones) == 2 else ones[0]


def _file(cache: Path, folder: Path, network: str) -> Path:
    digest = hashlib.sha256(resolve(network, "detector")[0].read_bytes()).hexdigest()
    return cache / f"{folder.name}-{digest[:12]}.json"
