from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from mapping.frames.pose_monitor import PoseMonitor
from perception.camera.channel_order import MIN_VIEWS, ChannelOrder
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions

ROOMS = ["data/rgbd/redkitchen", "data/rgbd/hololens_lounge", "data/rgbd/icl_livingroom"]


def told(images) -> str:
    order = ChannelOrder()
    for rgb in images:
        order.add(rgb)
    return order.told


@pytest.mark.parametrize("data", ROOMS)
def test_exchanged_channels_are_told_where_a_recording_is_opened_and_mended_by_an_option(
    shared, tmp_path, caplog, data
):
    recording = open_recording(shared(data), RecordingOptions(T_map_world=np.eye(4)))
    assert "blue, green, red" not in caplog.text
    for name in ("rgb", "depth"):
        (tmp_path / name).mkdir()
    for n in range(0, len(recording), len(recording) // 14):
        frame = recording.frame(n)
        cv2.imwrite(str(tmp_path / f"rgb/{n}.png"), frame.rgb)  # as RGB is written by mistake
        depth = np.nan_to_num(frame.depth * 1000).astype(np.uint16)
        cv2.imwrite(str(tmp_path / f"depth/{n}.png"), depth)
        np.savetxt(tmp_path / "K.txt", frame.K)
        (tmp_path / "pose").mkdir(exist_ok=True)
        np.savetxt(tmp_path / f"pose/{n}.txt", frame.T_map_cam)
    made = open_recording(tmp_path, RecordingOptions(T_map_world=np.eye(4)))
    assert "--bgr" in caplog.text
    caplog.clear()
    mended = open_recording(tmp_path, RecordingOptions(T_map_world=np.eye(4), bgr=True))
    assert "--bgr" not in caplog.text
    first = recording.frame(0).rgb
    np.testing.assert_array_equal(mended.frame(0).rgb, first)
    np.testing.assert_array_equal(made.frame(0).rgb, first[:, :, ::-1])


@pytest.mark.parametrize("folder", ["rooms", "places365_val120"])
def test_photographs_of_rooms_are_told_apart_from_those_with_exchanged_channels(shared, folder):
    for kind in sorted(Path(shared(f"data/images/{folder}")).iterdir()):
        images = [cv2.imread(str(path)) for path in sorted(kind.glob("*.jpg"))]
        if len(images) >= MIN_VIEWS:
            assert told(images), kind
            assert not told([bgr[:, :, ::-1] for bgr in images]), kind


def test_a_program_that_gives_exchanged_channels_is_told(shared):
    options = RecordingOptions(T_map_world=np.eye(4), check=False)
    frames = list(open_recording(shared("data/rgbd/hololens_lounge"), options).frames())[::3]
    for exchanged in (False, True):
        monitor = PoseMonitor("live")
        for frame in frames:
            rgb = np.ascontiguousarray(frame.rgb[:, :, ::-1])
            monitor.add(replace(frame, rgb=rgb) if exchanged else frame)
        assert ("order" in monitor.problems) == exchanged
        assert not exchanged or "rgb[:, :, ::-1] of a frame" in monitor.problems["order"]


def test_grey_images_and_few_images_tell_nothing():
    blue = np.zeros((60, 80, 3), np.uint8)
    blue[..., 2] = 200
    assert told([blue] * MIN_VIEWS)
    assert not told([blue] * (MIN_VIEWS - 1))
    assert not told([np.full((60, 80, 3), 128, np.uint8)] * MIN_VIEWS)
