"""Messages become frames by the rules of bags; the newest first, and each one that came counted."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("rosbags")
from perception.frames import Frame
from perception.sources.bag_writer import COLOUR, COLOUR_INFO, DEPTH, DEPTH_INFO, NOTE_TOPIC
from perception.sources.bags.bag_file import RawMessage
from perception.sources.listing import Streams
from perception.sources.live import connection, stream
from perception.sources.live.stream import FrameStream
from perception.sources.recording_options import RecordingOptions
from perception.sources.ros.message_maker import MessageMaker
from perception.sources.ros.message_types import message_types, serialised
from tests.perception.conftest import K
from tests.perception.sources.robot_bags import VIEWS, raw_image

Messages = Callable[[str], list[RawMessage]]
Begun = tuple[FrameStream, list[list[RawMessage]]]


@pytest.fixture(autouse=True)
def settled_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream, "SETTLING", 0.0)
    monkeypatch.setattr(stream, "SILENT", 0.0)
    monkeypatch.setattr(stream, "PATIENCE", 0.05)


def by_frame(raws: list[RawMessage]) -> list[list[RawMessage]]:
    """Messages before the first image and with it, then those with each further one."""
    starts = [i for i, raw in enumerate(raws) if raw.topic == "/tf"]
    ends = [*starts[1:], len(raws)]
    parts = [raws[a:b] for a, b in zip(starts, ends, strict=True)]
    return [raws[: starts[0]] + parts[0], *parts[1:]]


def offered(made: FrameStream, raws: list[RawMessage], *, is_ros1: bool = True) -> FrameStream:
    made.wanted({raw.topic: raw.type for raw in raws})
    for raw in raws:
        made.offer(raw, is_ros1=is_ros1)
    return made


def taken(made: FrameStream, seconds: float = 5) -> Frame:
    frame = made.next_frame(seconds)
    assert frame is not None, made.problem
    return frame


@pytest.fixture
def begun(messages: Messages) -> Begun:
    """A stream that has given its first frame, and the messages of the others."""
    first, *rest = by_frame(messages(".bag"))
    made = offered(FrameStream("peer"), first)
    taken(made)
    return made, rest


@pytest.fixture
def uneven(begun: Begun) -> tuple[FrameStream, RawMessage, RawMessage]:
    """Depth came 15 ms before its colour image: the stream, and the messages of both."""
    made, (second, *_) = begun
    colour, depth = (next(r for r in second if r.topic == topic) for topic in (COLOUR, DEPTH))
    offered(made, [raw for raw in second if raw.topic not in (COLOUR, DEPTH)])
    offered(made, [moved(depth, milliseconds=-15), colour])
    return made, colour, depth


@pytest.mark.parametrize(("suffix", "is_ros1"), [(".bag", True), (".mcap", False)])
def test_frames_are_those_of_the_recording(room, messages, suffix, is_ros1):
    made = FrameStream("peer")
    for part, frame in zip(by_frame(messages(suffix)), room.frames(), strict=True):
        offered(made, part, is_ros1=is_ros1)
        ours = taken(made)
        assert np.array_equal(ours.rgb, frame.rgb)
        assert np.array_equal(ours.depth, frame.depth, equal_nan=True)
        assert np.array_equal(ours.K, frame.K)
        assert np.allclose(ours.T_map_cam, frame.T_map_cam, atol=1e-12)
    assert made.next_frame(0) is None
    assert made.counts.taken == made.counts.received == 6


@pytest.mark.parametrize("is_ros1", [True, False])
def test_rtabmaps_images_in_one_message_are_frames(is_ros1: bool) -> None:
    maker, kind, view = MessageMaker(is_ros1), "rtabmap_msgs/msg/RGBDImage", VIEWS[2]
    header = maker.header(round(view.stamp * 1e9), "lens")
    info = maker.camera_info(K, view.depth.shape, header)
    images = {"rgb": raw_image(view.rgb, "rgb8"), "depth": raw_image(view.depth, "16UC1")}
    infos = {"rgb_camera_info": info, "depth_camera_info": info}
    whole = maker.make(kind, header=header, **images, **infos)
    transforms = maker.transforms(round(view.stamp * 1e9), "map", "lens", view.T)
    sent = (("/tf", "tf2_msgs/msg/TFMessage", transforms), ("/rgbd_image", kind, whole))
    messages = [RawMessage(t, k, 0, serialised(k, m, is_ros1=is_ros1)) for t, k, m in sent]
    messages[1] = replace(messages[1], data=messages[1].data + bytes(60))  # features
    made = FrameStream("peer")
    assert made.wanted({t: k for t, k, _ in sent}) == {"/tf", "/rgbd_image"}
    frame = taken(offered(made, messages, is_ros1=is_ros1))
    assert made.wanted({t: k for t, k, _ in sent}) == {"/tf", "/rgbd_image"}
    assert np.array_equal(frame.rgb, view.rgb)
    assert np.array_equal(np.nan_to_num(frame.depth * 1000).round(), view.depth)


Link = Callable[..., RawMessage]


def frame_and_links() -> tuple[RawMessage, Link]:
    """A frame of VIEWS[2] in one message, and a maker of links: parent, child, pose, "_static"."""
    maker, view = MessageMaker(True), VIEWS[2]
    stamp = round(view.stamp * 1e9)
    header = maker.header(stamp, "lens")
    images = {"rgb": raw_image(view.rgb, "rgb8"), "depth": raw_image(view.depth, "16UC1")}
    info = maker.camera_info(K, view.depth.shape, header)
    infos = {"rgb_camera_info": info, "depth_camera_info": info}
    whole = maker.make("rtabmap_msgs/msg/RGBDImage", header=header, **images, **infos)

    def link(parent: str, child: str, T: np.ndarray, static: str = "") -> RawMessage:
        kind, message = "tf2_msgs/msg/TFMessage", maker.transforms(stamp, parent, child, T)
        return RawMessage(f"/tf{static}", kind, 0, serialised(kind, message, is_ros1=True))

    data = serialised("rtabmap_msgs/msg/RGBDImage", whole, is_ros1=True)
    return RawMessage("/rgbd_image", "rtabmap_msgs/msg/RGBDImage", 0, data), link


def test_two_mounts_of_a_camera_that_contradict_are_told(caplog: pytest.LogCaptureFixture) -> None:
    (image, link), beside = frame_and_links(), np.eye(4)
    beside[0, 3] = 0.3
    mounts = [link("base", "lens", T, "_static") for T in (beside, np.eye(4))]
    made = offered(FrameStream("peer"), [*mounts, link("odom", "base", VIEWS[2].T), image])
    assert np.allclose(taken(made).T_map_cam, VIEWS[2].T, atol=1e-6)
    assert "base -> lens contradict each other by 0.30 m" in caplog.text
    assert "--camera-in base=" in caplog.text


def test_a_link_may_come_after_both_of_its_frames_are_known() -> None:
    (image, link), view = frame_and_links(), VIEWS[2]
    early = [link("base", "lens", np.eye(4), "_static"), link("map", "odom", np.eye(4)), image]
    made = offered(FrameStream("peer"), early)
    made.offer(link("odom", "wheel", np.eye(4)), is_ros1=True)
    made.offer(link("base", "wheel", np.eye(4)), is_ros1=True)
    assert made.next_frame(0) is None
    assert "none reach the camera" in made.problem
    assert made.next_frame(0) is None
    made.offer(link("odom", "base", view.T), is_ros1=True)
    frame = taken(made)
    assert np.allclose(frame.T_map_cam, view.T, atol=1e-6)


def test_the_newest_frame_comes_first_and_older_ones_count_as_dropped(room, messages):
    made = offered(FrameStream("peer"), messages(".bag"))
    assert np.array_equal(taken(made).rgb, room.frame(5).rgb)
    assert made.next_frame(0) is None
    assert (made.counts.received, made.counts.taken, made.counts.dropped) == (6, 1, 5)


def test_what_waits_is_bounded(messages: Messages, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection, "HELD", 3)
    raws = messages(".bag")
    made = offered(FrameStream("peer"), raws)
    colours = [raw for raw in raws if raw.topic == COLOUR]
    for raw in colours * 10:  # depth never comes
        made.offer(raw, is_ros1=True)
    assert sum(len(held.images) for held in made._held.values()) <= 6
    taken(made)
    assert made.counts.received == 66
    assert made.counts.dropped + made.counts.without_depth == 65


def test_images_without_depth_or_pose_are_counted_as_such(begun: Begun) -> None:
    made, rest = begun
    for i, part in enumerate(rest):
        for raw in part:
            no_depth = i == 0 and raw.topic == DEPTH
            no_pose = i == 2 and raw.topic == "/tf"
            if not (no_depth or no_pose):
                made.offer(raw, is_ros1=True)
        made.next_frame(1 if i != 2 else 0.2)
    counts = made.counts
    assert (counts.received, counts.without_depth) == (6, 1)
    assert counts.without_pose <= 1  # tf may be interpolated
    assert counts.taken + counts.without_depth + counts.without_pose + counts.dropped == 6


def test_a_pose_beyond_the_last_transform_is_waited_for(begun: Begun) -> None:
    made, (second, *_) = begun
    offered(made, [raw for raw in second if raw.topic != "/tf"])
    assert made._newest() is None
    offered(made, [raw for raw in second if raw.topic == "/tf"])
    taken(made)


def test_a_nearer_depth_image_is_waited_for(uneven, monkeypatch):
    monkeypatch.setattr(stream, "PATIENCE", 60.0)
    made, colour, depth = uneven
    assert made._newest() is None  # a nearer one may come
    offered(made, [moved(depth, milliseconds=5)])
    assert made._newest() is None  # and a colour image that is nearer to that one
    offered(made, [moved(colour, milliseconds=40)])
    entry = made._newest()
    assert entry.depth.seconds == pytest.approx(entry.stamp + 0.005)


def test_a_nearer_depth_image_is_not_waited_for_without_end(uneven, monkeypatch):
    monkeypatch.setattr(stream, "PATIENCE", 0.0)
    entry = uneven[0]._newest()
    assert entry.depth.seconds == pytest.approx(entry.stamp - 0.015)


def test_a_depth_image_makes_one_frame(begun: Begun) -> None:
    made, (second, *_) = begun
    colour = next(raw for raw in second if raw.topic == COLOUR)
    offered(made, [*second, moved(colour, milliseconds=10), moved(colour, milliseconds=500)])
    taken(made)
    assert made.next_frame(1) is None
    assert made.counts.taken == 2


def test_topics_are_those_of_the_options(messages: Messages) -> None:
    raws = messages(".bag")
    other = [replace(raw, topic="/rear/color") for raw in raws if raw.topic == COLOUR]
    types = {raw.topic: raw.type for raw in [*raws, *other]}
    streams = Streams(colour="/rear/color", depth=DEPTH, camera=COLOUR_INFO)
    given = FrameStream("peer", RecordingOptions(streams=streams))
    assert COLOUR not in given.wanted(types)
    offered(given, [raw for raw in [*raws, *other] if raw.topic in given.wanted(types)])
    taken(given)
    wanted = {"/rear/color", DEPTH, COLOUR_INFO, DEPTH_INFO, "/tf", "/tf_static", NOTE_TOPIC}
    assert given.wanted(types) == wanted - {NOTE_TOPIC}


def test_a_camera_that_changes_is_taken(begun: Begun, caplog: pytest.LogCaptureFixture) -> None:
    made, (second, third, fourth, *_) = begun
    offered(made, second)
    before = taken(made)

    def zoomed(raw: RawMessage) -> RawMessage:
        if raw.topic != COLOUR_INFO:
            return raw
        types = message_types(True)
        info = types.deserialize_ros1(raw.data, raw.type)
        K = info.K * [1.25, 1, 1, 1, 1.25, 1, 1, 1, 1]
        return replace(raw, data=bytes(types.serialize_ros1(replace(info, K=K), raw.type)))

    offered(made, third)
    same = taken(made)
    assert np.array_equal(same.K, before.K)
    assert "has changed" not in caplog.text
    offered(made, [zoomed(raw) for raw in fourth])
    after = taken(made)
    assert after.K[0, 0] == pytest.approx(1.25 * before.K[0, 0])
    assert after.stamp > same.stamp
    assert caplog.text.count("has changed") == 1


def test_a_colour_image_of_another_frame_is_told_and_has_that_frames_pose(begun, caplog):
    made, (second, *_) = begun
    types = message_types(True)

    def renamed(raw: RawMessage) -> RawMessage:
        message = types.deserialize_ros1(raw.data, raw.type)
        if raw.topic == COLOUR:
            message = replace(message, header=replace(message.header, frame_id="tilted"))
        elif raw.topic == "/tf":
            (one,) = message.transforms
            up = replace(one.transform.translation, z=one.transform.translation.z + 1)
            tilted = replace(one.transform, translation=up)
            both = [one, replace(one, child_frame_id="tilted", transform=tilted)]
            message = replace(message, transforms=both)
        else:
            return raw
        return replace(raw, data=bytes(types.serialize_ros1(message, raw.type)))

    offered(made, [renamed(raw) for raw in second])
    after = taken(made)
    camera = "camera_color_optical_frame"
    plain = made._index.tree.at("world", camera, float(after.id))
    assert plain is not None
    T = made.noted_transform if made.noted_transform is not None else np.eye(4)
    assert (np.linalg.inv(T) @ after.T_map_cam)[2, 3] == pytest.approx(plain[2, 3] + 1)
    assert f"of the frame 'tilted' now, not of '{camera}'" in caplog.text


def test_transforms_that_come_late_are_waited_for_longer(begun: Begun) -> None:
    made, (second, *_) = begun
    for number in range(6):  # transforms come 0.4 s after their images, 8 times the patience
        later = [moved(raw, number + 1) for raw in second if raw.topic != "/tf_static"]
        offered(made, [raw for raw in later if raw.topic != "/tf"])
        made.next_frame(0.4)
        offered(made, [raw for raw in later if raw.topic == "/tf"])
        made.next_frame(0)
    counts = made.counts
    assert (counts.without_pose, counts.taken) == (1, 6)  # then they are waited for


def test_what_is_missing_is_said(messages: Messages) -> None:
    made = offered(FrameStream("peer"), [r for r in messages(".bag") if r.topic != DEPTH])
    assert made.next_frame(0) is None
    assert "no depth images" in made.problem
    made = offered(FrameStream("peer"), [r for r in messages(".bag") if r.topic != COLOUR_INFO])
    taken(made)  # depth's CameraInfo is of the same frame


def test_damaged_messages_are_skipped(messages: Messages, caplog: pytest.LogCaptureFixture) -> None:
    raws = messages(".bag")
    made = offered(FrameStream("peer"), raws)
    taken(made)
    for spoilt in (lambda data: data[: len(data) // 2], lambda _: b"\xff" * 300, lambda _: b""):
        offered(made, [replace(raw, data=spoilt(raw.data)) for raw in raws])
    while made.next_frame(0.2) is not None:
        pass
    assert made.counts.taken == 1
    assert "skipped" in caplog.text
    offered(made, [replace(raw) for raw in raws])  # and what is whole is taken again
    taken(made)


def test_time_that_goes_back_begins_anew(messages: Messages) -> None:
    """A simulation that is started again: poses are not made of transforms of before."""
    raws = messages(".bag")
    later = [moved(raw, 100) for raw in raws if raw.topic not in ("/tf_static", NOTE_TOPIC)]
    made = offered(FrameStream("peer"), [*raws, *later])
    assert taken(made).id.startswith("100.")
    again = [raw for raw in raws if raw.topic != "/tf"]
    offered(made, [raw for raw in raws if raw.topic == "/tf"][:1])
    first, last = made._index.tree.span("world", "camera_color_optical_frame") or (0, 9)
    assert first == last < 1
    offered(made, again)
    assert taken(made).id.startswith("0.")


def moved(raw: RawMessage, seconds: int = 0, milliseconds: int = 0) -> RawMessage:
    """The message, so much later."""
    types = message_types(True)
    message = types.deserialize_ros1(raw.data, raw.type)
    headers = [t.header for t in message.transforms] if raw.topic == "/tf" else [message.header]
    for header in headers:
        passed = header.stamp.nanosec + milliseconds * 1_000_000
        sec = header.stamp.sec + seconds + passed // 10**9
        header.stamp = replace(header.stamp, sec=sec, nanosec=passed % 10**9)
    return replace(raw, data=bytes(types.serialize_ros1(message, raw.type)))


def test_all_that_waits_is_bounded_in_size(messages, monkeypatch):
    raws = [raw for raw in messages(".bag") if raw.topic == DEPTH]
    most = 3 * len(raws[0].data)
    monkeypatch.setattr(stream, "MAX_BYTES", most)
    made = FrameStream("peer")
    for number in range(20):
        offered(made, [replace(raw, topic=f"/depth_{number}") for raw in raws])
    assert 0 < sum(held.size for held in made._held.values()) <= most
