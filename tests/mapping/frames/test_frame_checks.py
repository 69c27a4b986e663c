"""Checks of frames and poses, and frames read ahead."""

import threading
from dataclasses import replace

import numpy as np
import pytest

from kg.model.errors import FrameError, RecordingError
from mapping.frames.frame_checks import MAX_PAIRS, FrameChecks
from mapping.frames.lone_frames import without_lone
from mapping.frames.pose_monitor import PoseMonitor
from mapping.frames.read_ahead import read_ahead
from mapping.mapper import Mapper
from mapping.mapping_options import MappingOptions
from perception.camera.intrinsics import Intrinsics
from perception.camera.poses import BODY_FROM_CAMERA
from perception.frames import Detections, Frame
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions, Selection
from tests.perception.box_room import pose, room_frame, round_tour

CUP = ("cup", 0.9, (20, 15, 40, 30))
FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
#: poses as they should be -> as somebody gives them
MISREAD = {
    "world-to-camera": np.linalg.inv,
    "opengl": lambda T: T @ FLIP,
    "ros": lambda T: T @ np.linalg.inv(BODY_FROM_CAMERA),
}
TOURS = {
    "as it is": round_tour(),
    "every fourth frame": round_tour()[::4],
    "backwards": round_tour()[::-1],
    "a camera that only turns": [pose(-0.5, 0.3, 0.12 * n) for n in range(40)],
    "a still camera": [pose(-0.5, 0.3, 0.4)] * 40,
}


@pytest.fixture
def refused(semantic_map, make_frame, make_detections):
    """Callable: frame, detections, message -> after `add` refused them and changed nothing."""

    def check(frame, message, detections=None, scores=None):
        mapper = Mapper(semantic_map)
        before = semantic_map.sequence
        given = make_detections(CUP) if detections is None else detections
        with pytest.raises(RecordingError, match=message) as caught:
            mapper.add(frame, given, scores)
        assert "\n" not in str(caught.value)
        assert (semantic_map.sequence, mapper.frames_applied) == (before, 0)
        mapper.add(make_frame(2.0), make_detections(CUP))
        assert mapper.frames_applied == 1, "the right frame is mapped after the wrong one"

    return check


def misread(frame: Frame, convention: str) -> Frame:
    return replace(frame, T_map_cam=MISREAD[convention](frame.T_map_cam))


def pass_all(frames) -> None:
    checks = FrameChecks()
    for frame in frames:
        checks.check(frame)


@pytest.mark.parametrize("type", [np.uint16, np.int32, np.float32])
def test_depth_in_millimetres_is_refused_with_the_division_that_would_work(
    make_frame, refused, type
):
    frame = make_frame(2.0)
    frame = replace(frame, depth=(frame.depth * 1000).astype(type))
    refused(frame, r"float32 metres, got .* median of 2000; .* / 1000 would work")
    pass_all([replace(frame, depth=frame.depth.astype(np.float32) / 1000)])


def test_a_few_far_pixels_are_no_millimetres(make_frame):
    depth = np.full((49, 65), 3.0)
    depth[:20] = 1000.0  # a window
    pass_all([make_frame(depth)])


@pytest.mark.parametrize("value", [np.nan, 0.0, -1.0, np.inf])
def test_a_stream_that_begins_without_any_depth_is_refused_at_its_third_frame(
    semantic_map, make_frame, make_detections, value
):
    mapper = Mapper(semantic_map)
    for n in range(2):
        mapper.add(make_frame(value, id=f"f{n}"), make_detections())
    for n in (3, 4):
        with pytest.raises(FrameError, match=f"none of the {n} frames so far has any depth"):
            mapper.add(make_frame(value, id=f"f{n}"), make_detections())
    assert mapper.frames_applied == 2


def test_dark_frames_amidst_a_stream_are_mapped(semantic_map, make_frame, make_detections):
    mapper = Mapper(semantic_map)
    dark = [make_frame(np.nan, id=f"f{n}") for n in range(9)]
    for frame in [*dark[:2], make_frame(2.0), *dark]:
        mapper.add(frame, make_detections())
    assert mapper.frames_applied == 12


def test_depth_in_few_pixels_is_depth(make_frame):
    sparse = np.full((49, 65), np.nan)
    sparse[17, 31] = 2.0  # of a laser scanner
    pass_all([make_frame(sparse)] * 5)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (np.diag([2.0, 2.0, 2.0, 1.0]), "not rigid"),
        (np.diag([1.0, 1.0, -1.0, 1.0]), "not rigid.*determinant -1"),
        (np.eye(4) + np.eye(4, k=1) * [[1], [0], [0], [0]], "not rigid"),
        (np.diag([1.0, 1.0, 1.0, 2.0]), "last row of a pose is 0 0 0 1, got 0 0 0 2"),
        (np.eye(4) + np.eye(4, k=-3), "last row .* got 1 0 0 1; its transpose would work"),
        (np.full((4, 4), np.nan), "not finite"),
        (np.diag([1.0, 1.0, 1.0, np.inf]), "not finite"),
    ],
)
def test_poses_that_are_no_rigid_transforms_are_refused(make_frame, refused, wrong, message):
    refused(make_frame(2.0, T=wrong), f"frame frame-000000: T_map_cam: .*{message}")


