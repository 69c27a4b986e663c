"""A live camera without poses is tracked; where it is lost, nothing is given to be mapped."""

import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from queue import SimpleQueue
from time import sleep
from types import SimpleNamespace

import hypothesis
import numpy as np
import pytest
from hypothesis import strategies as st

pytest.importorskip("rosbags")
from kg.model.errors import LayoutError
from kg.serving.opening import create_map
from mapping.alignment.relocalisation import recognised_live
from mapping.mapping_options import MappingOptions
from mapping.recording_mapper import map_recording
from perception.camera.poses import motion
from perception.frames import Detections, Frame
from perception.odometry.tracking import Odometry
from perception.sources.bag_writer import write_bag
from perception.sources.bags.bag_file import BagFile, RawMessage
from perception.sources.bags.bag_index import NOTE_TOPIC, TRANSFORMS
from perception.sources.live import live_tracker, stream
from perception.sources.live.connection import Inbox
from perception.sources.live.live_recording import LiveRecording
from perception.sources.live.live_tracker import LiveTracker
from perception.sources.live.stream import FrameStream
from perception.sources.recording import FolderRecording, open_recording
from perception.sources.recording_options import RecordingOptions, Selection
from tests.perception.box_room import papered_frame, pose

ROOM = "data/rgbd/icl_livingroom"
FRAMES = 24
OPTIONS = MappingOptions(occupancy=False, check_poses=False, surface=None, pictures=False)


class Player:
    """Plays a bag's messages without its transforms; each image once the one before was tracked."""

    address = "player"

    def __init__(self, path: Path) -> None:
        with BagFile(path) as bag:
            wanted = [topic for topic in bag.topics if topic.name != NOTE_TOPIC]
            topics = {topic.name for topic in wanted if topic.type not in TRANSFORMS}
            self._raws: list[RawMessage] = list(bag.messages(topics))
        self.taken: Callable[[], int] = lambda: 0

    def run(self, inbox: Inbox, ended: threading.Event) -> None:
        inbox.wanted({raw.topic: raw.type for raw in self._raws})
        frames = 0
        for raw in self._raws:
            inbox.offer(raw, is_ros1=False)
            if raw.type == "sensor_msgs/msg/Image":
                frames += 1
                while self.taken() < frames and not ended.wait(0.01):
                    pass
        ended.wait()


class Nothing:
    """A detector that finds nothing."""

    name = "nothing"

    def detect(self, frame: Frame) -> Detections:
        return Detections(np.zeros((0, 4), np.float32), np.zeros(0, np.float32), ())


@pytest.fixture
def live(shared, tmp_path, monkeypatch):
    """Callable: first frame, number -> live images without poses, and the same with true ones."""
    for name in ("SETTLING", "SILENT", "UNPOSED"):
        monkeypatch.setattr(stream, name, 0.0)
    monkeypatch.setattr(stream, "PATIENCE", 0.05)

    def make(first: int, limit: int | None) -> tuple[LiveRecording, FolderRecording]:
        options = RecordingOptions(check=False, selection=Selection(limit=first + FRAMES))
        truth = open_recording(shared(ROOM), options)
        entries = truth.listing.entries[first:]
        truth = replace(truth, listing=replace(truth.listing, entries=entries))
        path = tmp_path / f"{first}.mcap"
        assert len(list(write_bag(truth, path))) == len(truth)
        frames, player = FrameStream("player"), Player(path)
        player.taken = lambda: frames.counts.taken
        live = LiveRecording("live", player, frames, threading.Event(), limit, idle=3.0)
        return live, open_recording(path, RecordingOptions(check=False))

    return make


