"""Recordings of a phone with LiDAR, held upright or on its side."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from perception.camera.poses import quaternion_from_pose
from perception.frames import Frame
from perception.sources.recording import FolderRecording, open_recording
from perception.sources.recording_options import RecordingOptions
from tests.perception.conftest import SIZE, K, room_depth
from tests.perception.sources.test_written_recordings import on_walls, points

#: Takes the room (z up) to ARKit's world (y up).
T_WORLD_ROOM = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
T_CAM_TURNED = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
HEADER = "timestamp, frame, x, y, z, qx, qy, qz, qw\n"
Phone = Callable[..., Path]


@pytest.fixture
def phone(tmp_path: Path, room_views: list[NDArray[np.float64]]) -> Phone:
    """Writes the room as a phone that is held `turns` quarters from upright records it."""

    def write(turns: int = 0) -> Path:
        folder = tmp_path / "71de12f9"
        for part in ("depth", "confidence"):
            (folder / part).mkdir(parents=True)
        aside = np.linalg.matrix_power(np.linalg.inv(T_CAM_TURNED), turns)
        video = cv2.VideoWriter(str(folder / "rgb.mp4"), _CODEC, 30, SIZE)
        lines = [HEADER]
        for i, T_room_upright in enumerate(room_views):
            T_room_phone = T_room_upright @ aside
            depth = np.rint(room_depth(T_room_phone, K, SIZE) * 1000).astype(np.uint16)[::2, ::2]
            cv2.imwrite(str(folder / "depth" / f"{i:06}.png"), depth)
            sure = np.full(depth.shape, 2, np.uint8)
            sure[:, 0] = 0
            cv2.imwrite(str(folder / "confidence" / f"{i:06}.png"), sure)
            video.write(_striped(i, turns))
            T = T_WORLD_ROOM @ T_room_phone
            pose = (*T[:3, 3], *quaternion_from_pose(T))
            lines.append(f"{7000 + i / 30}, {i:06}, {', '.join(map(repr, map(float, pose)))}\n")
        video.release()
        (folder / "odometry.csv").write_text("".join(lines))
        np.savetxt(folder / "camera_matrix.csv", K, delimiter=", ")
        return folder

    return write


_CODEC = cv2.VideoWriter.fourcc(*"mp4v")


def _striped(number: int, turns: int) -> NDArray[np.uint8]:
    """What the phone's camera shows: bright where up is, as bright as the number says below."""
    upright = SIZE if turns % 2 == 0 else SIZE[::-1]
    image = np.full((upright[1], upright[0], 3), 20 * number, np.uint8)
    image[: upright[1] // 3] = 250
    return np.ascontiguousarray(np.rot90(image, -turns))


def in_room(path: Path) -> FolderRecording:
    return open_recording(path, RecordingOptions(T_map_world=np.linalg.inv(T_WORLD_ROOM)))


def upright_frames(path: Path, kind: str, turns: int) -> list[Frame]:
    """The six frames of a phone's recording, each as the room is; their lower rows are grey."""
    recording = in_room(path)
    assert recording.format == kind
    frames = list(recording.frames())
    assert [frame.id for frame in frames] == [f"{i:06}" for i in range(6)]
    for i, frame in enumerate(frames):
        assert frame.rgb.shape[:2] == (SIZE[::-1] if turns % 2 == 0 else SIZE)
        assert frame.depth.shape == frame.rgb.shape[:2]
        assert frame.rgb[-20:].mean() == pytest.approx(20 * i, abs=6)
        assert frame.T_map_cam[2, 1] < -0.8  # the camera's y points down
        assert np.median(on_walls(points(frame))) < 0.02
        assert np.isnan(frame.depth).mean() == pytest.approx(1 / 80, abs=0.01)  # unsure depth
    assert np.diff([frame.stamp for frame in frames]) == pytest.approx([1 / 30] * 5, abs=1e-6)
    return frames


@pytest.mark.parametrize("turns", range(4))
def test_frames_stand_upright_however_the_phone_was_held(phone: Phone, turns: int) -> None:
    for frame in upright_frames(phone(turns), "stray-scanner", turns):
        assert frame.rgb[:20].mean() > 230


def test_frames_are_the_same_in_any_order(phone: Phone) -> None:
    recording, order = in_room(phone()), (5, 0, 3, 3, 1)
    forward = [frame.rgb.mean() for frame in recording.frames()]
    assert [recording.frame(i).rgb.mean() for i in order] == [forward[i] for i in order]


def test_up_is_that_of_the_phone(phone: Phone) -> None:
    np.testing.assert_allclose(open_recording(phone(1)).T_map_world[2, :3], [0, 1, 0], atol=1e-9)


def _cut(path: Path) -> None:
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])


def _playlist(path: Path) -> None:
    path.write_text("#EXTM3U\n#EXTINF:1,\nhttp://127.0.0.1:9/never.ts\n#EXT-X-ENDLIST\n")


@pytest.mark.parametrize(
    ("name", "damage", "said"),
    [
        ("rgb.mp4", _cut, "cannot be decoded"),
        ("rgb.mp4", _playlist, "is no MP4 or MOV video"),
        ("odometry.csv", lambda p: p.write_text(HEADER), "no depth image has a pose"),
        ("odometry.csv", lambda p: p.write_text(HEADER + "1, 0, 1, 2\n"), "no value of 'z'"),
        (
            "odometry.csv",
            lambda p: p.write_text(HEADER + "1,nan,0,0,0,0,0,0,1\n"),
            "finite numbers",
        ),
        ("odometry.csv", lambda p: p.write_text(HEADER + "1,0,0,0,0,0,0,0,9\n"), "length 1"),
        ("odometry.csv", lambda p: p.write_bytes(b"\xff\xfe\x00"), "not a text file"),
        ("camera_matrix.csv", lambda p: p.write_text("1, 2\n"), "9 numbers"),
        ("camera_matrix.csv", lambda p: p.unlink(), "camera_matrix.csv is missing"),
        ("confidence/000002.png", _cut, "truncated"),
    ],
)
def test_damage_is_refused(phone, name, damage, said):
    folder = phone()
    damage(folder / name)
    with pytest.raises(RecordingError, match=said):
        list(open_recording(folder, RecordingOptions(T_map_world=np.eye(4))).frames())


def test_without_poses_they_are_to_be_estimated(phone: Phone) -> None:
    folder = phone()
    (folder / "odometry.csv").unlink()
    with pytest.raises(RecordingError, match=r"has no poses: odometry\.csv is missing"):
        open_recording(folder, RecordingOptions(estimate_poses=False))


def test_a_pose_beyond_the_video_is_refused(phone: Phone) -> None:
    folder = phone()
    with (folder / "odometry.csv").open("a") as file:
        file.write("7001, 9, 0, 0, 0, 0, 0, 0, 1\n")
    (folder / "depth" / "000009.png").symlink_to("000001.png")
    with pytest.raises(RecordingError, match="has 6 frames"):
        open_recording(folder, RecordingOptions(T_map_world=np.eye(4)))
