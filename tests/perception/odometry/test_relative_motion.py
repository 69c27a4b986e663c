"""Motion between frames, and calibration by it."""

from dataclasses import replace

import numpy as np
import pytest

from perception.camera.poses import inverse, motion, motion_of
from perception.odometry.features import FeatureDetector, Features, Image
from perception.odometry.relative_motion import (
    depth_agreement,
    linearised,
    motion_by_features,
    motion_by_flow,
    refined,
    with_depth,
)
from perception.odometry.self_calibration import CalibrationFit, MatchedPair, self_calibrated
from tests.perception.box_room import LARGE_K, papered_frame, pose

FIRST, SECOND = pose(-1.2, -0.8, 0.2), pose(-1.05, -0.72, 0.32, pitch=0.25)
TRUE = inverse(SECOND) @ FIRST  # points of the first camera to the second


@pytest.fixture(scope="module")
def first() -> Features:
    return FeatureDetector().features(Image.of(papered_frame(FIRST, 0)))


@pytest.fixture(scope="module")
def second() -> Image:
    return Image.of(papered_frame(SECOND, 1))


def off(T: np.ndarray) -> tuple[float, float]:
    return motion(TRUE, T)


def test_motion_by_features_is_right_to_millimetres(first, second):
    found = motion_by_features(first, FeatureDetector().features(second), second)
    assert found is not None
    far, turned = off(found.T)
    assert far < 0.006
    assert turned < np.deg2rad(0.15)
    assert found.share > 0.6
    assert found.inliers >= 60


def test_motion_by_flow_corrects_a_guess(first, second):
    guess = motion_of(np.array([0.01, -0.012, 0.008, 0.012, -0.01, 0.01])) @ TRUE
    assert min(off(guess)) > 0.015
    found = motion_by_flow(first, second, guess, levels=1)
    assert found is not None
    assert off(found.T)[0] < 0.006
    assert off(found.T)[1] < np.deg2rad(0.15)


def test_another_room_gives_no_motion(first):
    other = Image.of(papered_frame(SECOND, 1, seed=5))
    found = motion_by_features(first, FeatureDetector().features(other), other)
    assert found is None or found.share < 0.3


def test_blank_images_give_no_motion(first):
    frame = papered_frame(SECOND, 1)
    blank = Image.of(replace(frame, rgb=np.full_like(frame.rgb, 128)))
    none = FeatureDetector().features(blank)
    assert len(none) == 0
    assert motion_by_features(first, none, blank) is None


def test_depth_agrees_by_the_true_motion_only(first, second):
    assert depth_agreement(first, second, TRUE).share > 0.97
    wrong = TRUE.copy()
    wrong[0, 3] += 0.4
    assert depth_agreement(first, second, wrong).share < 0.8


def points(random: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    p = random.uniform((-1, -0.8, 1.5), (1, 0.8, 4), (100, 3))
    moved = p @ TRUE[:3, :3].T + TRUE[:3, 3]
    return p, (moved @ LARGE_K.T)[:, :2] / moved[:, 2:], moved[:, 2]


def test_refined_finds_the_motion_of_exact_points_among_wrong_ones():
    p, pixels, z = points(np.random.default_rng(2))
    pixels[:15] += 40
    z[20:40] = np.nan
    guess = motion_of(np.full(6, 0.02)) @ TRUE
    found = refined(p, pixels, z, LARGE_K, guess)
    assert found is not None
    assert found.inliers == 85
    np.testing.assert_allclose(found.T, TRUE, atol=0.003)
    assert refined(p[:20], pixels[:20], z[:20], LARGE_K, guess) is None, "too few agree"


def test_the_jacobian_is_that_of_the_residuals():
    p, pixels, z = points(np.random.default_rng(3))
    _, J = linearised(p, pixels, z, LARGE_K, TRUE)
    step = 1e-6
    for axis in range(6):
        nudge = motion_of(step * np.eye(6)[axis])
        after, _ = linearised(p, pixels, z, LARGE_K, nudge @ TRUE)
        before, _ = linearised(p, pixels, z, LARGE_K, inverse(nudge) @ TRUE)
        np.testing.assert_allclose(
            J[:, :, axis], (after - before) / (2 * step), rtol=1e-4, atol=1e-3
        )


def test_depth_holds_what_features_leave_open(first, second):
    found = motion_by_features(first, FeatureDetector().features(second), second)
    assert found is not None
    moved = motion_of(np.array([0, 0, 0, 0, 0, 0.02])) @ TRUE
    weak = replace(found, T=moved, information=np.eye(6) * 1e-3)
    fitted = with_depth(weak, first, second)
    assert off(fitted.T)[0] < 0.5 * off(moved)[0]
    assert np.linalg.eigvalsh(fitted.information).min() > 1e-3


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