def test_a_stream_without_poses_is_tracked(live, caplog):
    recording, truth = live(0, None)
    recording.level()
    found = list(recording.frames())
    assert recording.tracker is not None
    assert "estimated" in caplog.text
    assert recording.tracker.tracked == FRAMES
    assert 2 <= len(found) <= FRAMES
    true = {
        round(entry.stamp, 3): truth.T_map_world @ entry.T_world_cam
        for entry in truth.listing.entries
    }
    first = found[0]
    for frame in found:
        far, turned = motion(
            np.linalg.inv(true[round(float(first.id), 3)]) @ true[round(float(frame.id), 3)],
            np.linalg.inv(first.T_map_cam) @ frame.T_map_cam,
        )
        assert far < 0.05
        assert turned < np.deg2rad(2)
    assert abs(first.T_map_cam[2, 3] - true[round(float(first.id), 3)][2, 3]) < 0.15, (
        "over the floor"
    )
    assert recording.tracker.moved < 0.1


def played(images: list[Frame]) -> LiveTracker:
    """A tracker that has one image after the other, and then no more."""
    left = iter(images)
    return LiveTracker("player", lambda _: next(left, None))


def given(tracker: LiveTracker, count: int) -> list[str]:
    """Ids of the images that a tracker gives, image by image."""
    found = []
    for _ in range(count):
        tracker.step()
        frame = tracker.next_frame(0.0)
        found += [] if frame is None else [frame.id]
    return found


@pytest.fixture(scope="module")
def images(shared: Callable[[str], Path]) -> Callable[[str, int], list[Frame]]:
    """Callable: recording, number -> its first images, without poses."""

    def read(name: str, count: int) -> list[Frame]:
        options = RecordingOptions(check=False, selection=Selection(limit=count))
        recording = open_recording(shared(name), options)
        return [replace(frame, T_map_cam=np.eye(4)) for frame in recording.frames()]

    return read


def test_a_lost_camera_pauses_until_it_is_found(images, caplog):
    room = images(ROOM, 20)
    dark = [replace(f, rgb=f.rgb * 0, id=f"dark-{n}") for n, f in enumerate(room[:7])]
    again = [replace(f, id=f"again-{n}") for n, f in enumerate(room[9::-1])]
    tracker = played([*room[:10], *dark, *again])
    assert given(tracker, 10) == [frame.id for frame in room[:10]]
    tracker.hold()
    assert given(tracker, 7) == []
    assert "the camera is lost; mapping pauses" in caplog.text
    assert given(tracker, 10) == [frame.id for frame in again]
    assert "found after 7 images" in caplog.text
    assert (tracker.tracked, tracker.lost) == (20, 7)


def test_mapping_waits_for_tracking_that_is_behind_but_not_for_ever(images, monkeypatch):
    room, queue, clock = images(ROOM, 20), SimpleQueue[Frame | None](), SimpleNamespace(now=100.0)
    monkeypatch.setattr(live_tracker.time, "monotonic", lambda: clock.now)
    tracker = LiveTracker("live", lambda _: queue.get())
    tracker.start(room[0])

    def add(*frames: Frame | None) -> None:
        for frame in frames:
            queue.put(frame)
        while not queue.empty():
            sleep(0.01)

    add(room[1])
    assert tracker.next_frame(0.0) is None  # one image in a second is behind
    clock.now += 1.0
    assert tracker.next_frame(0.0) is not None
    clock.now += 1.0
    add(*room[2:16])  # ten a second
    assert tracker.next_frame(0.0) is not None
    clock.now += 1.0
    add(room[16])
    assert tracker.next_frame(0.0) is None
    add(None)  # none waits: the camera is slow
    assert tracker.next_frame(0.0) is not None
    tracker.close()


def test_another_room_is_not_given_as_part_of_the_first(images):
    tracker = played([*images(ROOM, 6), *images("data/rgbd/redkitchen", 6)])
    assert len(given(tracker, 6)) == 6
    tracker.hold()
    assert given(tracker, 6) == []


