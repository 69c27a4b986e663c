"""Recordings with faults: poses are right, left out or refused, and never silently wrong."""

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from benchmarks.odometry.accuracy import Accuracy, accuracy
from benchmarks.odometry.faults import FAULTS
from benchmarks.odometry.houses import alike_rooms
from perception.frames import Frame
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions, Selection

FRAMES = 40


@pytest.fixture(scope="module")
def kitchen(shared) -> list[Frame]:
    """The first frames of a real kitchen, with true poses."""
    options = RecordingOptions(check=False, selection=Selection(limit=FRAMES))
    return list(open_recording(shared("data/rgbd/redkitchen_tum"), options).frames())


@pytest.fixture(scope="module")
def found_with(kitchen: list[Frame]) -> Callable[[str], Accuracy]:
    """Callable: name of a fault -> the accuracy with it, found once."""
    return cache(lambda fault: accuracy(FAULTS[fault](list(kitchen), np.random.default_rng(1))))


def test_sound_images_are_tracked(kitchen):
    found = accuracy(kitchen)
    assert found.report.tracked == FRAMES
    assert found.worst < 0.1
    assert not found.refused


@pytest.mark.parametrize(
    "fault",
    [
        *("blur", "black", "near_hand", "crowd", "no_depth", "frozen_colour", "gripper"),
        *("shuffled", "noisy_depth"),
    ],
)
def test_faults_end_in_missing_poses_and_not_in_wrong_ones(found_with, fault):
    found = found_with(fault)
    assert not found.silently_wrong, found.row()
    assert found.refused or found.report.tracked >= FRAMES // 3


def test_black_images_have_no_pose(kitchen, found_with):
    changed = FAULTS["black"](list(kitchen), np.random.default_rng(1))
    found = found_with("black").report
    black = [not frame.rgb.any() for frame in changed]
    known = [one is not None for one in found.deviation]
    assert not any(np.array(known) & np.array(black))
    assert known[0]
    assert f"{FRAMES - sum(known)} frames without a pose are left out" in found.summary()


def test_rooms_that_look_alike_are_not_joined_on_a_drive():
    frames = alike_rooms(slice(60))
    far = int(np.abs(frames[3].rgb.astype(int) - frames[53].rgb).max(axis=2).mean())
    assert far <= 1, "5 m apart, the same view"
    found = accuracy(frames)
    assert found.report.tracked == len(frames)
    assert found.worst < 0.05, found.row()
