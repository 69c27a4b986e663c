"""Several cameras of one stream: each has its turn, its topics and its counts."""

from collections.abc import Callable
from dataclasses import replace

import pytest

pytest.importorskip("rosbags")
from kg.model.errors import RecordingError
from perception.sources.bag_writer import COLOUR, DEPTH, IMAGE_TOPICS
from perception.sources.bags.bag_file import RawMessage
from perception.sources.live import cameras, stream
from perception.sources.live.cameras import CameraStreams
from perception.sources.live.topic_detector import BOXES, TopicDetector
from perception.sources.recording_options import RecordingOptions
from tests.perception.sources.live.test_stream import by_frame
from tests.perception.sources.live.test_topic_detector import box, detections, stamp_of

Parts = list[list[RawMessage]]


@pytest.fixture(autouse=True)
def settled_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    for module, name in ((stream, "SETTLING"), (stream, "SILENT"), (cameras, "ABSENT")):
        monkeypatch.setattr(module, name, 0.0)
    monkeypatch.setattr(stream, "PATIENCE", 0.05)


@pytest.fixture
def parts(messages: Callable[[str], list[RawMessage]]) -> Parts:
    """Messages of each frame, whose images come from two cameras, /front/... and /rear/..."""

    def twice(raw: RawMessage) -> list[RawMessage]:
        if raw.topic not in IMAGE_TOPICS:
            return [raw]
        return [replace(raw, topic=f"/{of}/{raw.topic[8:]}") for of in ("front", "rear")]

    return [[one for raw in part for one in twice(raw)] for part in by_frame(messages(".bag"))]


def begun(names: list[str], part: list[RawMessage]) -> CameraStreams:
    made = CameraStreams("peer", names, RecordingOptions())
    wanted = made.wanted({raw.topic: raw.type for raw in part})
    offer(made, [raw for raw in part if raw.topic in wanted])
    return made


def offer(made: CameraStreams, part: list[RawMessage]) -> None:
    for raw in part:
        made.offer(raw, is_ros1=True)


FRONT, REAR = (f"/{name}{COLOUR.removeprefix('/camera')}" for name in ("front", "rear"))


@pytest.mark.parametrize("names", [["front", "rear"], [FRONT, "rear"], ["front"], [FRONT, REAR]])
def test_cameras_give_frames_by_turns_though_each_has_a_newer_one(names, parts):
    made, given = begun(names, parts[0]), []
    for part in parts[1:]:
        frame = made.next_frame(5)
        assert frame is not None, made.problem
        given.append(frame)
        offer(made, part)  # both have a newer frame now
    assert [frame.camera for frame in given] == (names * 5)[:5]
    labels = [name.strip("/").replace("/", "_") for name in names]
    assert all(frame.id.startswith(labels[i % len(names)]) for i, frame in enumerate(given))
    for one, name in zip(made.cameras, names, strict=True):
        choice, of = one.choice, "front" if "front" in name else "rear"
        assert choice is not None and choice.colour.topic.startswith(f"/{of}/color/")
        assert choice.depth.topic.startswith(f"/{of}/") and "depth" in choice.depth.topic
        assert one.counts.received == 6
        assert one.counts.taken == sum(frame.camera == name for frame in given)
    assert made.counts.received == 6 * len(names) and made.counts.taken == 5


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (["front", "raer"], "no camera raer; did you mean rear.*there are: /front/.*, /rear/"),
        (["front", "/rear/color"], "no camera /rear/color.*there are: /front/.*, /rear/"),
        (["front", "front/"], "camera front is given twice"),
        (["front", "front@1"], "camera front is given twice"),
        (["front@0"], "camera front@0: front@2, for 2 frames a second, would work"),
        (["front@fast"], "camera front@fast: front@2, "),
        (["front", FRONT], f"cameras front and {FRONT} are both of /front/"),
    ],
)
def test_cameras_that_are_not_there_or_one_are_refused(names, said, parts):
    with pytest.raises(RecordingError, match=said) as caught:
        begun(names, parts[0]).next_frame(5)
    assert "\n" not in str(caught.value)


def test_a_camera_gives_no_more_frames_than_its_rate(parts: Parts) -> None:
    made, given = begun(["front@0.05", "rear"], parts[0]), list[str]()
    for part in (*parts[1:4], []):
        while (frame := made.next_frame(1.0)) is not None:
            given.append(frame.camera)
        offer(made, part)
    assert given[0] == "front" and set(given[1:]) == {"rear"} and len(given) > 2


def test_depth_is_that_of_the_same_camera_or_of_none(parts: Parts) -> None:
    both = f"/front{DEPTH.removeprefix('/camera')}"
    one_depth = [raw for raw in parts[0] if "depth" not in raw.topic or raw.topic == both]
    with pytest.raises(RecordingError, match=f"cameras {FRONT} and {REAR} are both of {both}"):
        begun([FRONT, REAR], one_depth).next_frame(5)
    made = begun(["front", "rear"], one_depth)
    frame = made.next_frame(5)
    assert frame is not None and frame.camera == "front"
    assert "camera rear: peer has no depth images" in made.problem and "--" not in made.problem


def test_each_camera_has_its_own_topic_of_detections(parts: Parts) -> None:
    both = TopicDetector("/{camera}/yolo", 0.2)
    made = CameraStreams("peer", ["front", "rear"], RecordingOptions(), both)
    topics = {raw.topic: raw.type for raw in parts[0]}
    topics |= {f"/{name}/yolo": BOXES for name in ("front", "rear")}
    assert {"/front/yolo", "/rear/yolo"} <= made.wanted(topics)
    stamp = stamp_of([raw for raw in parts[0] if raw.topic == FRONT], FRONT)
    told = {"front": [0.9, 0.8], "rear": [0.7]}
    for name, scores in told.items():
        boxes = [box("1", score, is_ros1=True) for score in scores]
        message = detections(stamp, BOXES, boxes, is_ros1=True)
        made.offer(replace(message, topic=f"/{name}/yolo"), is_ros1=True)
    offer(made, parts[0])
    for name, scores in told.items():
        frame = made.next_frame(5)
        assert frame is not None and frame.camera == name, made.problem
        assert both.detect(frame).score.tolist() == pytest.approx(scores)
