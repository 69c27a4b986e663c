"""Simulated houses: the demo's tour through a random house, by each preset of the senses."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.rooms.outcomes import MAPPERS, Outcome, mapped
from mapping.evaluation.complete_truth import load_complete_truth
from mapping.evaluation.truth_matching import TruthMatcher
from perception.frames import Frame
from perception.inference.recorded_detections import RecordedDetector
from planner.simulation.houses.house import House
from planner.simulation.houses.random_house import random_house
from planner.simulation.recording.object_truth import VisibilityRecord, object_truth
from planner.simulation.robot.mapping_tour import SimulatedTour
from planner.simulation.sensing.camera import SimulatedCamera
from planner.simulation.sensing.sensors import SENSES, SimulatedDetector

HOUSES: Final = "houses"  # in place of a room
#: Senses -> least recall and precision at existence 0.5.
GOALS: Final = {"demo": (0.95, 0.95), "hard": (0.86, 0.90)}


def map_house(seed: int) -> Iterator[Outcome]:
    """The house of `seed`, by each mapper and preset of the senses that has goals."""
    house = random_house(seed)
    camera = SimulatedCamera(house, seed=seed)
    frames = tuple(SimulatedTour(camera).frames())
    matcher = _matcher(house, camera, frames)
    for senses in GOALS:
        simulated = SimulatedDetector(camera, SENSES[senses])
        found = {frame.id: simulated.detect(frame) for frame in frames}
        seen = RecordedDetector(simulated.name, Path(), found, 0.0)
        for mapper in MAPPERS:
            yield mapped((HOUSES, senses, "tour"), mapper, frames, (seen,), matcher)


def _matcher(house: House, camera: SimulatedCamera, frames: tuple[Frame, ...]) -> TruthMatcher:
    """The truth of a tour, read as that of a recording is."""
    visibility = VisibilityRecord(house, camera.model)
    for frame in frames:
        visibility.add(frame.id, camera.view(frame.T_map_cam, frame.stamp))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "truth.json"
        path.write_text(json.dumps(object_truth(house, visibility.frames, [])))
        return TruthMatcher(load_complete_truth(path), np.eye(4))
