"""A bag that is played live makes the map that `map` makes of the file, fact by fact."""

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags")
from kg.maps.semantic_map import SemanticMap
from kg.model.vocabulary import MAP_GRAPH
from kg.serving.opening import in_memory_map
from mapping.recording_mapper import map_recording
from perception.frames import Detections, Frame
from perception.sources.bags.bag_file import BagFile, RawMessage
from perception.sources.live import stream
from perception.sources.live.connection import Inbox
from perception.sources.live.live_recording import LiveRecording
from perception.sources.live.stream import FrameStream
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions
from tests.perception.sources.test_bags import robot_bag

DEPTH = "/cam/depth/image_raw"


class Player:
    """Plays messages; the next frame once the one before was taken."""

    address = "player"

    def __init__(self, raws: list[RawMessage]) -> None:
        self._raws = raws
        self.taken: Callable[[], int] = lambda: 0

    def run(self, inbox: Inbox, ended: threading.Event) -> None:
        inbox.wanted({raw.topic: raw.type for raw in self._raws})
        frames = 0
        for raw in self._raws:
            inbox.offer(raw, is_ros1=False)
            if raw.topic == DEPTH:
                frames += 1
                while self.taken() < frames and not ended.wait(0.01):
                    pass
        ended.wait()


class Boxes:
    """A detector that finds a box in the middle of each frame."""

    name = "boxes"

    def detect(self, frame: Frame) -> Detections:
        height, width = frame.depth.shape
        box = [[width * 0.3, height * 0.3, width * 0.6, height * 0.6]]
        return Detections(np.array(box, np.float32), np.array([0.9], np.float32), ("chair",))


def facts(semantic_map: SemanticMap) -> list[str]:
    quads = semantic_map.engine.quads_for_pattern(None, None, None, MAP_GRAPH)
    return sorted(map(str, quads))


def test_live_equals_map(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream, "SETTLING", 0.0)
    monkeypatch.setattr(stream, "SILENT", 0.0)
    monkeypatch.setattr(stream, "PATIENCE", 0.05)
    path = robot_bag(tmp_path / "robot", raised=0.7)
    recording = open_recording(path, RecordingOptions(name="room"))
    with in_memory_map(base="https://example.org/map/") as semantic_map:
        report = map_recording(recording, semantic_map, Boxes())
        expected = facts(semantic_map)
    assert (report.frames, report.objects > 0) == (6, True)
    heights = recording.T_map_world[2, 3]
    assert heights == pytest.approx(-0.7, abs=0.03)

    with BagFile(path) as bag:
        raws: list[Any] = list(bag.messages({topic.name for topic in bag.topics}))
    player, frames = Player(raws), FrameStream("player")
    player.taken = lambda: frames.counts.taken
    live = LiveRecording("room", player, frames, threading.Event(), limit=6)
    live.level()
    assert np.array_equal(live.T_map_world, recording.T_map_world)
    with in_memory_map(base="https://example.org/map/") as semantic_map:
        map_recording(live, semantic_map, Boxes(), ahead=1)
        assert facts(semantic_map) == expected
