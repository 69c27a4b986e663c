"""Recognised places, and the graph of poses."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from perception.camera.poses import inverse, motion, motion_of
from perception.frames import Frame
from perception.odometry.features import FeatureDetector, Features, Image
from perception.odometry.key_graph import PlaceMemory
from perception.odometry.pose_graph import BlockSystem, PoseConstraint, adjusted, needs_adjustment
from perception.odometry.recognition import (
    Doubt,
    KeyView,
    Recogniser,
    Recognition,
    decoded,
    encoded,
    view_of,
)
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions
from tests.perception.box_room import papered_frame, pose

MOVED = np.array([[0.0, -1, 0, 2], [1, 0, 0, -3], [0, 0, 1, 0.1], [0, 0, 0, 1]])  # another world


@pytest.fixture(scope="module")
def frames(shared: Callable[[str], Path]) -> Callable[[str, slice], list[Frame]]:
    """Callable: name of a recording, and a slice -> its frames."""

    def read(name: str, some: slice) -> list[Frame]:
        recording = open_recording(shared(f"data/rgbd/{name}"), RecordingOptions(check=False))
        return [recording.frame(n) for n in range(len(recording))[some]]

    return read


def kept(frames: Iterable[Frame]) -> list[KeyView]:
    detector = FeatureDetector()
    return [view_of(frame, detector)[0] for frame in frames]


def result(views: Sequence[KeyView], frames: Iterable[Frame]) -> Recognition | Doubt:
    recogniser, detector = Recogniser(views), FeatureDetector()
    for frame in frames:
        recogniser.look(*view_of(frame, detector))
    return recogniser.result()


def test_a_room_is_recognised_and_its_world_placed(frames):
    views = kept(frames("icl_livingroom", slice(0, None, 8)))
    moved = [
        replace(f, T_map_cam=MOVED @ f.T_map_cam) for f in frames("icl_livingroom", slice(4, 40, 6))
    ]
    found = result([decoded(encoded(view), view.pose) for view in views], moved)
    assert isinstance(found, Recognition)
    for frame in moved:
        far, turned = motion(np.linalg.inv(MOVED) @ frame.T_map_cam, found.T @ frame.T_map_cam)
        assert far < 0.05
        assert turned < np.deg2rad(1)
    assert found.error < 0.1


def test_another_room_is_not_recognised(frames):
    rooms = {
        "redkitchen": frames("redkitchen", slice(0, None, 50)),
        "icl_livingroom": frames("icl_livingroom", slice(0, None, 15)),
        "hololens_lounge": frames("hololens_lounge", slice(0, None, 30)),
    }
    for one, views in [(name, kept(room)) for name, room in rooms.items()]:
        for other in rooms.keys() - {one}:
            found = result(views, rooms[other])
            assert isinstance(found, Doubt), (one, other)
            assert "it was not recognised there" in found.reason


def test_one_view_is_not_enough_however_well_it_matches(frames):
    room = frames("icl_livingroom", slice(0, 40, 8))
    found = result(kept(room), [room[1]])
    assert isinstance(found, Doubt)
    assert "1 views match, " in found.reason and "are needed" in found.reason


def test_of_two_rooms_that_look_alike_neither_is_taken(frames):
    room = frames("icl_livingroom", slice(0, None, 8))
    views = kept(room)
    views += [replace(view, pose=MOVED @ view.pose) for view in views]
    found = result(views, frames("icl_livingroom", slice(4, 40, 6)))
    assert isinstance(found, Doubt)
    assert "looks like two places there" in found.reason


def test_a_room_of_another_shape_with_the_same_pictures_is_not_taken(frames):
    """Two thirds of the depth differ, though all colours are the same."""

    def other(frame: Frame) -> Frame:
        depth = frame.depth.copy()
        third = depth.shape[1] // 3
        depth[:, :third] *= 1.6
        depth[:, -third:] *= 0.7
        return replace(frame, depth=depth)

    room = frames("redkitchen", slice(0, 120, 12))
    found = result(kept(room), [other(frame) for frame in room])
    assert isinstance(found, Doubt)


def test_people_leave_no_features(frames):
    (frame,) = frames("redkitchen", slice(0, 1))
    box = np.array([[100.0, 50, 400, 470]], np.float32)
    view, _ = view_of(frame, FeatureDetector(), without=box)
    x, y = view.features.pixels.T
    assert len(x) > 40
    assert not ((x > 103) & (x < 397) & (y > 53) & (y < 467)).any()


def test_a_view_is_small_and_damage_is_an_error(frames):
    (view,) = kept(frames("redkitchen", slice(0, 1)))
    data = encoded(view)
    assert len(data) < 20_000
    again = decoded(data, view.pose)
    np.testing.assert_allclose(again.features.points, view.features.points, atol=1e-3)
    np.testing.assert_array_equal(again.features.descriptors, view.features.descriptors)
    np.testing.assert_allclose(
        again.features.samples.depth, view.features.samples.depth, atol=1e-3, equal_nan=True
    )
    for wrong in (data[:20], data[:200], data[:-30], b"\xff" * len(data), b""):
        with pytest.raises(ValueError, match=r"."):
            decoded(wrong, view.pose)


HEADINGS = (0.0, 1.6, 3.1, 4.7)


def seen(heading: float, seed: int = 0) -> Features:
    T = pose(-0.2, -0.6, heading)
    return FeatureDetector().features(Image.of(papered_frame(T, 0, seed)))


@pytest.fixture(scope="module")
def memory() -> PlaceMemory:
    made = PlaceMemory()
    for key, heading in enumerate(HEADINGS):
        made.add(key, seen(heading))
    return made


def test_a_view_beside_a_key_frame_is_similar_to_it(memory):
    everywhere = np.ones(4, np.bool_)
    for key, heading in enumerate(HEADINGS):
        assert memory.similar(seen(heading + 0.08), everywhere, 1) == [key]


def test_only_allowed_key_frames_are_named(memory):
    allowed = np.array([True, False, True, True])
    assert 1 not in memory.similar(seen(1.6), allowed, 4)
    assert memory.similar(seen(1.6), np.zeros(4, np.bool_), 4) == []


def test_no_more_than_wanted_the_best_first(memory):
    found = memory.similar(seen(3.15), np.ones(4, np.bool_), 2)
    assert found[0] == 2
    assert len(found) <= 2


def test_an_empty_view_is_similar_to_nothing(memory):
    none = seen(0.0)
    empty = Features(
        none.grey, none.samples, none.pixels[:0], none.points[:0], none.descriptors[:0]
    )
    assert memory.similar(empty, np.ones(4, np.bool_), 3) == []


SURE = np.diag([1e4, 1e4, 1e4, 1e4, 1e4, 1e4])


def square() -> list[np.ndarray]:
    """Poses around a square of 4 m that end where they began."""
    poses = [np.eye(4)]
    for step in range(24):
        turn = np.pi / 2 if step % 6 == 5 else 0.0
        poses.append(poses[-1] @ motion_of(np.array([0, turn, 0, 0, 0, 4 / 6])))
    return poses


def edge(poses: list[np.ndarray], i: int, j: int, off: np.ndarray | None = None) -> PoseConstraint:
    T = inverse(poses[j]) @ poses[i]
    return PoseConstraint(i, j, T if off is None else motion_of(off) @ T, SURE)


def drifted(poses: list[np.ndarray], edges: list[PoseConstraint]) -> list[np.ndarray]:
    found = [poses[0]]
    for one in edges[: len(poses) - 1]:
        found.append(found[-1] @ inverse(one.T))
    return found


def worst(found: np.ndarray, poses: list[np.ndarray]) -> float:
    return max(motion(a, b)[0] for a, b in zip(found, poses, strict=True))


@pytest.fixture
def drifting() -> tuple[list[np.ndarray], list[PoseConstraint]]:
    poses = square()
    off = np.array([0, 0.012, 0, 0.008, 0, 0.006])
    return poses, [edge(poses, i, i + 1, off) for i in range(24)]


def test_true_edges_give_true_poses_from_a_poor_start():
    poses = square()
    edges = [edge(poses, i, i + 1) for i in range(24)] + [edge(poses, 0, 24)]
    random = np.random.default_rng(0)
    start = [poses[0], *(p @ motion_of(random.normal(0, 0.05, 6)) for p in poses[1:])]
    assert worst(adjusted(start, edges), poses) < 1e-3


def test_a_loop_takes_most_of_the_drift_away(drifting):
    poses, edges = drifting
    start = drifted(poses, edges)
    assert worst(np.array(start), poses) > 0.4
    assert motion(start[-1], poses[-1])[0] > 0.2
    closed = adjusted(start, [*edges, edge(poses, 0, 24)])
    assert motion(closed[-1], poses[-1])[0] < 0.06
    assert worst(closed, poses) < worst(np.array(start), poses) / 2


def test_one_wrong_loop_among_right_ones_loses(drifting):
    poses, edges = drifting
    right = [edge(poses, 0, 24), edge(poses, 1, 23), edge(poses, 2, 22), edge(poses, 0, 23)]
    wrong = edge(poses, 3, 15, np.array([0, 0, 0, 3.0, 0, 0]))
    start = drifted(poses, edges)
    with_wrong = adjusted(start, [*edges, *right, wrong])
    assert worst(with_wrong, list(adjusted(start, [*edges, *right]))) < 0.1


def test_the_first_pose_stays_and_nothing_moves_without_edges(drifting):
    poses, edges = drifting
    np.testing.assert_allclose(
        adjusted(poses, [*edges, edge(poses, 0, 24)])[0], poses[0], atol=1e-9
    )
    np.testing.assert_array_equal(adjusted(poses, []), poses)


def test_a_large_graph_is_adjusted_where_new_edges_contradict_it_or_are_many(drifting):
    poses, edges = drifting
    start = drifted(poses, edges)
    many = [*edges, *[edge(start, 0, 24)] * 200]
    assert needs_adjustment(start, many, 100)  # more than half of them are new
    assert not needs_adjustment(start, many, len(many) - 4)
    assert needs_adjustment(start, [*many, edge(poses, 0, 24)], len(many))
    assert not needs_adjustment(start, many, len(many))


def test_an_edge_of_more_information_wins():
    poses = [np.eye(4), motion_of(np.array([0, 0, 0, 1.0, 0, 0]))]
    sure, vague = edge(poses, 0, 1), edge(poses, 0, 1, np.array([0, 0, 0, 0.02, 0, 0]))
    vague = PoseConstraint(0, 1, vague.T, SURE / 100)
    found = adjusted(poses, [sure, vague])
    assert abs(found[1][0, 3] - 1) < 0.001


def test_block_elimination_solves_as_a_dense_solver_does():
    random = np.random.default_rng(1)
    rows, columns = np.array([0, 1, 2, 0, 1]), np.array([1, 2, 3, 3, 3])
    blocks = random.normal(size=(5, 6, 6))
    dense = np.zeros((24, 24))
    for i, j, block in zip(rows, columns, blocks, strict=True):
        dense[6 * i : 6 * i + 6, 6 * j : 6 * j + 6] = block
        dense[6 * j : 6 * j + 6, 6 * i : 6 * i + 6] = block.T
    diagonal = np.repeat(40 * np.eye(6)[None], 4, axis=0) + 0.0
    for i in range(4):
        dense[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] = diagonal[i]
    right = random.normal(size=(4, 6))
    solved = BlockSystem.of(diagonal, right, rows, columns, blocks).solved()
    np.testing.assert_allclose(solved.ravel(), np.linalg.solve(dense, right.ravel()), atol=1e-9)
