"""Simulated houses: the tour of the demo through a random house, by presets of the senses."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.rooms.outcomes import MAPPERS, Outcome, outcome
from lab.houses.random_house import random_house
from lab.maps.complete_truth import load_complete_truth
from lab.maps.truth_matching import TruthMatcher
from lab.recordings.hard_senses import SENSES, detector_of
from lab.recordings.object_truth import VisibilityRecord, object_truth
from perception.frames import Detections, Frame
from perception.inference.recorded_detections import RecordedDetector
from planner.simulation.camera import SimulatedCamera
from planner.simulation.house_robot import SimulatedTour

HOUSES: Final = "houses"  # in place of a room
GOALS: Final = {"demo": (0.95, 0.95), "hard": (0.86, 0.90)}  # senses -> least recall, precision


def map_house(seed: int) -> list[Outcome]:
    """The demo's tour through the house of `seed`, by each mapper with each of the senses."""
    camera = SimulatedCamera(random_house(seed), seed=seed)
    detectors = {senses: detector_of(camera, SENSES[senses]) for senses in GOALS}
    found: dict[str, dict[str, Detections]] = {senses: {} for senses in GOALS}
    visible, frames = VisibilityRecord(camera.house, camera.model), list[Frame]()
    for frame in SimulatedTour(camera).frames():  # each is rendered once
        frames.append(frame)
        visible.add(frame.id, camera.view(frame.T_map_cam, frame.stamp))
        for senses, detector in detectors.items():
            found[senses][frame.id] = detector.detect(frame)
    seen = {
        senses: RecordedDetector(detector.name, Path(), found[senses], 0.0)
        for senses, detector in detectors.items()
    }
    truth = _truth(object_truth(camera.house, visible.frames, []))
    return [
        outcome((HOUSES, senses, "tour"), mapper, frames, (recorded,), truth)
        for senses, recorded in seen.items()
        for mapper in MAPPERS
    ]


def _truth(truth: dict[str, Any]) -> TruthMatcher:
    """A truth, read as that of a recording is."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "truth.json"
        path.write_text(json.dumps(truth))
        return TruthMatcher(load_complete_truth(path), np.eye(4))
