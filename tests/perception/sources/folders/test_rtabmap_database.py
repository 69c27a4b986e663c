"""Databases as RTAB-Map writes them: its schema, its serialisation of cameras, images and poses."""

import sqlite3
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import pytest

from kg.model.errors import RecordingError
from perception.camera.poses import motion
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions
from tests.perception.conftest import SIZE, K, room_depth
from tests.perception.sources.ros.test_image_messages import rvl

OPTIONS = RecordingOptions(check=False)
STAMPS = [1_700_000_000.0 + i / 2 for i in range(6)]
MOUNT = np.array([[0.0, 0, 1, 0.2], [-1, 0, 0, 0], [0, -1, 0, 0.9], [0, 0, 0, 1]])
SCHEMA = """
CREATE TABLE Node (id INTEGER NOT NULL, map_id INTEGER NOT NULL, weight INTEGER, stamp FLOAT,
    pose BLOB, label TEXT, PRIMARY KEY (id));
CREATE TABLE Data (id INTEGER NOT NULL, image BLOB, depth BLOB, calibration BLOB, PRIMARY KEY (id));
CREATE TABLE Link (from_id INTEGER NOT NULL, to_id INTEGER NOT NULL, type INTEGER NOT NULL,
    information_matrix BLOB NOT NULL, transform BLOB);
CREATE TABLE Admin (version TEXT, opt_ids BLOB, opt_poses BLOB);
"""


def pose(T: np.ndarray) -> bytes:
    return T[:3].astype("<f4").tobytes()


def packed(numbers: np.ndarray) -> bytes:
    """As RTAB-Map compresses a matrix of one row: zlib, then rows, columns and OpenCV's type."""
    kind = cv2.CV_32S if numbers.dtype == np.int32 else cv2.CV_32F
    return zlib.compress(numbers.tobytes()) + struct.pack("<3i", 1, numbers.size, kind)


def png(image: np.ndarray) -> bytes:
    return cv2.imencode(".png", image)[1].tobytes()


def millimetres(depth: np.ndarray) -> np.ndarray:
    return np.rint(np.nan_to_num(depth) * 1000).astype(np.uint16)


def as_rvl(depth: np.ndarray) -> bytes:
    return b"DEPTHRVL" + rvl(millimetres(depth))


def as_floats(depth: np.ndarray) -> bytes:
    return png(np.ascontiguousarray(depth, np.float32).view(np.uint8).reshape(*depth.shape, 4))


def camera(mount: np.ndarray = MOUNT, kind: int = 0, P: bool = True) -> bytes:
    """Of a rectified image: K and D are of the lens, and the image follows P."""
    lens, D = (K * [[1.1], [1.1], [1]]).ravel() if P else K.ravel(), np.zeros(5)
    projection = np.hstack([K, np.zeros((3, 1))]).ravel() if P else np.zeros(0)
    numbers = np.concatenate([lens, D, np.eye(3).ravel(), projection]).astype("<f8")
    header = (0, 21, 4, kind, *SIZE, 9, 5, 9, len(projection), 12)
    return struct.pack("<11i", *header) + numbers.tobytes() + pose(mount)


def camera_before_018(mount: np.ndarray = MOUNT) -> bytes:
    return np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], *SIZE], "<f4").tobytes() + pose(mount)


@dataclass
class Robot:
    """A robot that saw the room from six nodes, with odometry that drifts by 2 cm a node."""

    views: list[np.ndarray]
    depth: Callable[[np.ndarray], bytes] = lambda depth: png(millimetres(depth))
    cameras: list[bytes] = field(default_factory=lambda: [camera()])
    optimised: list[int] | None = field(default_factory=lambda: list(range(6)))

    def bases(self) -> list[np.ndarray]:
        return [T @ np.linalg.inv(MOUNT) for T in self.views]

    def write(self, path: Path) -> Path:
        path.parent.mkdir(parents=True, exist_ok=True)
        with sqlite3.connect(path) as database:
            database.executescript(SCHEMA)
            count, bases = len(self.cameras), self.bases()
            for i, (T, stamp) in enumerate(zip(self.views, STAMPS, strict=True)):
                drifted = bases[i].copy()
                drifted[:3, 3] += 0.02 * i
                colour = np.full((SIZE[1], SIZE[0] * count, 3), i, np.uint8)
                depth = np.tile(room_depth(T, K, SIZE), (1, count))
                database.execute("INSERT INTO Node VALUES (?, 0, 0, ?, ?, '')",
                                 (i + 1, stamp, pose(drifted)))  # fmt: skip
                images = png(colour), self.depth(depth)
                database.execute("INSERT INTO Data VALUES (?, ?, ?, ?)",
                                 (i + 1, *images, b"".join(self.cameras)))  # fmt: skip
            for a, b, kind in [*((i, i + 1, 0) for i in range(5)), (5, 0, 1), (0, 3, 2)]:
                between = np.linalg.inv(bases[a]) @ bases[b]
                database.execute("INSERT INTO Link VALUES (?, ?, ?, x'', ?)",
                                 (a + 1, b + 1, kind, pose(between)))  # fmt: skip
            ids = poses = None
            if self.optimised is not None:
                ids = packed(np.array(self.optimised, np.int32) + 1)
                rows = [bases[i][:3].ravel() for i in self.optimised]
                poses = packed(np.array(rows, np.float32).ravel())
            database.execute("INSERT INTO Admin VALUES ('0.21.4', ?, ?)", (ids, poses))
        database.close()
        return path


@pytest.fixture
def robot(room_views) -> Robot:
    return Robot(room_views)