@pytest.mark.parametrize("stamp", [np.nan, np.inf])
def test_stamps_that_are_not_finite_are_refused(make_frame, refused, stamp):
    refused(make_frame(2.0, stamp=stamp), r"the stamp must be finite.*time\.time\(\)")


@pytest.mark.parametrize(("row", "value"), [(0, 0.0), (1, -50.0), (0, np.nan), (1, np.inf)])
def test_intrinsics_without_a_focal_length_are_refused(make_frame, refused, row, value):
    frame = make_frame(2.0)
    K = frame.K.copy()
    K[row, row] = value
    refused(replace(frame, K=K), "focal lengths must be positive, and all numbers finite")


@pytest.mark.parametrize(
    ("row", "column", "value", "message"),
    [
        (0, 2, -0.1, "principal point"),
        (1, 2, 1.0, "principal point"),
        (0, 0, 1e5, "field of view"),
        (1, 1, 0.01, "field of view"),
    ],
)
def test_intrinsics_that_no_recording_may_have_are_refused(
    make_frame, refused, row, column, value, message
):
    """Values in widths or heights of the image; `Intrinsics.fitted` refuses the same ones."""
    frame = make_frame(2.0)
    height, width = frame.depth.shape
    K = frame.K.copy()
    K[row, column] = value * (width, height)[row]
    refused(replace(frame, K=K), message)
    camera = Intrinsics(K[0, 0], K[1, 1], K[0, 2], K[1, 2], width, height)
    with pytest.raises(RecordingError, match=message):
        camera.fitted(width, height)


@pytest.mark.parametrize(("turned", "form"), [(lambda K: K.T, r"K\.T"), (lambda K: 2 * K, "K / K")])
def test_intrinsics_of_another_form_are_refused(make_frame, refused, turned, form):
    frame = make_frame(2.0)
    refused(replace(frame, K=turned(frame.K)), f"last row of K must be 0, 0, 1, .*{form}")


@pytest.mark.parametrize("given", [[(20, 15, 40, 30)], np.zeros((1, 4))], ids=repr)
def test_detections_of_another_type_are_refused(make_frame, refused, given):
    message = r"detections must be Detections, got .*; Detections\(xyxy, score, label\) would work"
    refused(make_frame(2.0), message, given)


@pytest.mark.parametrize(
    ("box", "score"), [((20, np.nan, 40, 30), 0.9), ((20, 15, np.inf, 30), 0.9), (CUP[2], np.nan)]
)
def test_detections_that_are_not_finite_are_refused(
    make_frame, make_detections, refused, box, score
):
    seen = make_detections(CUP, ("bowl", score, box))
    refused(make_frame(2.0), r"detection 1 \(bowl\) is not finite", seen)


@pytest.mark.parametrize("side", ["left", "top", "right", "bottom"])
def test_slivers_along_the_edges_of_an_image_are_taken_and_boxes_beyond_refused(
    semantic_map, make_frame, make_detections, refused, side
):
    frame = make_frame(2.0)
    height, width = frame.depth.shape
    sliver = {
        "left": (0, 0, 0.5, height),
        "top": (0, 0, width, 0.5),
        "right": (width - 0.5, 0, width, height),
        "bottom": (0, height - 0.5, width, height),
    }[side]
    across = 2 * np.array([width, height] * 2)
    beyond = np.where(np.array(sliver) < 1, -across, across) + np.array([0, 0, 1, 1])
    refused(frame, "lies outside the image", make_detections(("cup", 0.9, beyond)))
    Mapper(semantic_map).add(frame, make_detections(("cup", 0.9, sliver)))


def test_scene_scores_of_another_type_are_refused(make_frame, refused):
    refused(make_frame(2.0), "scores must be SceneScores, got dict", scores={"kitchen": 0.9})


def test_a_frame_of_another_type_is_refused(refused, semantic_map, make_frame, make_detections):
    refused(make_frame(2.0).rgb, "must be a Frame, got ndarray; Frame\\(id, rgb, depth, K")
    with pytest.raises(FrameError, match="must be a Frame, got dict"):
        Mapper(semantic_map).viewed_place({"depth": 2.0})


def test_lists_instead_of_arrays_are_refused_where_they_are_given(make_frame):
    frame = make_frame(2.0)
    with pytest.raises(FrameError, match=r"depth must be a numpy array, got list; np\.asarray\(d"):
        replace(frame, depth=frame.depth.tolist())
    with pytest.raises(FrameError, match=r"depth must be \(H, W\), got \(49, 65, 1\)"):
        replace(frame, depth=frame.depth[..., None])
    with pytest.raises(ValueError, match="xyxy must be a numpy array, got list"):
        Detections([CUP[2]], [0.9], ("cup",))


