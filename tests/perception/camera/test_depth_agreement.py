"""Agreement of two depth images, and the motion by which they agree."""

import numpy as np
import pytest

from perception.camera.depth_agreement import DepthSamples, agreement, depth_samples, register
from tests.perception.box_room import K, pose, room_frame

ONE, OTHER = pose(-1.5, -1.2, 0.5), pose(-1.5, 1.2, -0.5)  # to both sides of the pillar


def samples(T: np.ndarray) -> DepthSamples:
    return depth_samples(room_frame(T, 0).depth, K)


def test_what_one_view_hides_contradicts_no_other() -> None:
    found = agreement(samples(ONE), samples(OTHER), np.linalg.inv(ONE) @ OTHER)
    assert found.overlap > 0.3
    assert found.contradicting < 0.02 * found.agreeing


def test_what_one_view_looks_through_contradicts_the_other() -> None:
    nearer = DepthSamples(samples(ONE).depth / 2, K, samples(ONE).points / 2)
    found = agreement(samples(ONE), nearer, np.eye(4))
    assert found.agreeing == 0 and found.contradicting >= len(nearer.points)


@pytest.mark.parametrize("share", [0.01, 0.03])
def test_noise_of_depth_widens_what_agrees_and_leaves_other_scenes_apart(share: float) -> None:
    def seen(T: np.ndarray, seed: int) -> DepthSamples:
        depth = room_frame(T, 0).depth
        noise = np.random.default_rng(seed).normal(0, 1, depth.shape).astype(np.float32)
        return depth_samples(depth * (1 + share * depth * noise), K)

    a, b = seen(ONE, 1), seen(OTHER, 2)
    assert samples(ONE).noise == 0
    assert a.noise == pytest.approx(share, rel=0.4)
    T = np.linalg.inv(ONE) @ OTHER
    assert agreement(a, b, T).share > 0.85
    T[:3, 3] += 0.6
    assert agreement(a, b, T).share < 0.7


@pytest.mark.parametrize("off", [0.2, -0.2])
def test_motion_that_no_surface_shows_stays_as_it_is(off: float) -> None:
    wall = depth_samples(np.full((60, 80), 2.0, np.float32), K)
    T = np.eye(4)
    T[:3, 3] = 0.1, off, 0.08
    found = register(wall, wall, T)
    np.testing.assert_allclose(found.T_a_b[:3, 3], (0.1, off, 0.0), atol=0.02)
    assert found.after.share > 0.99
