"""RealSense cameras: files of librealsense, which the library itself plays as it would a device."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags")
pytest.importorskip("pyrealsense2", reason="needs the extra realsense")
from kg.model.errors import RecordingError
from perception.camera.poses import Pose, motion
from perception.frames import Frame
from perception.sources.live import stream
from perception.sources.live.live_recording import LiveRecording
from perception.sources.live.realsense import RealSenseCamera
from perception.sources.live.stream import FrameStream
from perception.sources.recording import FolderRecording, open_recording
from perception.sources.recording_options import RecordingOptions, Selection
from tests.perception.conftest import SIZE, K, room_depth
from tests.perception.sources.librealsense_recorder import (
    READINGS,
    START,
    STEP,
    T_COLOUR_DEPTH,
    SoftwareCamera,
    record,
)
from tests.perception.sources.test_written_recordings import on_walls, points

FRAMES = 24
OPTIONS = RecordingOptions(estimate_poses=True)
TILT = np.deg2rad(8)  # of the accelerometer against the floor


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream, "SETTLING", 0.0)
    monkeypatch.setattr(stream, "SILENT", 0.0)
    monkeypatch.setattr(stream, "PATIENCE", 0.05)


@pytest.fixture
def room(tmp_path: Path, room_views: list[Pose]) -> Path:
    """The room by a camera whose depth sensor sits beside its colour sensor."""
    colours = [np.full((SIZE[1], SIZE[0], 3), 20 * n, np.uint8) for n in range(len(room_views))]
    depths = [room_depth(T @ T_COLOUR_DEPTH, K, SIZE) for T in room_views]
    path, images = tmp_path / "room.db3", zip(colours, depths, strict=True)
    record(path, images, K, T_colour_depth=T_COLOUR_DEPTH, pause=0.2)
    return path


def camera(path: Path) -> RealSenseCamera:
    return RealSenseCamera.at(f"realsense:{path}")


@contextmanager
def playing(source: RealSenseCamera) -> Iterator[tuple[FrameStream, list[Exception]]]:
    """The stream of a camera that runs, and what its run raised."""
    made, ended, raised = FrameStream(source.address, OPTIONS), threading.Event(), list[Exception]()

    def run() -> None:
        try:
            source.run(made, ended)
        except RecordingError as error:
            raised.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield made, raised
    finally:
        ended.set()
        thread.join()


def test_frames_have_depth_where_colour_sees_it(room: Path, room_views: list[Pose]) -> None:
    found = dict[int, Frame]()
    with playing(camera(room)) as (made, raised):
        while (frame := made.next_frame(2)) is not None:
            found[round((float(frame.id) - START) / STEP)] = frame
    assert not raised
    assert len(found) >= 2
    assert max(found) == len(room_views) - 1
    for number, frame in found.items():
        assert np.allclose(frame.K, K, atol=1e-4)
        assert (frame.rgb == 20 * number).all()
        seen = points(replace(frame, T_map_cam=room_views[number]))
        assert len(seen) > SIZE[0] * SIZE[1] / 2
        assert np.median(on_walls(seen)) < 0.01


@pytest.fixture
def played(shared, tmp_path):
    """Callable: real images with an accelerometer that says up of the first, or is shaken."""

    def make(*, shaken: bool) -> tuple[LiveRecording, dict[str, Frame]]:
        options = RecordingOptions(check=False, selection=Selection(limit=FRAMES))
        truth: FolderRecording = open_recording(shared("data/rgbd/icl_livingroom"), options)
        frames = list(truth.frames())
        up = frames[0].T_map_cam[:3, :3].T @ [0, np.sin(TILT), np.cos(TILT)]
        shake = np.array([[3.0, 0, 0], [-3.0, 0, 0]]) if shaken else np.zeros((2, 3))
        path = tmp_path / "room.db3"
        images = [(frame.rgb, frame.depth) for frame in frames]
        readings = (9.81 * up + shake).tolist()
        record(path, images, frames[0].K, pause=STEP, accelerations=readings)
        made = FrameStream("realsense", OPTIONS)
        live = LiveRecording("live", camera(path), made, threading.Event())
        by_id = {f"{START + STEP * n:.3f}": frame for n, frame in enumerate(frames)}
        return live, by_id

    return make


@pytest.mark.parametrize("shaken", [False, True])
def test_a_camera_is_tracked_and_levelled_by_its_accelerometer_at_rest(played, shaken) -> None:
    live, true = played(shaken=shaken)
    live.level()
    found = {f"{float(frame.id):.3f}": frame.T_map_cam for frame in live.frames()}
    assert len(found) >= 3
    first = next(iter(found))
    for name, T in found.items():
        apart = np.linalg.inv(true[first].T_map_cam) @ true[name].T_map_cam
        far, turned = motion(apart, np.linalg.inv(found[first]) @ T)
        assert far < 0.05
        assert turned < np.deg2rad(2)
    R = true[first].T_map_cam[:3, :3]
    told, by_floor = R.T @ [0, np.sin(TILT), np.cos(TILT)], R.T @ [0, 0, 1.0]
    assert angle(found[first][:3, :3] @ (by_floor if shaken else told)) < np.deg2rad(3)


def angle(up: np.ndarray) -> float:
    """Angle [rad] of a direction from z."""
    return float(np.arccos(np.clip(up[2], -1, 1)))


def test_a_camera_that_is_unplugged_ends_with_a_line(room: Path) -> None:
    source = camera(room)
    with playing(source) as (made, raised):
        assert made.next_frame(5) is not None
        source.device.as_playback().pause()
        source.context.unload_device(str(room))
        for _ in range(50):
            if raised:
                break
            made.next_frame(0.1)
    assert [str(error) for error in raised] == [f"realsense:{room}: the camera was unplugged"]


@pytest.mark.parametrize(
    ("streams", "said"), [(["depth"], "its streams: depth"), (["color"], "its streams: color")]
)
def test_a_camera_without_colour_or_depth_is_refused(tmp_path, streams, said):
    images = [(np.zeros((*SIZE[::-1], 3), np.uint8), np.ones(SIZE[::-1], np.float32))]
    record(tmp_path / "half.db3", images, K, streams=streams)
    with pytest.raises(RecordingError, match=f"no colour with depth; {said}"):
        camera(tmp_path / "half.db3")


def test_a_device_tells_up_by_the_place_of_its_accelerometer(room_views: list[Pose]) -> None:
    import pyrealsense2 as rs

    made = SoftwareCamera(rs, K, SIZE[::-1], ("depth", "color", "accel"), T_COLOUR_DEPTH)
    source = RealSenseCamera.of("realsense", rs.context(), made.device)
    depth = np.full(SIZE[::-1], 4000, np.uint16)
    with playing(source) as (stream, raised):
        for number in range(8):
            for reading in range(READINGS * number, READINGS * (number + 1)):
                made.read([0.0, -9.81, 0.0], reading)
                time.sleep(0.005)
            made.see("depth", depth, number)
            made.see("color", np.zeros((*depth.shape, 3), np.uint8), number)
        frame = stream.next_frame(5)
        assert frame is not None
        assert np.nanmedian(frame.depth) == pytest.approx(2.0, abs=0.1)
        up = stream.up_of_camera(frame)
        assert up == pytest.approx(T_COLOUR_DEPTH[:3, :3] @ [0, -1.0, 0], abs=1e-3)
        while not raised:  # no context knows such a device
            stream.next_frame(0.1)
    assert str(raised[0]) == "realsense: the camera was unplugged"


def test_a_camera_that_is_gone_before_its_first_frame_is_an_error(room: Path) -> None:
    source = camera(room)
    source.device.as_playback().pause()
    source.context.unload_device(str(room))
    made = FrameStream(source.address, OPTIONS)
    live = LiveRecording("live", source, made, threading.Event())
    with pytest.raises(RecordingError, match="the camera was unplugged"):
        live.level()
