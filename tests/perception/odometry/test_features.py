"""Corners have the depth of their surface, are spread, and match those that look alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from perception.odometry.features import FeatureDetector, Image, depth_at, matched
from tests.perception.box_room import LARGE_K, papered_frame, pose

FRAME = papered_frame(pose(-1.2, -0.8, 0.2), 0)


@pytest.fixture(scope="module")
def features():
    return FeatureDetector().features(Image.of(FRAME))


def test_points_are_where_the_corners_are(features):
    back = (features.points @ LARGE_K.T)[:, :2] / features.points[:, 2:]
    np.testing.assert_allclose(back, features.pixels, atol=1e-6)
    column, row = np.rint(features.pixels).astype(int).T
    near = np.abs(FRAME.depth[row, column] - features.points[:, 2])
    assert np.percentile(near, 95) < 0.05
    assert len(features) > 200


def test_the_first_ones_are_spread_over_the_image(features):
    cells = {tuple(cell) for cell in (features.pixels[:60] // (80, 80)).astype(int)}
    assert len(cells) == 12, "all 4 x 3 parts of 80 px"


def test_images_match_themselves(features):
    a, b = matched(features, features)
    np.testing.assert_array_equal(a, b)
    assert len(set(a.tolist())) == len(a) > 100


def test_exposure_hardly_matters(features):
    dim = replace(FRAME, rgb=(FRAME.rgb * 0.4).astype(np.uint8))
    a, b = matched(features, FeatureDetector().features(Image.of(dim)))
    assert len(a) > 80
    same = np.linalg.norm(
        features.pixels[a] - FeatureDetector().features(Image.of(dim)).pixels[b], axis=1
    )
    assert np.median(same) < 1


def test_depth_of_edges_and_holes_is_unknown():
    depth = np.full((40, 40), 2.0, np.float32)
    depth[:, 20:] = 3.0
    depth[5:15, 5:15] = np.nan
    depth[30, 5] = np.nan
    z = depth_at(depth, np.array([[10.0, 30], [20, 30], [10, 10], [30, 20], [5, 30], [0, 0]]))
    np.testing.assert_allclose(z, [2, np.nan, np.nan, 3, 2, 2])


def test_depth_that_is_too_near_or_too_far_is_unknown():
    for far in (0.05, 9.0):
        assert np.isnan(depth_at(np.full((9, 9), far, np.float32), np.array([[4.0, 4.0]]))[0])


def test_still_parts_have_no_corners():
    still = np.zeros(FRAME.depth.shape, np.bool_)
    still[:, :160] = True
    found = FeatureDetector().features(Image.of(FRAME, still))
    assert len(found) > 50
    assert found.pixels[:, 0].min() >= 158