@pytest.mark.parametrize(
    "change",
    [
        {},
        {"depth": as_rvl},
        {"depth": as_floats},
        {"cameras": [camera(P=False)]},
        {"cameras": [camera_before_018()]},
    ],
    ids=["PNG", "RVL", "floats", "without a projection", "a camera before 0.18"],
)
def test_a_database_gives_its_images_at_their_optimised_poses(robot, tmp_path, change):
    vars(robot).update(change)
    for path in (robot.write(tmp_path / "rtabmap.db"), tmp_path):  # the file, and its folder
        recording = open_recording(path, OPTIONS)
        assert len(recording) == 6
        for i, T in enumerate(robot.views):
            frame, entry = recording.frame(i), recording.listing.entries[i]
            np.testing.assert_allclose(entry.T_world_cam, T, atol=1e-5)
            np.testing.assert_allclose(frame.depth, room_depth(T, K, SIZE), atol=2e-3)
            np.testing.assert_allclose(frame.K, K, atol=0.01)
            assert (frame.rgb == i).all()
            assert frame.stamp == STAMPS[i]


def test_links_are_adjusted_where_no_optimised_poses_are_kept(robot, tmp_path, caplog):
    robot.optimised = None
    entries = open_recording(robot.write(tmp_path / "a.db"), OPTIONS).listing.entries
    for entry, T in zip(entries, robot.views, strict=True):
        moved, turned = motion(entry.T_world_cam, T)
        assert moved < 0.005 and turned < 0.005  # the odometry alone is 0.17 m off
    assert "its links are adjusted" in caplog.text


def test_nodes_out_of_the_map_are_left_out_and_told(robot, tmp_path, caplog):
    robot.optimised = [0, 1, 4]
    entries = open_recording(robot.write(tmp_path / "a.db"), OPTIONS).listing.entries
    assert [e.id for e in entries] == ["000001", "000002", "000005"]
    assert "3 of 6 nodes are not joined" in caplog.text


def test_each_camera_of_a_node_is_a_frame_by_its_own_mount(robot, tmp_path):
    behind = np.diag([-1.0, -1, 1, 1]) @ MOUNT
    robot.cameras = [camera(), camera(behind)]
    entries = open_recording(robot.write(tmp_path / "a.db"), OPTIONS).listing.entries
    assert len(entries) == 12
    np.testing.assert_allclose(entries[3].T_world_cam, robot.bases()[1] @ behind, atol=1e-5)
    np.testing.assert_array_equal(entries[3].colour.colour().shape, (SIZE[1], SIZE[0], 3))


def damaged(statement: str) -> Callable[[Path], object]:
    def change(path: Path) -> None:
        with sqlite3.connect(path) as database:
            database.execute(statement)
        database.close()

    return change


REFUSED = {
    "no images": (damaged("UPDATE Data SET image = NULL"), "Mem/BinDataKept=true"),
    "stereo": (damaged(f"UPDATE Data SET calibration = x'{camera(kind=1).hex()}'"), "stereo"),
    "no calibration": (damaged("UPDATE Data SET calibration = NULL"), "has no calibration"),
    "a calibration cut short": (
        damaged("UPDATE Data SET calibration = substr(calibration, 1, 100)"), "is damaged"),
    "poses that are no stream": (damaged("UPDATE Admin SET opt_poses = x'0011'"), "poses are"),
    "fewer poses than nodes": (
        damaged(f"UPDATE Admin SET opt_poses = x'{packed(np.zeros(12, np.float32)).hex()}'"),
        "6 nodes, 12 numbers"),
    "a pose that is none": (
        damaged(f"UPDATE Admin SET opt_poses = x'{packed(np.zeros(72, np.float32)).hex()}'"),
        "node 1"),
    "an image that is none": (damaged("UPDATE Data SET image = x'0011'"), "image of node 1"),
    "depth in 8 bits": (
        damaged(f"UPDATE Data SET depth = x'{png(np.zeros((9, 9), np.uint8)).hex()}'"),
        "must be one 16-bit channel",
    ),
    "a file cut short": (
        lambda path: path.write_bytes(path.read_bytes()[:30_000]), "cannot be read as a database"),
    "a view in place of a table": (
        damaged("CREATE VIEW Node AS SELECT 1 AS id"), "no recording of a known format"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_a_database_that_cannot_be_read_is_refused_in_a_line(robot, tmp_path, case):
    change, message = REFUSED[case]
    path = robot.write(tmp_path / "a.db")
    if "VIEW" in case.upper():
        damaged("ALTER TABLE Node RENAME TO Other")(path)
    change(path)
    with pytest.raises(RecordingError, match=message) as refused:
        open_recording(path, OPTIONS).frame(0)
    assert "\n" not in str(refused.value)


def test_tables_that_multiply_each_other_are_refused(tmp_path):
    path = tmp_path / "a.db"
    with sqlite3.connect(path) as database:
        database.executescript(SCHEMA.replace(", PRIMARY KEY (id)", ""))
        rows = [(pose(np.eye(4)),)] * 3000
        database.executemany("INSERT INTO Node VALUES (1, 0, 0, 1.0, ?, '')", rows)
        database.executemany("INSERT INTO Data VALUES (1, x'00', x'00', ?)", [(b"0",)] * 3000)
    database.close()
    with pytest.raises(RecordingError, match="interrupted"):
        open_recording(path, OPTIONS)


@pytest.mark.parametrize("content", ["other", "torn"])
def test_other_databases_are_no_recordings(tmp_path, content):
    if content == "other":
        sqlite3.connect(tmp_path / "a.db").execute("CREATE TABLE a (b)").connection.close()
    else:
        (tmp_path / "a.db").write_bytes(b"SQLite format 3\0" + bytes(100))
    with pytest.raises(RecordingError, match=r"no recording of a known|read as a database"):
        open_recording(tmp_path / "a.db")
