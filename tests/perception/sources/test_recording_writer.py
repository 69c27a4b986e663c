from pathlib import Path

import numpy as np
import pytest

from kg.model.errors import RecordingError
from perception.camera.poses import pose_from_quaternion, quaternion_from_pose
from perception.frames import Frame
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions
from perception.sources.recording_writer import RecordingWriter

K = np.array([[70.0, 0, 39.5], [0, 70.0, 29.5], [0, 0, 1]])


def rotation(rng: np.random.Generator) -> np.ndarray:
    q, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    return q if np.linalg.det(q) > 0 else -q


def frames(count: int) -> list[Frame]:
    rng = np.random.default_rng(1)
    out = []
    for k in range(count):
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = rotation(rng), rng.uniform(-3, 3, 3)
        depth = rng.uniform(0.5, 9, (60, 80)).astype(np.float32)
        depth[:5] = np.nan
        rgb = rng.integers(0, 256, (60, 80, 3), np.uint8)
        out.append(Frame(f"frame-{k:06d}", rgb, depth, K, T, 1.7e9 + 0.5 * k))
    return out


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    written = frames(3)
    with RecordingWriter(tmp_path / "new") as writer:
        for frame in written:
            writer.add(frame)
    recording = open_recording(tmp_path / "new", RecordingOptions(T_map_world=np.eye(4)))
    for before, after in zip(written, recording.frames(), strict=True):
        assert after.id == before.id and after.stamp == pytest.approx(before.stamp, abs=1e-6)
        assert np.array_equal(after.rgb, before.rgb)
        assert np.allclose(after.depth, before.depth, atol=1.1e-4, equal_nan=True)
        assert np.allclose(after.T_map_cam, before.T_map_cam, atol=1e-12)
        assert np.allclose(after.K, K)


def test_up_is_written_as_the_direction_of_gravity(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "new", up=(0, 0, 1)) as writer:
        writer.add(frames(1)[0])
    assert (tmp_path / "new" / "gravity-direction.txt").read_text().split()[2] == "-1"


def test_a_folder_that_holds_something_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(RecordingError, match="not empty; a new or an empty folder would work"):
        RecordingWriter(tmp_path)


def test_a_path_that_cannot_be_a_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordingError, match="cannot write into"):
        RecordingWriter(tmp_path / "file" / "new")


def test_quaternions_turn_back_into_the_rotations_they_came_from() -> None:
    rng = np.random.default_rng(2)
    for _ in range(50):
        T = np.eye(4)
        T[:3, :3] = rotation(rng)
        q = quaternion_from_pose(T)
        assert np.linalg.norm(q) == pytest.approx(1) and q[3] >= 0
        assert np.allclose(pose_from_quaternion(T[:3, 3], q, "here"), T, atol=1e-12)
