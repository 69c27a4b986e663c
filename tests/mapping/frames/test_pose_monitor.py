"""Problems of poses, depth and colour of a stream, and lone frames that are left out."""

from dataclasses import replace

import numpy as np
import pytest

from kg.model.errors import RecordingError
from mapping.frames.lone_frames import without_lone
from mapping.frames.pose_monitor import PoseMonitor
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions, Selection
from tests.perception.box_room import pose, room_frame, round_tour


def problems(frames):
    monitor = PoseMonitor("room")
    for frame in frames:
        monitor.add(frame)
    monitor.finish()
    return monitor.problems


def shifted(frame, x, y):
    T = frame.T_map_cam.copy()
    T[:2, 3] += x, y
    return replace(frame, T_map_cam=T)


def test_sound_poses_have_no_problems():
    assert problems([room_frame(T, n) for n, T in enumerate(round_tour())]) == {}


def scaled(frame, factor):
    return replace(frame, depth=frame.depth * np.float32(factor))


@pytest.mark.parametrize(
    "spoil",
    [
        lambda frame: scaled(frame, 4),
        lambda frame: scaled(frame, 0.25),
        lambda frame: scaled(frame, 1.15),
        lambda frame: replace(frame, depth=np.ascontiguousarray(frame.depth[:, ::-1])),
        lambda frame: shifted(frame, 0.5, -0.4),
    ],
    ids=["four times", "a quarter", "15 % too far", "mirrored", "another pose"],
)
def test_single_frames_that_fit_neither_neighbour_are_named(spoil):
    frames = [room_frame(T, n) for n, T in enumerate(round_tour())]
    for n in (7, 19, 30):
        frames[n] = spoil(frames[n])
    lone = problems(frames)["lone"]
    assert lone.startswith("depth of 2 frames contradicts")  # told as they double
    assert "frame-000019" in lone


@pytest.mark.parametrize("count", [2, 5, 8])
def test_frames_side_by_side_that_agree_with_each_other_alone_are_named(count):
    frames = [room_frame(T, n) for n, T in enumerate(round_tour())]
    for n in range(12, 12 + count):
        frames[n] = scaled(frames[n], 1.3)
    lone = problems(frames)["lone"]
    assert lone.startswith(f"depth of {count} frames contradicts")
    assert "frame-000012, frame-000013" in lone


@pytest.mark.parametrize("count", [3, 12])
def test_last_frames_that_contradict_those_before_are_told(count):
    frames = [room_frame(T, n) for n, T in enumerate(round_tour())]
    frames[-count:] = [scaled(frame, 1.3) for frame in frames[-count:]]
    step = problems(frames)["step"]
    assert f"from frame {frames[-count].id} on depth contradicts" in step


def test_a_jump_is_noticed_where_it_happens():
    frames = [room_frame(T, n) for n, T in enumerate(round_tour())]
    jumped = [f if n < 17 else shifted(f, 0.35, -0.3) for n, f in enumerate(frames)]
    found = problems(jumped)
    assert list(found) == ["jump"]
    assert "jump at frame frame-000017" in found["jump"]
    assert "--poses FILE" in found["jump"]


def test_drift_is_noticed_where_the_camera_comes_by_again():
    t = np.linspace(0, 2 * np.pi, 60)
    there = [pose(-1.2 + 0.8 * np.sin(s), -0.6 + 0.9 * np.sin(s), 0.5) for s in np.tile(t, 2)]
    frames = [room_frame(T, n) for n, T in enumerate(there)]
    assert problems(frames) == {}
    drifting = [shifted(f, 0.004 * n, 0.003 * n) for n, f in enumerate(frames)]
    assert "the poses drift" in problems(drifting)["drift"]


def test_after_a_jump_what_was_seen_before_it_tells_no_drift():
    t = np.tile(np.linspace(0, 2 * np.pi, 60), 2)
    there = [pose(-1.2 + 0.8 * np.sin(s), -0.6 + 0.9 * np.sin(s), 0.5) for s in t]
    frames = [room_frame(T, n) for n, T in enumerate(there)]
    jumped = [f if n < 62 else shifted(f, 0.35, -0.3) for n, f in enumerate(frames)]
    assert list(problems(jumped)) == ["jump"]


@pytest.mark.parametrize("data", ["data/rgbd/redkitchen", "data/rgbd/hololens_lounge"])
def test_frames_whose_colour_is_late_are_named_and_left_out(shared, caplog, data):
    options = RecordingOptions(selection=Selection(limit=60), check=False)
    frames = list(open_recording(shared(data), options).frames())
    assert problems(frames) == {}
    late = [21, 35, 36, 37, 50]
    mixed = [
        replace(f, rgb=frames[n - 12].rgb if n in late else f.rgb) for n, f in enumerate(frames)
    ]
    assert "colour of 4 frames contradicts" in problems(mixed)["colour"]  # told as they double
    caplog.clear()
    lines = dict[tuple[str, str], str]()
    shown = list(without_lone(iter(mixed), "room", lines))
    assert [one.id for one in shown] == [one.id for one in mixed]
    assert [n for n, one in enumerate(shown) if one.blank] == late
    assert f"{mixed[21].id}, {mixed[35].id}" in lines["", "colour"]
    assert caplog.text.count("they are left out") == len(late).bit_length() - 1


def test_frames_of_several_cameras_are_judged_each_by_their_own():
    tour = [room_frame(T, n) for n, T in enumerate(round_tour())]
    other = [replace(shifted(f, 0.6, 0.5), id=f"b-{f.id}", camera="b") for f in tour]
    other[20] = scaled(other[20], 1.3)
    both = [one for pair in zip(tour, other, strict=True) for one in pair]
    lines = dict[tuple[str, str], str]()
    shown = list(without_lone(both, "room", lines))
    assert [one.id for one in shown if one.blank] == [other[20].id]
    assert [*lines] == [("b", "lone")]


def test_frames_do_not_wait_for_a_camera_that_gives_no_more():
    tour = [room_frame(T, n) for n, T in enumerate(round_tour())]
    last = [replace(f, id=f"b-{f.id}", camera="b") for f in (tour[0], scaled(tour[1], 1.3))]
    given = [*last, *tour, *(replace(f, id=f"again-{f.id}") for f in tour)]
    waiting = iter(given)
    frames = without_lone(waiting, "room", {})
    shown = [next(frames) for _ in range(3)]
    assert [one.id for one in shown] == [one.id for one in given[:3]]
    assert len([*waiting]) >= len(tour) // 2, "many are not read yet"


def test_frames_before_an_unreadable_one_are_shown():
    tour = [room_frame(T, n) for n, T in enumerate(round_tour())]
    tour[20] = scaled(tour[20], 1.3)

    def frames():
        yield from tour[:21]
        raise RecordingError("an image is damaged")

    shown = []
    with pytest.raises(RecordingError, match="damaged"):
        shown.extend(without_lone(frames(), "room", {}))  # those before the error stay
    assert [one.id for one in shown] == [one.id for one in tour[:21]]