def test_a_piece_that_is_joined_to_an_older_one_is_mapped_on_where_it_was(shared, images):
    truth = open_recording(shared(ROOM), RecordingOptions(check=False))
    true = {entry.id: entry.T_world_cam for entry in truth.listing.entries}
    room = images(ROOM, 71)
    dark = [replace(room[0], rgb=room[0].rgb * 0, id=f"dark-{n}") for n in range(16)]
    tracker = played(
        [*room[:6], *dark, *room[:5:-1], *(replace(f, id="again") for f in room[5::-1])]
    )
    assert len(given(tracker, 6 + 16 + 4)) == 10
    tracker.hold()
    start = room[68].id
    first = tracker.corrected()[start]
    assert tracker.given == 1
    assert len(given(tracker, 67)) == 67
    assert tracker.given == 0  # it was recognised in the first piece
    for name, T in tracker.corrected().items():
        if name in [frame.id for frame in room[6:69]]:
            between = np.linalg.inv(true[start]) @ true[name]
            assert motion(np.linalg.inv(first) @ T, between)[0] < 0.06


def test_the_images_of_key_frames_are_bounded(images):
    room = images(ROOM, 71)
    bounded, whole = Odometry(max_images=30), Odometry()
    for frame in [*room, *reversed(room)]:
        bounded.add(frame)
        whole.add(frame)
    assert len(whole.graph.keys) > 30
    assert sum(len(key.features) > 0 for key in bounded.graph.keys) <= 30
    (at, in_key), pose = bounded.followed() or (0, np.eye(4)), whole.poses()[-1]
    assert pose is not None
    assert motion(pose, bounded.graph.keys[at].pose @ in_key)[0] < 0.05


def test_a_live_camera_finds_itself_in_a_map_or_is_refused(shared, images, tmp_path):
    first = open_recording(
        shared(ROOM), RecordingOptions(check=False, selection=Selection(every=4, limit=10))
    )
    with create_map(tmp_path / "a.map") as semantic_map:
        map_recording(first, semantic_map, Nothing(), options=OPTIONS)
        before = semantic_map.sequence
        tracker = played(images(ROOM, 38)[2::2])

        poses = {}

        def views() -> Iterator[Frame]:
            for _ in range(18):
                tracker.step()
                frame = tracker.next_frame(0.0)
                if frame is not None:
                    poses[frame.id] = frame.T_map_cam
                    yield frame

        T, line = recognised_live("live", views(), semantic_map)
        assert "recognised in" in line
        truth = open_recording(shared(ROOM), RecordingOptions(check=False))
        for entry in truth.listing.entries:
            if entry.id in poses:
                true = first.T_map_world @ entry.T_world_cam
                assert motion(true, T @ poses[entry.id])[0] < 0.05
        kitchen = iter(images("data/rgbd/redkitchen", 10))
        with pytest.raises(LayoutError, match=r"'live' in this map of .* not recognised"):
            recognised_live("live", kitchen, semantic_map)
        assert semantic_map.sequence == before


@hypothesis.given(st.lists(st.floats(-3, 3), min_size=6, max_size=6))
@hypothesis.settings(max_examples=10, deadline=None)
def test_what_is_mapped_stays_where_its_first_key_frame_was(numbers):
    """A correction that moves the whole path, as any gauge, moves nothing that was given."""
    motion_of_all = pose(*numbers[:2], numbers[2], z=numbers[3], pitch=numbers[4] / 3)
    tracker = tracked_room()
    keys = tracker.odometry.graph.keys
    for key in keys:  # a piece that begins anywhere
        key.pose = pose(1.0, -2.0, 0.7) @ key.pose
    before = tracker.corrected()
    tracker.hold()
    for key in keys:
        key.pose = motion_of_all @ key.pose
    after = tracker.corrected()
    assert after.keys() == before.keys() and len(after) > 3
    for name, T in before.items():
        np.testing.assert_allclose(after[name], T, atol=1e-3)


def tracked_room() -> LiveTracker:
    """A tracker that saw, and gave, six images of a papered room."""
    images = [papered_frame(pose(-1.0 + 0.05 * n, 0.0, 0.06 * n), n) for n in range(6)]
    coming = iter(images)
    tracker = LiveTracker("room", lambda wait: next(coming, None))
    for _ in images:
        tracker.step()
        assert tracker.next_frame(0.0) is not None
    return tracker
