"""Intrinsics are found from points that several views show."""

from __future__ import annotations

import numpy as np
import pytest

from perception.camera.poses import inverse, motion_of
from perception.odometry.self_calibration import CalibrationFit, MatchedPair, self_calibrated

K = np.array([[500.0, 0, 320], [0, 500.0, 240], [0, 0, 1]])


def pairs(turn: float, count: int = 8, noise: float = 0.3) -> list[MatchedPair]:
    """Pairs of views of random points, turned by `turn` [rad] against each other."""
    random = np.random.default_rng(4)
    found = []
    for number in range(count):
        pixels = random.uniform((60, 60), (580, 420), (80, 2))
        z = random.uniform(1, 4, 80)
        points = np.column_stack([(pixels - K[:2, 2]) / 500 * z[:, None], z])
        axis = np.array([np.sin(number), np.cos(number), 0.1])
        T = motion_of(np.concatenate([turn * axis, 0.1 * random.normal(size=3)]))
        moved = points @ T[:3, :3].T + T[:3, 3]
        shown = (moved @ K.T)[:, :2] / moved[:, 2:] + random.normal(0, noise, (80, 2))
        guess = motion_of(0.05 * random.normal(size=6)) @ T
        found.append(MatchedPair((pixels, shown), (z, moved[:, 2]), guess))
    return found


@pytest.mark.parametrize("factor", [0.75, 1.0, 1.3])
def test_the_focal_length_is_found(factor):
    given = K * np.array([[factor, 1, 1], [1, factor, 1], [1, 1, 1]])
    fit = self_calibrated(pairs(0.35), given)
    assert fit is not None
    np.testing.assert_allclose(fit.adjusted(given), K, atol=6)
    assert fit.deviation < 0.02


def test_the_principal_point_is_found():
    given = K + np.array([[0, 0, -80], [0, 0, 80], [0, 0, 0]])
    fit = self_calibrated(pairs(0.35), given)
    assert fit is not None
    np.testing.assert_allclose(fit.adjusted(given), K, atol=6)


def test_wrong_matches_count_little():
    wrong = pairs(0.35)
    for pair in wrong:
        pair.pixels[1][:8] += 90
    fit = self_calibrated(wrong, K)
    assert fit is not None
    np.testing.assert_allclose(fit.adjusted(K), K, atol=8)


def test_without_a_turn_nothing_is_sure():
    fit = self_calibrated(pairs(0.0), K)
    assert fit is None or fit.deviation > 0.05


def test_a_unit_of_depth_changes_nothing():
    large = [
        MatchedPair(pair.pixels, (3 * pair.depth[0], 3 * pair.depth[1]), inverse(np.eye(4)))
        for pair in pairs(0.35)
    ]
    fit = self_calibrated(large, K)
    assert fit is not None
    np.testing.assert_allclose(fit.adjusted(K), K, atol=8)


def test_adjusted_scales_and_moves():
    fit = CalibrationFit(float(np.log(2)), 0.1, -0.1, 0.0)
    np.testing.assert_allclose(fit.adjusted(K), [[1000, 0, 370], [0, 1000, 190], [0, 0, 1]])
