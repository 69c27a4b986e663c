"""The map of a live camera follows the loops that its tracker closes."""

import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags")
from kg.maps.semantic_map import SemanticMap
from kg.serving.opening import create_map
from mapping.alignment.pose_correction import MOVED, LiveCorrection
from mapping.mapping_options import MappingOptions
from mapping.recording_mapper import map_recording
from perception.camera.poses import motion
from perception.frames import Detector, Recording
from perception.inference.detector import load_detector
from perception.inference.detector_pair import RememberingDetector
from perception.sources.bag_writer import write_bag
from perception.sources.live import stream
from perception.sources.live.live_recording import MAX_FRAMES, KeptFrames, LiveRecording
from perception.sources.live.stream import FrameStream
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions, Selection
from tests.perception.sources.live.test_live_tracker import Player

OPTIONS = MappingOptions(pictures=False)
FRAMES = 44  # the camera comes back to where it began at the 40th


@pytest.fixture(scope="module")
def bag(shared: Callable[[str], Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Every fourth frame of a kitchen, as a bag."""
    selection = Selection(every=4, limit=FRAMES)
    options = RecordingOptions(check=False, selection=selection)
    kitchen = open_recording(shared("data/rgbd/redkitchen"), options)
    path = tmp_path_factory.mktemp("bags") / "kitchen.mcap"
    assert len(list(write_bag(kitchen, path))) == FRAMES
    return path


class Counting:
    """A real detector that counts the images it looks at."""

    def __init__(self, detector: Detector) -> None:
        self.name, self.count, self._detector = detector.name, 0, detector

    def detect(self, frame):
        self.count += 1
        return self._detector.detect(frame)


@pytest.fixture
def detector(shared: Callable[[str], Path]) -> Counting:
    return Counting(load_detector(shared("models/deimv2_femto_416.onnx"), threshold=0.25))


@pytest.fixture
def mapped(bag, detector, tmp_path, monkeypatch):
    """Callable that plays the bag without its poses; the map, its correction and the lines."""
    for name in ("SETTLING", "SILENT", "UNPOSED"):
        monkeypatch.setattr(stream, name, 0.0)
    monkeypatch.setattr(stream, "PATIENCE", 0.05)

    def run():
        frames, player = FrameStream("player"), Player(bag)
        recording = LiveRecording("live", player, frames, threading.Event(), idle=3.0)
        # the next image comes once the one before was taken to be mapped, or lost
        player.taken = lambda: (
            recording._given + (recording.tracker.lost if recording.tracker else 0)
        )
        recording.level()
        kept, lines = KeptFrames(), list[str]()
        correction = LiveCorrection(recording, kept)
        known = RememberingDetector(detector, MAX_FRAMES)

        def on_detections(frame, detections, scores):
            correction.keep(frame)

        def map_into(one: Recording, into: SemanticMap, options: MappingOptions):
            if one is not recording:
                return map_recording(one, into, known, options=options)
            return map_recording(
                one, into, known, options=options, on_detections=on_detections, ahead=1
            )

        semantic_map = create_map(tmp_path / "live.map")
        report = correction.run(semantic_map, map_into, OPTIONS, lines.append)
        assert report.frames == FRAMES
        return semantic_map, correction, kept, lines

    return run


def things(semantic_map: SemanticMap) -> list[tuple[str, np.ndarray]]:
    """Category and position of each thing that is believed, in an order of their own."""
    label = semantic_map.catalogue.label
    found = [(label(o.category), o.p_map) for o in semantic_map.objects(min_existence=0.5)]
    return sorted(found, key=lambda one: (one[0], *np.round(one[1], 1)))


def share_found(expected: list, found: list) -> float:
    """Share of expected things that are found within 0.1 m, with their category."""
    near = [
        any(other == name and np.linalg.norm(p - q) < 0.1 for other, q in found)
        for name, p in expected
    ]
    return float(np.mean(near))


def test_the_map_follows_the_loops(mapped, detector, bag, tmp_path):
    semantic_map, correction, kept, lines = mapped()
    with semantic_map, kept:
        assert correction.corrections >= 1
        assert "the path was corrected by up to" in lines[0] and "objects moved by" in lines[0]
        assert detector.count == FRAMES  # none is looked at twice
        assert correction.recording.tracker.moved <= MOVED
        (record,) = semantic_map.recordings()
        assert record.frames_applied == FRAMES
        assert "while the camera was live" in record.pose_estimate
        found, T = things(semantic_map), correction.recording.T_map_world
        first = kept.recording("live", T).frame(0).T_map_cam
    assert len(found) >= 4

    # `map` of the same images without poses, placed at the same first camera, makes the same map
    options = RecordingOptions(check=False, estimate_poses=True)
    estimated = open_recording(bag, options)
    placed = estimated.placed(first @ np.linalg.inv(estimated.listing.entries[0].T_world_cam))
    with create_map(tmp_path / "map.map") as semantic_map:
        map_recording(placed, semantic_map, detector, options=OPTIONS)
        expected = things(semantic_map)
    assert share_found(expected, found) >= 0.75
    assert share_found(found, expected) >= 0.75

    true = open_recording(bag, RecordingOptions(check=False))
    poses = correction.recording.corrected_poses()
    by_stamp = {round(float(name), 3): T for name, T in poses.items()}
    start, end = true.listing.entries[0], true.listing.entries[-1]
    a, b = (by_stamp[round(e.stamp, 3)] for e in (start, end))
    between = np.linalg.inv(start.T_world_cam) @ end.T_world_cam
    assert motion(np.linalg.inv(a) @ b, between)[0] < 0.08
