"""Trajectories: interpolation between poses."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from kg.model.errors import RecordingError
from perception.camera.poses import (
    check_pose_numbers,
    gridded_pose,
    pose_from_quaternion,
    quaternion_from_pose,
    read_trajectory,
)

unit = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.3)


def angle(R: np.ndarray) -> float:
    return float(np.arccos(np.clip((np.trace(R) - 1) / 2, -1, 1)))


@given(a=unit, b=unit, share=st.floats(0.01, 0.99))
def test_rotation_turns_evenly_from_one_pose_to_the_next(tmp_path_factory, a, b, share):
    a, b = (np.array(q) / np.linalg.norm(q) for q in (a, b))
    path = tmp_path_factory.mktemp("t") / "groundtruth.txt"
    lines = (f"{t} {t} 0 0 {' '.join(str(float(x)) for x in q)}" for t, q in ((0.0, a), (0.1, b)))
    path.write_text("\n".join(lines))
    T = read_trajectory(path).at(0.1 * share, 0.02)
    assert T is not None
    start, end = (pose_from_quaternion(np.zeros(3), q, "test")[:3, :3] for q in (a, b))
    whole = angle(start.T @ end)
    assert T[0, 3] == pytest.approx(0.1 * share)
    if whole < 3.0:  # half a turn has no one shortest way
        assert angle(start.T @ T[:3, :3]) == pytest.approx(share * whole, abs=1e-4)
        assert angle(T[:3, :3].T @ end) == pytest.approx((1 - share) * whole, abs=1e-4)


def test_no_pose_beyond_the_ends_or_in_a_long_gap(tmp_path):
    path = tmp_path / "groundtruth.txt"
    path.write_text("0 0 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n")
    trajectory = read_trajectory(path)
    assert trajectory.at(-0.05, 0.02) is None
    assert trajectory.at(0.5, 0.02) is None
    assert trajectory.at(1.05, 0.02) is None
    near = trajectory.at(1.01, 0.02)
    assert near is not None
    assert near[0, 3] == 1


@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1))
@example([0.0, 0, 0, 1])
@example([1.0, 0, 0, 0])
@example([1.0, 0, 0, 1])
@example([1.0, -1, 1, -1])
@example([0.0, 1, -1, 0])
def test_a_gridded_pose_written_as_a_quaternion_is_the_same_to_the_last_bit(q):
    t = np.array([0.1, -2.3, 4.5])
    T = pose_from_quaternion(t, np.array(q) / np.linalg.norm(q), "here")
    gridded = gridded_pose(T)
    assert np.abs(gridded - T).max() < 1e-11
    again = gridded_pose(pose_from_quaternion(t, quaternion_from_pose(gridded), "here"))
    assert np.array_equal(again, gridded)


@pytest.mark.parametrize(
    "numbers",
    [
        (0, 0, 0, 0, 0, 0, 0),
        (0, 0, 0, 0, 0, 0, 1.2),
        (0, float("nan"), 0, 0, 0, 0, 1),
        (0, 0, float("inf"), 0, 0, 0, 1),
        (0, 0, 0, float("nan"), 0, 0, 1),
        (0, -2e7, 0, 0, 0, 0, 1),
    ],
)
def test_numbers_that_are_no_pose_are_refused_as_poses_are(numbers):
    with pytest.raises(RecordingError) as quick:
        check_pose_numbers(numbers, "here")
    with pytest.raises(RecordingError) as whole:
        pose_from_quaternion(np.array(numbers[:3], float), np.array(numbers[3:], float), "here")
    assert str(quick.value) == str(whole.value)


def test_numbers_of_a_pose_pass():
    check_pose_numbers((1.0, -2.0, 3.0, 0.5, 0.5, -0.5, 0.52), "here")
