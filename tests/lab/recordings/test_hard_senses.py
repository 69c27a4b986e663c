"""Senses of trials: uneven faults, clutter, and what the border cuts."""

from dataclasses import replace
from math import pi

import numpy as np

from lab.recordings.hard_senses import CLUTTER_TAKEN_FOR, SENSES, UnevenFaults, detector_of
from planner.simulation.camera import SimulatedCamera
from planner.simulation.house import FURNISHINGS, Item
from planner.simulation.sensors import SimulatedDetector
from tests.planner.simulation.test_simulation import frame_at, one_room


def test_what_clutter_is_taken_for_is_furnishing() -> None:
    assert set(CLUTTER_TAKEN_FOR) <= set(FURNISHINGS)


def test_recall_falls_for_what_the_border_cuts() -> None:
    camera = SimulatedCamera(one_room(Item("couch", 3.0, 3.2)))
    view = camera.view(camera.model.pose(3.0, 0.8, pi / 2))
    aside = camera.view(camera.model.pose(3.0, 0.8, pi / 2 + 0.75))
    assert view.inside[0] > 0.95 and 0.01 < aside.inside[0] < 0.35
    cut = detector_of(camera, SENSES["hard"]).cut  # type: ignore[attr-defined]
    assert cut(0.05) < 0.1 < 0.6 < cut(1.0)


def test_clutter_is_taken_for_the_same_thing_again_and_again_from_one_side() -> None:
    house = replace(one_room(), furnishings=(Item("waste bin", 3.0, 3.0, name="bin"),))
    camera = SimulatedCamera(house)
    faults = UnevenFaults(recall=0, false_alarms=0, clutter=1.0, clutter_recall=1.0, threshold=0.25)
    detector = detector_of(camera, faults)
    found = []
    for k, angle in enumerate(np.linspace(-pi, pi, 24, endpoint=False)):
        x, y = 3 - 2 * np.cos(angle), 3 - 2 * np.sin(angle)
        found.append(detector.detect(frame_at(camera, x, y, angle, f"f{k}")).label)
    seen = {label for labels in found for label in labels}
    assert len(seen) == 1 and seen <= set(CLUTTER_TAKEN_FOR["waste bin"])
    assert 4 <= sum(map(len, found)) <= 9
    assert not any(SimulatedDetector(camera).detect(frame_at(camera, 3, 1, pi / 2)).label)


def test_scores_of_hard_senses_tell_true_from_false_only_in_part() -> None:
    camera = SimulatedCamera(one_room(Item("chair", 3.0, 3.2)))
    detector = detector_of(camera, SENSES["hard"])
    frames = [frame_at(camera, 3.0, 0.8, pi / 2, f"f{k}") for k in range(300)]
    true, false = list[float](), list[float]()
    for detections in map(detector.detect, frames):
        for label, score in zip(detections.label, detections.score, strict=True):
            (true if label == "chair" else false).append(float(score))
    assert all(0.25 <= score <= 1 for score in true + false)
    assert 0.55 < len(true) / len(frames) < 0.8
    assert 0.2 < len(false) / len(frames) < 0.55
    assert np.median(true) > np.median(false) + 0.1 and max(false) > min(true)
