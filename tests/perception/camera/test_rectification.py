"""Depth as the colour camera sees it."""

import numpy as np
import pytest

from perception.camera.intrinsics import register_depth

K_DEPTH = np.array([[60.0, 0.0, 31.5], [0.0, 60.0, 23.5], [0.0, 0.0, 1.0]])
K_COLOUR = np.array([[30.0, 0.0, 15.5], [0.0, 30.0, 11.5], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("turned", [False, True])
def test_of_two_surfaces_in_one_pixel_the_nearer_is_seen(turned: bool) -> None:
    depth = np.full((48, 64), 3.0, np.float32)
    depth[1::2] = depth[:, 1::2] = 1.0  # each pixel of colour has both
    found = register_depth(
        depth[::-1, ::-1] if turned else depth, K_DEPTH, K_COLOUR, np.eye(4), (32, 24)
    )
    np.testing.assert_array_equal(found, 1.0)


def test_what_a_camera_beside_sees_is_nearer_to_the_other_side() -> None:
    T = np.eye(4)
    T[0, 3] = 0.1  # [m] from colour to depth
    depth = np.full((48, 64), np.nan, np.float32)
    depth[24, 32] = 1.5
    found = register_depth(depth, K_DEPTH, K_COLOUR, T, (32, 24))
    (row,), (column,) = np.nonzero(np.isfinite(found))
    assert found[row, column] == 1.5
    assert (row, column) == (12, round(15.5 + 30 * (0.5 / 60 + 0.1 / 1.5)))
