"""Checks of frames, detections and poses where they are added."""

from dataclasses import replace

import numpy as np
import pytest

from kg.model.errors import FrameError, RecordingError
from mapping.frames.frame_checks import MAX_PAIRS, FrameChecks
from mapping.mapper import Mapper
from mapping.mapping_options import MappingOptions
from perception.camera.intrinsics import Intrinsics
from perception.camera.poses import BODY_FROM_CAMERA
from perception.frames import Detections, Frame
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions
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
