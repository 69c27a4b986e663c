"""Two networks as one detector: when each looks, and whose detections are whose."""

import math
from dataclasses import replace

import numpy as np
import pytest

from perception.frames import Detections, Frame
from perception.inference.detector import load_detector
from perception.inference.detector_pair import NEW_ANGLE, NEW_DISTANCE, DetectorPair, joined
from perception.inference.model_zoo import bundled_pair, find_model


class OneThing:
    """Finds one thing in each frame; remembers which frames it saw."""

    def __init__(self, name: str, label: str, score: float) -> None:
        self.name, self.label, self.score = name, label, score
        self.frames: list[str] = []

    def detect(self, frame: Frame) -> Detections:
        self.frames.append(frame.id)
        box = np.array([[1, 2, 3, 4]], dtype=np.float32)
        return Detections(box, np.array([self.score], dtype=np.float32), (self.label,))


def frame(id: str, *, x: float = 0.0, turn: float = 0.0) -> Frame:
    T = np.eye(4)
    T[0, 3] = x
    T[:2, :2] = [[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]]
    rgb = np.zeros((6, 8, 3), dtype=np.uint8)
    return Frame(id, rgb, np.ones((6, 8), np.float32), np.eye(3), T, 0.0)


@pytest.fixture
def first() -> OneThing:
    return OneThing("quick", "cup", 0.4)


@pytest.fixture
def second() -> OneThing:
    return OneThing("slow", "bowl", 0.6)


def test_the_second_looks_from_new_points_of_view_only(first, second):
    pair = DetectorPair(first, second)
    seen = [
        frame("start"),
        frame("still"),
        frame("a little", x=0.9 * NEW_DISTANCE, turn=0.9 * NEW_ANGLE),
        frame("moved", x=1.1 * NEW_DISTANCE),
        frame("back a little", x=0.5 * NEW_DISTANCE),
        frame("turned", x=1.1 * NEW_DISTANCE, turn=1.1 * NEW_ANGLE),
        frame("turned, still", x=1.1 * NEW_DISTANCE, turn=1.1 * NEW_ANGLE),
        frame("back", turn=0.0),
    ]
    found = [pair.detect(one) for one in seen]
    assert first.frames == [one.id for one in seen]
    assert second.frames == ["start", "moved", "turned", "back"]
    assert [len(one) for one in found] == [2, 1, 1, 2, 1, 2, 1, 2]


def test_detections_name_their_network_and_who_looked(first, second):
    pair = DetectorPair(first, second)
    both, alone = pair.detect(frame("new")), pair.detect(frame("known"))
    assert pair.name == "quick and slow"
    assert (both.label, both.source) == (("bowl", "cup"), ("slow", "quick"))
    assert (both.detectors, alone.detectors) == (("quick", "slow"), ("quick",))
    assert both.score == pytest.approx([0.6, 0.4]), "best score first"
    assert both.xyxy.shape == (2, 4)


def test_nothing_joined_is_nothing_but_who_looked():
    none = Detections(np.zeros((0, 4), np.float32), np.zeros(0, np.float32), ())
    found = joined([("quick", none), ("slow", none)])
    assert len(found) == 0 and found.xyxy.shape == (0, 4)
    assert found.detectors == ("quick", "slow")


def test_sources_are_as_many_as_detections():
    with pytest.raises(ValueError, match="source"):
        Detections(np.zeros((1, 4), np.float32), np.zeros(1, np.float32), ("cup",), ("a", "b"))


def test_the_bundled_pair_sees_a_real_kitchen(shared):
    from perception.sources.recording import open_recording
    from perception.sources.recording_options import RecordingOptions

    names = bundled_pair()
    assert len({find_model(name).file for name in names} - {None}) == 2, "both are shipped"
    pair = DetectorPair(*(load_detector(name, threshold=0.3) for name in names))
    options = RecordingOptions(check=False)
    image = next(iter(open_recording(shared("data/rgbd/redkitchen"), options).frames(8)))
    found = pair.detect(image)
    assert found.detectors == names
    assert {"chair", "dining table"} & set(found.label)
    assert set(found.source) == set(names)


def test_a_pair_in_a_pair_keeps_its_networks_names(first, second):
    class Third:
        name = "third"

        def detect(self, frame: Frame) -> Detections:
            return Detections(np.array([[1, 1, 9, 9]], np.float32), np.ones(1, np.float32), ("tv",))

    found = DetectorPair(DetectorPair(first, second), Third()).detect(frame("new"))
    assert found.detectors == ("quick", "slow", "third")
    assert set(found.source) == {"quick", "slow", "third"}


def test_masks_stay_with_their_boxes():
    boxes = np.array([[1, 2, 3, 4], [5, 5, 9, 9]], np.float32)
    mask = np.ones((5, 5), bool)
    masked = Detections(boxes, np.array([0.8, 0.3], np.float32), ("a", "b"), mask=(None, mask))
    plain = Detections(boxes[:1], np.array([0.5], np.float32), ("c",))
    together = joined([("one", masked), ("other", plain)])
    assert together.label == ("a", "c", "b")
    assert together.mask == (None, None, mask)


def test_each_camera_of_a_robot_has_points_of_view_of_its_own(first, second):
    pair = DetectorPair(first, second)
    for n in range(2):
        for camera, turn in (("front", 0.0), ("rear", math.pi)):
            pair.detect(replace(frame(f"{camera} {n}", turn=turn), camera=camera))
    assert second.frames == ["front 0", "rear 0"]
