"""Wrong intrinsics are told by the views themselves; right ones never are."""

import logging
from dataclasses import replace

import numpy as np
import pytest

from kg.model.errors import RecordingError
from perception.camera.intrinsics import Intrinsics
from perception.frames import Frame
from perception.odometry.features import FeatureDetector, Image
from perception.sources.intrinsics_check import check_intrinsics, check_views
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions, Selection
from tests.perception.box_room import LARGE_K, papered_frame, pose

SHORT = LARGE_K * np.array([[0.75, 1, 1], [1, 0.75, 1], [1, 1, 1]])
LONG = LARGE_K * np.array([[1.25, 1, 1], [1, 1.25, 1], [1, 1, 1]])
SWAPPED = LARGE_K + np.array([[0, 0, -40.0], [0, 0, 40.0], [0, 0, 0]])


@pytest.fixture(scope="module")
def turning() -> list[Frame]:
    """A camera that turns to and fro in a papered room."""
    headings = 0.8 * np.sin(np.linspace(0, 7, 40))
    return [
        papered_frame(pose(-1.4, -0.8, h, pitch=0.2 + 0.2 * np.cos(3 * h)), number)
        for number, h in enumerate(headings)
    ]


def check(frames: list[Frame], K: np.ndarray) -> None:
    changed = [replace(frame, K=K) for frame in frames]
    check_intrinsics("room", [frame.T_map_cam for frame in frames], changed.__getitem__)


def test_right_intrinsics_pass_in_silence(turning, caplog):
    check(turning, LARGE_K)
    assert not caplog.records


@pytest.mark.parametrize("K", [SHORT, LONG, SWAPPED], ids=["short", "long", "swapped"])
def test_wrong_intrinsics_are_refused_and_the_fitting_ones_named(turning, K):
    wanted = r"room: its views fit .* about fx 2[78]\d, cx 1[56]\d, cy 1[12]\d where .*--intrinsics"
    with pytest.raises(RecordingError, match=wanted):
        check(turning, K)


def test_slightly_wrong_intrinsics_are_a_warning(turning, caplog):
    with caplog.at_level(logging.WARNING):
        check(turning, LARGE_K * np.array([[1.1, 1, 1], [1, 1.1, 1], [1, 1, 1]]))
    assert "its views fit each other by other intrinsics" in caplog.text


def test_views_without_poses_tell_too(turning):
    detector = FeatureDetector()
    views = [detector.features(Image.of(replace(frame, K=SHORT))) for frame in turning]
    with pytest.raises(RecordingError, match=r"about fx 2[78]"):
        check_views("room", views, SHORT)


def test_a_camera_that_never_turns_tells_nothing(caplog):
    frames = [papered_frame(pose(-1.5 + 0.04 * n, 0, 0.0), n) for n in range(20)]
    check(frames, SHORT)
    assert not caplog.records


@pytest.mark.parametrize("estimate", [False, True], ids=["given poses", "estimated poses"])
def test_a_real_kitchen_by_a_short_focal_length_is_refused(shared, estimate):
    options = RecordingOptions(
        intrinsics=Intrinsics(396.3, 396.3, 317.0, 238.6, source="wrong"),
        estimate_poses=estimate or None,
        selection=Selection(limit=60, every=1 if estimate else 2),
    )
    with pytest.raises(RecordingError, match=r"about fx 5\d\d.* where fx 396"):
        open_recording(shared("data/rgbd/redkitchen_tum"), options)
