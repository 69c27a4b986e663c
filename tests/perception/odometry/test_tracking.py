"""Tracking: features, frozen images, still parts and sizes of frames."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from perception.camera.poses import motion
from perception.frames import Frame
from perception.odometry.features import (
    MAX_SIDE,
    FeatureDetector,
    FrozenImages,
    Image,
    StillParts,
    depth_at,
    matched,
    shrunk,
)
from perception.odometry.tracking import Odometry, tracked
from tests.perception.box_room import LARGE_K, papered_frame, pose
from tests.perception.conftest import look_at, room_depth

WAY = [pose(-1.6 + 0.05 * n, -1.0 + 0.02 * n, 0.5 * np.sin(0.15 * n)) for n in range(30)]


@pytest.fixture(scope="module")
def frames() -> list[Frame]:
    return [papered_frame(T, number) for number, T in enumerate(WAY)]


def worst(poses, frames) -> float:
    """Largest error [m] of the positions, from the first image on."""
    first = frames[0].T_map_cam
    return max(
        motion(first @ T, frame.T_map_cam)[0]
        for T, frame in zip(poses, frames, strict=True)
        if T is not None
    )


def test_every_image_has_its_pose(frames):
    odometry = tracked(lambda: frames)
    poses, report = odometry.poses(), odometry.report()
    assert report.tracked == report.frames == len(frames)
    assert report.pieces == 1
    assert worst(poses, frames) < 0.02
    assert abs(report.way - 0.05 * 29 * np.hypot(1, 0.4)) < 0.15
    assert not report.contradicts_itself
    assert report.error < 0.2


def noisy(frame: Frame, share: float) -> Frame:
    """Depth that is off by a `share` of itself a metre, alike in neighbouring pixels."""
    noise = np.random.default_rng(int(frame.stamp)).normal(0, 1, frame.depth.shape)
    noise = cv2.GaussianBlur(noise.astype(np.float32), (0, 0), 3)
    off = share * frame.depth * noise / noise.std()
    return replace(frame, depth=frame.depth * (1 + off))


def test_noisy_depth_makes_no_pieces(frames):
    changed = [noisy(frame, 0.03) for frame in frames]
    odometry = tracked(lambda: changed)
    report = odometry.report()
    assert (report.pieces, report.tracked) == (1, len(frames))
    assert report.noise == pytest.approx(0.03, rel=0.5)
    assert worst(odometry.poses(), changed) < 0.15


def test_a_way_back_closes_a_loop(frames):
    there_and_back = [*frames, *frames[::-1]]
    odometry = tracked(lambda: there_and_back)
    poses, report = odometry.poses(), odometry.report()
    assert report.loops > 0
    assert worst(poses, there_and_back) < 0.02


def test_black_images_have_no_pose_and_the_rest_goes_on(frames):
    changed = list(frames)
    for n in range(12, 16):
        changed[n] = replace(frames[n], rgb=np.zeros_like(frames[n].rgb))
    odometry = tracked(lambda: changed)
    poses = odometry.poses()
    assert [n for n, T in enumerate(poses) if T is None] == [12, 13, 14, 15]
    assert "1 of them show too few corners" in odometry.report().summary()
    assert worst(poses, changed) < 0.03


def test_two_rooms_that_show_nothing_of_each_other_are_two_pieces(frames):
    other = [papered_frame(T, 100 + n, seed=9) for n, T in enumerate(WAY[:12])]
    odometry = tracked(lambda: [*frames, *other])
    report = odometry.report()
    assert report.pieces == 2
    assert report.tracked == len(frames), "only the longer piece has poses"
    assert "12 frames without a pose are left out" in report.summary()


def test_a_repeated_image_over_new_depth_is_not_followed(frames):
    odometry = Odometry()
    assert odometry.add(frames[0])
    assert not odometry.add(replace(frames[5], rgb=frames[0].rgb))
    assert odometry.poses()[1] is None


def test_images_of_a_frozen_driver_have_no_pose(frames):
    frozen = [replace(frame, rgb=frames[8].rgb) for frame in frames[14:24:2]]
    images = [*frames[:9], *frozen, *frames[26:]]
    poses = tracked(lambda: images).poses()
    assert [n for n, T in enumerate(poses) if T is None] == [9, 10, 11, 12, 13]
    assert worst(poses, images) < 0.03


def test_images_far_apart_are_tracked():
    way = [pose(-1.6 + 0.6 * n, -1.0 + 0.24 * n, 0.5 * np.sin(1.8 * n)) for n in range(4)]
    images = [papered_frame(T, number) for number, T in enumerate(way)]
    poses = tracked(lambda: images).poses()
    assert all(T is not None for T in poses)
    assert worst(poses, images) < 0.03


def test_poses_of_frames_are_not_read(frames):
    without = [replace(frame, T_map_cam=np.eye(4)) for frame in frames[:8]]
    for T, U in zip(
        tracked(lambda: without).poses(), tracked(lambda: frames[:8]).poses(), strict=True
    ):
        assert T is not None
        np.testing.assert_array_equal(T, U)


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


T = look_at((0, 0, 1.4), (2, 0.5, 0.7))


def frame(width: int, height: int) -> Frame:
    K = np.array([[0.8 * width, 0, 0.51 * width], [0, 0.8 * width, 0.48 * height], [0, 0, 1.0]])
    depth = room_depth(T, K, (width, height)).astype(np.float32)
    rgb = np.repeat((depth * 50).astype(np.uint8)[..., None], 3, axis=2)
    return Frame("1", rgb, depth, K, T, 0.0)


@pytest.mark.parametrize("size", [(4001, 3001), (1921, 1080), (1080, 1921)])
def test_shrunk_depth_is_that_of_the_shrunk_camera(size: tuple[int, int]) -> None:
    small = shrunk(frame(*size))
    assert max(small.depth.shape) <= MAX_SIDE < max(size)
    assert small.rgb.shape[:2] == small.depth.shape
    expected = room_depth(T, small.K, small.depth.shape[::-1])
    assert np.median(np.abs(small.depth - expected)) < 0.002
    assert np.abs(small.rgb[..., 0] - small.depth * 50).mean() < 2


def test_images_of_usual_size_stay() -> None:
    usual = frame(MAX_SIDE, 720)
    assert shrunk(usual) is usual


RANDOM = np.random.default_rng(0)


def colour(bright: float) -> np.ndarray:
    return np.clip(bright + RANDOM.normal(0, 5, (240, 320, 3)), 0, 255).astype(np.uint8)


def depth(metres: float) -> np.ndarray:
    """Depth with the noise of a sensor, and a part without return."""
    made = (metres * RANDOM.normal(1, 0.01, (240, 320))).astype(np.float32)
    made[:, :9] = np.nan
    return made


def known(rgb: list[np.ndarray], z: list[np.ndarray]) -> tuple[list[bool], int]:
    frozen = FrozenImages()
    frames = (Frame("1", a, b, np.eye(3), np.eye(4), 0.0) for a, b in zip(rgb, z, strict=True))
    return [not frozen.add(frame) for frame in frames], frozen.count


def test_frozen_depth_is_noticed_until_it_changes() -> None:
    frozen = depth(1.5)
    z = [frozen if n in (1, 2, 3) else depth(1 + n / 4) for n in range(6)]
    rgb = [colour(20 * n) for n in range(6)]
    assert known(rgb, z) == ([True, True, False, False, True, True], 2)


def test_frozen_colour_is_noticed_until_it_changes() -> None:
    frozen = colour(80)
    rgb = [frozen if n in (1, 2, 3) else colour(20 * n) for n in range(6)]
    z = [depth(1 + n / 4) for n in range(6)]
    assert known(rgb, z) == ([True, True, False, False, True, True], 2)


def test_a_camera_that_stands_still_is_not_frozen() -> None:
    same, still = depth(1.5), colour(100)
    assert known([colour(100) for _ in range(5)], [same] * 5) == ([True] * 5, 0)
    assert known([still] * 5, [depth(1.5) for _ in range(5)]) == ([True] * 5, 0)
    assert known([still] * 5, [same] * 5) == ([True] * 5, 0)


#: in the hand: the floor's depth changes as the camera nods
@pytest.fixture(scope="module")
def moving() -> list[np.ndarray]:
    return [
        papered_frame(pose(-1.5, -0.8, 0.1 * n, pitch=0.3 + 0.2 * np.sin(n)), n).depth
        for n in range(16)
    ]


def found(depths: list[np.ndarray]) -> np.ndarray | None:
    parts = StillParts()
    for depth in depths:
        parts.add(depth)
    return parts.found(depths[0].shape)


def with_gripper(depth: np.ndarray, off: float = 0.0) -> np.ndarray:
    changed = depth.copy()
    changed[160:, :120] = 0.4 + off
    return changed


def test_a_gripper_is_found_where_it_is(moving):
    still = found([with_gripper(depth, 0.002 * (n % 2)) for n, depth in enumerate(moving)])
    assert still is not None
    assert still.dtype == np.bool_
    assert still[165:, :115].mean() > 0.95
    assert still[:140].mean() < 0.05
    assert still[165:, 150:].mean() < 0.05


def test_a_moving_camera_alone_has_no_still_parts(moving):
    assert found(moving) is None


def test_a_camera_that_stays_has_none_either(moving):
    assert found([moving[0]] * 16) is None


def test_a_few_images_are_not_enough(moving):
    assert found([with_gripper(depth) for depth in moving[:3]]) is None


def test_a_thing_that_comes_near_later_is_not_still(moving):
    late = [*moving[:8], *(with_gripper(depth) for depth in moving[8:])]
    assert found(late) is None
