"""Frames of a live camera are kept until its run ends, and read again by other poses."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags")
from perception.frames import Frame
from perception.sources.live import live_recording
from perception.sources.live.live_recording import KeptFrames
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions, Selection


@pytest.fixture
def room(shared: Callable[[str], Path]) -> list[Frame]:
    options = RecordingOptions(check=False, selection=Selection(limit=6))
    return list(open_recording(shared("data/rgbd/icl_livingroom"), options).frames())


def test_kept_frames_come_back_by_the_poses_that_are_asked_for(room):
    raised = np.eye(4)
    raised[2, 3] = 0.5
    with KeptFrames() as kept:
        for frame in room:
            kept.add(frame)
        as_mapped = kept.recording("live", raised)
        assert np.array_equal(as_mapped.T_map_world, raised)
        poses = {frame.id: raised @ frame.T_map_cam for frame in room}
        moved = list(kept.recording("live", raised, poses).frames())
        for frame, same, other in zip(room, as_mapped.frames(), moved, strict=True):
            assert (same.id, same.stamp) == (frame.id, frame.stamp)
            assert np.array_equal(same.rgb, frame.rgb)
            assert np.array_equal(same.K, frame.K)
            assert np.allclose(same.depth, frame.depth, atol=1.1e-4, equal_nan=True)
            assert np.allclose(same.T_map_cam, frame.T_map_cam)
            assert np.allclose(other.T_map_cam, raised @ frame.T_map_cam)
        kept.moved(poses)
        again = kept.recording("live", np.eye(4)).frame(3)
        assert np.allclose(again.T_map_cam, poses[room[3].id])


def test_no_more_than_some_frames_are_kept_and_none_after_the_run(room, monkeypatch, tmp_path):
    monkeypatch.setattr(live_recording, "MAX_FRAMES", 4)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with KeptFrames() as kept:
        for number, frame in enumerate(room):
            assert kept.whole is (number < 5)
            kept.add(frame)
        assert not kept.whole
        assert len(kept) == 4
        assert len(list(tmp_path.glob("*/rgb/*.png"))) == 4
    assert not list(tmp_path.iterdir())