@pytest.mark.parametrize("convention", MISREAD)
def test_poses_of_another_convention_are_refused_and_named(
    semantic_map, make_detections, convention
):
    frames = [misread(room_frame(T, n), convention) for n, T in enumerate(round_tour())]
    mapper = Mapper(semantic_map)
    with pytest.raises(FrameError, match=rf'CONVENTIONS\["{convention}"\]\(T_map_cam\)'):
        for frame in frames:
            mapper.add(frame, make_detections())
    assert mapper.frames_applied < 25
    with pytest.raises(FrameError, match="would work, in a new map"):
        mapper.add(frames[-1], make_detections())
    unchecked = Mapper(semantic_map, MappingOptions(check_poses=False), recording="as they are")
    for frame in frames:
        unchecked.add(frame, make_detections())


def test_frames_that_share_little_by_their_poses_tell_nothing_of_them():
    there = pose(-1, 0, 3), pose(-1.6, 0.6, 3.4)
    little = [misread(room_frame(T, n), "opengl") for n, T in enumerate(there)]
    pass_all(little * 12)
    wrong = [misread(room_frame(T, n), "opengl") for n, T in enumerate(round_tour())]
    with pytest.raises(FrameError, match="opengl"):
        pass_all(little * 6 + wrong)
    pass_all(little * (MAX_PAIRS // 2 + 1) + wrong)  # nothing is concluded any more


@pytest.mark.parametrize("tour", TOURS)
def test_right_poses_of_a_room_are_taken(tour):
    pass_all(room_frame(T, n) for n, T in enumerate(TOURS[tour]))


def test_what_is_carried_before_the_camera_tells_nothing_of_its_poses():
    ahead = [pose(-1.5 + 0.2 * n, 0.1 * n, 0.1 * n) for n in range(30)]
    pass_all(room_frame(T, n) for n, T in enumerate(ahead[:8]))
    seen = room_frame(ahead[0], 0)
    box = np.full_like(seen.depth, 0.6)
    for depth in (seen.depth, box):
        pass_all(replace(seen, depth=depth, T_map_cam=T) for T in ahead)


@pytest.mark.parametrize("recording", ["redkitchen", "hololens_lounge"])
def test_right_poses_of_recordings_are_taken_and_others_refused(shared, recording):
    folder = open_recording(shared(f"data/rgbd/{recording}"), RecordingOptions(check=False))
    frames = [folder.frame(n) for n in range(40)]
    for sound in (frames, frames[::-1], frames[::4], frames[:1] * 9):
        pass_all(sound)
    for convention in MISREAD:
        with pytest.raises(FrameError, match=convention):
            pass_all(misread(frame, convention) for frame in frames)


@pytest.mark.parametrize(
    ("xyxy", "score", "message"),
    [
        ([[200, 150, 40, 30]], [0.9], "x, y, width, height"),
        ([[10, 10, 60, 60], [200, 150, 240, 30]], [0.9, 0.8], "box 1"),
        ([[0.1, 0.2, 0.4, 0.5]], [0.9], "must be in pixels"),
        ([[10, 10, 60, 60]], [87.0], "score / 100 would work"),
        ([[10, 10, 60, 60]], [-1.3], "logits"),
    ],
)
def test_boxes_and_scores_of_another_form_are_refused_where_they_are_made(xyxy, score, message):
    boxes, scores = np.array(xyxy, np.float32), np.array(score, np.float32)
    with pytest.raises(FrameError, match=message):
        Detections(boxes, scores, ("cup",) * len(boxes))


def test_one_label_for_all_boxes_is_refused():
    with pytest.raises(FrameError, match="texts, one a box"):
        Detections(np.zeros((3, 4), np.float32), np.zeros(3, np.float32), "cup")  # type: ignore[arg-type]


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


def readers() -> int:
    return sum(thread.name == "read-ahead" for thread in threading.enumerate())


def test_no_more_than_so_many_are_made_before_they_are_asked_for():
    made, third = [], threading.Event()

    def items():
        for n in range(9):
            made.append(n)
            if n == 2:
                third.set()
            yield n

    ahead = read_ahead(items(), count=2)
    assert next(ahead) == 0
    assert third.wait(10)
    ahead.close()
    # one was used, two wait, and one is in hand
    assert made[-1] <= 3


def test_an_error_comes_after_the_items_before_it():
    def items():
        yield 1
        yield 2
        raise ValueError("the third is broken")

    ahead = read_ahead(items())
    assert [next(ahead), next(ahead)] == [1, 2]
    with pytest.raises(ValueError, match="the third is broken"):
        next(ahead)
    assert readers() == 0


def test_closing_ends_the_thread_and_closes_the_source():
    closed = []

    def items():
        try:
            yield from range(1000)
        finally:
            closed.append(threading.current_thread().name)

    with pytest.raises(KeyboardInterrupt):
        for n in read_ahead(items()):
            if n == 3:
                raise KeyboardInterrupt
    assert readers() == 0
    assert closed == ["read-ahead"]


def test_chained_stages_run_side_by_side():
    """Each stage waits for the other to work on another item, so that one thread would hang."""
    met = threading.Barrier(2, timeout=20)

    def first():
        for n in range(4):
            if n > 0:
                met.wait()
            yield n

    def second(items):
        for n in items:
            if n < 3:
                met.wait()
            yield n

    assert list(read_ahead(second(read_ahead(first())))) == [0, 1, 2, 3]
