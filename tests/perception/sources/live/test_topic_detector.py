"""Detections of another program, with the stamps of their images, as those of frames."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags")
from kg.model.errors import RecordingError
from perception.sources.bag_writer import COLOUR
from perception.sources.bags.bag_file import RawMessage
from perception.sources.live import stream, topic_detector
from perception.sources.live.stream import FrameStream
from perception.sources.live.topic_detector import BOXES, MASKS, SOLIDS, TopicDetector
from perception.sources.recording import FolderRecording
from perception.sources.ros.message_maker import MessageMaker
from perception.sources.ros.message_types import serialised
from tests.perception.sources.live.test_stream import by_frame, offered

Messages = Callable[[str], list[RawMessage]]
TOPIC, CAMERA = "/yolo/detections", "camera_color_optical_frame"


@pytest.fixture(autouse=True)
def settled_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream, "SETTLING", 0.0)
    monkeypatch.setattr(stream, "SILENT", 0.0)
    monkeypatch.setattr(stream, "PATIENCE", 0.05)


def stamp_of(part: list[RawMessage], topic: str = COLOUR) -> int:
    (colour,) = (raw for raw in part if raw.topic == topic)
    sec, nanosec = np.frombuffer(colour.data, "<u4", 2, 4)
    return int(sec) * 10**9 + int(nanosec)


def detections(stamp: int, kind: str, boxes: list[dict[str, Any]], *, is_ros1: bool) -> RawMessage:
    make = MessageMaker(is_ros1)
    header = make.header(stamp, CAMERA)
    made = make.make(kind, header=header, detections=[{"header": header, **b} for b in boxes])
    encoding = "ros1" if is_ros1 else "cdr"
    return RawMessage(TOPIC, kind, stamp, serialised(kind, made, is_ros1=is_ros1), encoding)


def box(label: str, score: float, *, is_ros1: bool) -> dict[str, Any]:
    """A box of 10 x 6 px about (12, 8)."""
    centre: dict[str, Any] = (
        {"x": 12.0, "y": 8.0} if is_ros1 else {"position": {"x": 12.0, "y": 8.0}}
    )
    kind = {"id": int(label)} if is_ros1 else {"hypothesis": {"class_id": label, "score": score}}
    result = kind | ({"score": score} if is_ros1 else {})
    return {"bbox": {"center": centre, "size_x": 10.0, "size_y": 6.0}, "results": [result]}


@pytest.mark.parametrize("is_ros1", [True, False])
def test_boxes_are_those_of_the_image_with_their_stamp(messages: Messages, is_ros1: bool) -> None:
    first, second, third, *_ = by_frame(messages(".bag"))
    detector = TopicDetector(TOPIC, 0.3)
    made = FrameStream("peer", detections=detector)
    assert TOPIC in made.wanted({TOPIC: BOXES})
    offered(made, [*first, *second])
    assert made.next_frame(0.2) is None  # without detections no frame, however complete
    sure, unsure = (box("47", score, is_ros1=is_ros1) for score in (0.75, 0.1))
    made.offer(detections(stamp_of(first), BOXES, [unsure, sure], is_ros1=is_ros1), is_ros1=is_ros1)
    frame = made.next_frame(5)
    assert frame is not None and float(frame.id) == pytest.approx(stamp_of(first) / 1e9, abs=1e-6)
    found = detector.detect(frame)
    assert found.label == ("47",)
    assert found.xyxy.tolist() == [[7, 5, 17, 11]]
    assert found.score.tolist() == [0.75]
    offered(made, third)
    made.offer(detections(stamp_of(third), BOXES, [], is_ros1=is_ros1), is_ros1=is_ros1)
    empty = made.next_frame(5)
    assert empty is not None and not len(detector.detect(empty).label)
    assert made.counts.taken == 2


def test_a_box_in_space_counts_as_its_outline(room: FolderRecording, messages: Messages) -> None:
    first, *_ = by_frame(messages(".bag"))
    detector = TopicDetector(TOPIC)
    made = offered(FrameStream("peer", detections=detector), first)
    at = {"center": {"position": {"z": 2.0}}, "size": {"x": 0.2, "y": 0.1, "z": 1e-6}}
    behind = {"center": {"position": {"z": -2.0}}, "size": {"x": 0.2, "y": 0.1, "z": 0.1}}
    result = [{"hypothesis": {"class_id": "cup", "score": 0.5}}]
    boxes = [{"bbox": one, "results": result} for one in (at, behind)]
    made.offer(detections(stamp_of(first), SOLIDS, boxes, is_ros1=False), is_ros1=False)
    frame = made.next_frame(5)
    assert frame is not None
    (fx, cx), (fy, cy) = ((frame.K[i, i], frame.K[i, 2]) for i in (0, 1))
    height, width = frame.depth.shape
    outline = [cx - 0.05 * fx, cy - 0.025 * fy, cx + 0.05 * fx, cy + 0.025 * fy]
    limits = np.clip(outline, 0, [width, height, width, height])
    assert detector.detect(frame).xyxy[0] == pytest.approx(limits, abs=0.01)
    assert detector.detect(frame).label == ("cup",)


def test_a_storm_of_detections_is_bounded_and_told_once(messages, caplog):
    first, second, *_ = by_frame(messages(".bag"))
    detector = TopicDetector(TOPIC)
    made = FrameStream("peer", detections=detector)
    for part in (first, second):
        offered(made, part)
        scores = np.linspace(0.1, 0.9, 1000)
        storm = [box("1", float(score), is_ros1=False) for score in scores]
        made.offer(detections(stamp_of(part), BOXES, storm, is_ros1=False), is_ros1=False)
        frame = made.next_frame(5)
        assert frame is not None
        found = detector.detect(frame)
        assert len(found.label) == topic_detector.MAX_DETECTIONS
        assert found.score[0] == pytest.approx(0.9)
    assert caplog.text.count("1000 detections of one image") == 1
    with pytest.raises(RecordingError, match="no detections of /yolo/detections"):
        detector.detect(type(frame)("other", frame.rgb, frame.depth, frame.K, frame.T_map_cam, 0))


def test_senseless_detections_are_left_out(messages: Messages) -> None:
    first, *_ = by_frame(messages(".bag"))
    detector = TopicDetector(TOPIC)
    made = offered(FrameStream("peer", detections=detector), first)
    nan = float("nan")
    boxes = [box("1", score, is_ros1=False) for score in (nan, 7.0, -1.0)]
    boxes += [{**box("1", 0.5, is_ros1=False), "results": []}]
    boxes += [{**box("1", 0.5, is_ros1=False), "bbox": {"size_x": nan, "size_y": 1e300}}]
    boxes += [{**box("1", 0.5, is_ros1=False), "bbox": {"size_x": -5.0, "size_y": 5.0}}]
    made.offer(detections(stamp_of(first), BOXES, boxes, is_ros1=False), is_ros1=False)
    frame = made.next_frame(5)
    assert frame is not None and not len(detector.detect(frame).label)


def test_a_mask_is_its_outline_filled(messages: Messages) -> None:
    first, *_ = by_frame(messages(".bag"))
    detector = TopicDetector(TOPIC, 0.3)
    made = offered(FrameStream("peer", detections=detector), first)
    bbox = {"center": {"position": {"x": 12.0, "y": 8.0}}, "size": {"x": 10.0, "y": 6.0}}
    corners = [(7.0, 5.0), (17.0, 5.0), (7.0, 11.0)]  # half of the box
    mask = {"data": [{"x": x, "y": y} for x, y in corners]}
    cup = {"class_name": "cup", "class_id": 41, "score": 0.75, "bbox": bbox}
    boxes = [
        {**cup, "class_name": "bowl", "score": 0.5},
        {**cup, "mask": mask},
        {**cup, "score": 0.1},
        {**cup, "mask": {"data": [{"x": float("nan")}]}},
    ]
    make = MessageMaker(is_ros1=False)
    sent = make.make(MASKS, header=make.header(stamp_of(first), CAMERA), detections=boxes)
    data = serialised(MASKS, sent, is_ros1=False)
    made.offer(RawMessage(TOPIC, MASKS, stamp_of(first), data, "cdr"), is_ros1=False)
    frame = made.next_frame(5)
    assert frame is not None
    found = detector.detect(frame)
    assert found.label == ("cup", "bowl") and found.score.tolist() == [0.75, 0.5]
    assert found.xyxy.tolist() == [[7, 5, 17, 11]] * 2
    of_cup, of_bowl = found.mask
    assert of_cup is not None and of_bowl is None
    assert of_cup.shape == (7, 11) and of_cup[0].all() and of_cup[:, 0].all()
    assert not of_cup[-1, 1:].any() and 0.5 < of_cup.mean() < 0.65
