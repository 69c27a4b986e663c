"""Simulated houses: the tour of the demo through a random house, by presets of the senses."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.rooms.outcomes import MAPPERS, Outcome, outcome
from mapping.evaluation.complete_truth import load_complete_truth
from mapping.evaluation.truth_matching import TruthMatcher
from perception.frames import Frame
from perception.inference.recorded_detections import RecordedDetector
from planner.simulation.houses.random_house import random_house
from planner.simulation.recording.object_truth import VisibilityRecord, object_truth
from planner.simulation.robot.mapping_tour import SimulatedTour
from planner.simulation.sensing.camera import SimulatedCamera
from planner.simulation.sensing.sensors import SENSES, SimulatedDetector

HOUSES: Final = "houses"  # in place of a room
GOALS: Final = {"demo": (0.95, 0.95), "hard": (0.86, 0.90)}  # senses -> least recall, precision


def map_house(seed: int) -> list[Outcome]:
    """The house of `seed`, by each mapper with each of the senses that have goals."""
    camera = SimulatedCamera(random_house(seed), seed=seed)
    frames, outcomes = tuple(SimulatedTour(camera).frames()), list[Outcome]()
    truth = _truth(camera, frames)
    for senses in GOALS:
        detector = SimulatedDetector(camera, SENSES[senses])
        found = {frame.id: detector.detect(frame) for frame in frames}
        seen = (RecordedDetector(detector.name, Path(), found, 0.0),)
        row = HOUSES, senses, "tour"
        outcomes += [outcome(row, mapper, frames, seen, truth) for mapper in MAPPERS]
    return outcomes


def _truth(camera: SimulatedCamera, frames: tuple[Frame, ...]) -> TruthMatcher:
    """The truth of a tour, read as that of a recording is."""
    visible = VisibilityRecord(camera.house, camera.model)
    for frame in frames:
        visible.add(frame.id, camera.view(frame.T_map_cam, frame.stamp))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "truth.json"
        path.write_text(json.dumps(object_truth(camera.house, visible.frames, [])))
        return TruthMatcher(load_complete_truth(path), np.eye(4))
