"""Files of librealsense's own recorder, which the library writes from a device in software."""

import os
import sqlite3
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags")
from kg.model.errors import RecordingError
from perception.camera.poses import Pose
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions
from tests.perception.conftest import SIZE, K, room_depth
from tests.perception.sources.librealsense_recorder import STEP, T_COLOUR_DEPTH, UNIT, record
from tests.perception.sources.robot_bags import Bag
from tests.perception.sources.test_written_recordings import on_walls, points


def test_older_files_are_refused_with_what_converts_them(tmp_path: Path) -> None:
    path = tmp_path / "viewer.bag"
    made = Bag(path, ros1=True)
    grey = np.full((48, 64), 1000, np.uint16)
    for stamp in (1.0, 1.1):
        for topic in ("sensor_0/Depth_0", "sensor_1/Color_0"):
            made.camera(f"/device_0/{topic}/info/camera_info", stamp, "1")
        made.image("/device_0/sensor_0/Depth_0/image/data", stamp, grey, "mono16", "1")
        colour = np.zeros((48, 64, 3), np.uint8)
        made.image("/device_0/sensor_1/Color_0/image/data", stamp, colour, "rgb8", "1")
    made.bag.close()
    with pytest.raises(RecordingError, match=r"by librealsense.*works.*convert_bag_to_db3"):
        open_recording(path)


@pytest.fixture
def recorded(tmp_path: Path, room_views: list[Pose]) -> Path:
    """The room by a camera whose depth sensor sits beside its colour sensor."""
    rs = pytest.importorskip("pyrealsense2", reason="needs the extra realsense")
    if not hasattr(rs.context, "convert_bag_to_db3"):
        pytest.skip("this pyrealsense2 writes .bag")
    path = tmp_path / "room.db3"
    images = [
        (
            np.full((SIZE[1], SIZE[0], 3), 20 * number, np.uint8),
            room_depth(T @ T_COLOUR_DEPTH, K, SIZE),
        )
        for number, T in enumerate(room_views)
    ]
    record(path, images, K, T_colour_depth=T_COLOUR_DEPTH)
    return path


def _trajectory(path: Path, views: list[Pose], stamps: list[float]) -> Path:
    from perception.camera.poses import quaternion_from_pose

    rows = [
        " ".join(f"{x:.9f}" for x in (stamp, *T[:3, 3], *quaternion_from_pose(T)))
        for stamp, T in zip(stamps, views, strict=True)
    ]
    path.write_text("\n".join(rows))
    return path


@pytest.mark.parametrize("converted", [False, True])
def test_depth_is_registered_by_the_places_of_the_sensors(
    recorded: Path, tmp_path: Path, room_views: list[Pose], converted: bool
) -> None:
    if converted:
        _without_cameras(recorded)
    with pytest.raises(RecordingError, match="no poses"):
        open_recording(recorded, RecordingOptions(estimate_poses=False))
    stamps = [e.stamp for e in _listed(recorded)]
    poses = _trajectory(tmp_path / "poses.txt", room_views, stamps)
    recording = open_recording(recorded, RecordingOptions(poses=poses, T_map_world=np.eye(4)))
    assert recording.depth_scale == pytest.approx(1 / UNIT)
    assert np.diff(stamps) == pytest.approx([STEP] * 5, abs=1e-6)  # not as they arrived
    for number, frame in enumerate(recording.frames()):
        assert frame.rgb.mean() == pytest.approx(20 * number, abs=1)
        assert np.median(on_walls(points(frame))) < 0.01


def _listed(path: Path) -> Any:
    from perception.sources.bags import bag
    from perception.sources.listing import Streams

    return bag.read(path, Streams()).entries


def _without_cameras(path: Path) -> None:
    """As the library converts an older .bag: cameras in words alone."""
    with sqlite3.connect(path) as file:
        of_cameras = "SELECT id FROM topics WHERE type LIKE '%CameraInfo'"
        file.execute(f"DELETE FROM messages WHERE topic_id IN ({of_cameras})")
        file.execute("DELETE FROM topics WHERE type LIKE '%CameraInfo'")
    os.sync()
