"""Pose graph: loops take drift away, and wrong links do not bend it."""

from __future__ import annotations

import numpy as np
import pytest

from perception.camera.poses import inverse, motion, motion_of
from perception.odometry.pose_graph import BlockSystem, PoseConstraint, adjusted, needs_adjustment

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
