"""Tracking through a papered room: poses, loops, pieces and lost images."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from perception.camera.poses import motion
from perception.frames import Frame
from perception.odometry.tracking import Odometry, tracked
from tests.perception.box_room import papered_frame, pose

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
    poses = tracked(lambda: changed).poses()
    assert [n for n, T in enumerate(poses) if T is None] == [12, 13, 14, 15]
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
