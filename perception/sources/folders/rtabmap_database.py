"""RTAB-Map's database: colour, depth, calibration and corrected poses of all nodes, in SQLite.

Layout: github.com/introlab/rtabmap, DatabaseSchema.sql, DBDriverSqlite3.cpp (databases since 0.11),
Compression.cpp and CameraModel.cpp (serialisation). Matrices of poses are 3x4 floats, row by row;
`local_transform` takes the optical frame of a camera to the robot's base, whose poses the nodes
have. Images are rectified. Admin keeps the poses of the last optimisation; without them the links
between nodes are adjusted here.
"""

from __future__ import annotations

import logging
import sqlite3
import struct
import zlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from kg.model.regular_files import SQLITE_STEPS, StepLimit
from perception.camera.image_decoding import MILLIMETRES, decode_image, metres
from perception.camera.intrinsics import Intrinsics, intrinsics_from_matrix
from perception.camera.poses import Pose, checked_pose, inverse
from perception.odometry.pose_graph import PoseConstraint, adjusted
from perception.sources.listing import Format, FrameEntry, RecordingListing, Streams
from perception.sources.ros.image_messages import rtabmap_depth

SIGNATURE: Final = b"SQLite format 3\0"
MAX_UNPACKED: Final = 1 << 28  # [bytes] of the poses of all nodes
_TABLES: Final = """SELECT count(*) FROM sqlite_master
    WHERE type = 'table' AND name IN ('Node', 'Data', 'Link', 'Admin')"""
_NODES: Final = """SELECT Node.id, stamp, pose, calibration FROM Node JOIN Data USING (id)
    WHERE length(image) > 0 AND length(depth) > 0 AND length(pose) = 48 AND stamp > 0
    ORDER BY stamp, Node.id"""
_LINKS: Final = """SELECT from_id, to_id, transform FROM Link
    WHERE type IN (0, 1, 2, 3, 4, 6) AND from_id != to_id AND length(transform) = 48"""
_POSE: Final = 12  # floats of a pose
#: of a camera: version (3), kind, width, height, sizes of K, D, R, P and the mount
_HEADER: Final = struct.Struct("<11i")
_STEREO: Final = 1
_VERSIONS: Final = 1000  # above it the first number is no version, but a float
_FLOATS: Final = 18  # of a camera before 0.18: fx, fy, cx, cy, width, height, mount
SAME_LENS: Final = 0.01  # share by which focal lengths of one camera differ
#: of the motion between two nodes: 0.01 rad and 0.03 m
INFORMATION: Final = np.diag([1e4, 1e4, 1e4, 1e3, 1e3, 1e3])
_log = logging.getLogger(__name__)


class Database:
    """A database that is only read."""

    def __init__(self, path: Path) -> None:
        self.path = path
        uri = f"{path.absolute().as_uri()}?mode=ro"
        self._connection = sqlite3.connect(uri, uri=True, check_same_thread=False)
        self._limit = StepLimit(path)
        self._connection.set_progress_handler(self._limit, SQLITE_STEPS)

    def rows(self, query: str, *values: int) -> list[tuple[Any, ...]]:
        """All rows of a query; raises RecordingError where the file is damaged."""
        self._limit.reset()
        try:
            self._connection.execute("PRAGMA trusted_schema = OFF")  # it calls no functions
            return self._connection.execute(query, values).fetchall()
        except sqlite3.Error as error:
            raise RecordingError(f"{self.path} cannot be read as a database: {error}") from error


@dataclass(frozen=True, slots=True)
class NodeImage:
    """A colour or depth image of a node, of one of the cameras whose images lie side by side."""

    database: Database
    column: str  # image or depth
    node: int
    camera: int
    cameras: int

    def __str__(self) -> str:
        return f"{self.database.path}, {self.column} of node {self.node}"

    def check(self) -> None:
        """Nothing: images are checked as they are decoded."""

    def colour(self) -> NDArray[np.uint8]:
        """(H, W, 3) RGB; raises RecordingError for an unreadable image."""
        bgr = decode_image(self._bytes(), cv2.IMREAD_COLOR, str(self))
        return np.ascontiguousarray(self._own(bgr)[:, :, ::-1]).astype(np.uint8, copy=False)

    def depth(self, depth_scale: float) -> NDArray[np.float32]:
        """(H, W) [m], nan = no return; raises RecordingError for an unreadable image."""
        return metres(self._own(rtabmap_depth(self._bytes(), str(self))), depth_scale)

    def _bytes(self) -> NDArray[np.uint8]:
        rows = self.database.rows(f"SELECT {self.column} FROM Data WHERE id = ?", self.node)
        blob = rows[0][0] if rows else None
        if not isinstance(blob, bytes) or not blob:
            raise RecordingError(f"{self} is missing")
        return np.frombuffer(blob, np.uint8)

    def _own(self, image: NDArray[Any]) -> NDArray[Any]:
        width = image.shape[1] // self.cameras
        return image[:, self.camera * width : (self.camera + 1) * width]


def matches(path: Path) -> bool:
    """Whether `path` is a database of RTAB-Map, or a folder with one."""
    return _file(path) is not None


def read(path: Path, streams: Streams) -> RecordingListing:
    """All nodes with colour, depth and a pose; raises RecordingError for malformed databases."""
    file = _file(path)
    if file is None:
        raise RecordingError(f"{path} is no database of RTAB-Map, or a folder with one")
    database = Database(file)
    nodes = database.rows(_NODES)
    if not nodes:
        raise RecordingError(
            f"{file} keeps no colour with depth; RTAB-Map with Mem/BinDataKept=true and a camera "
            "that measures depth writes both"
        )
    poses = _poses(database, {row[0]: _pose(row[2]) for row in nodes})
    entries = list[FrameEntry]()
    first: Intrinsics | None = None
    for node, stamp, _, calibration in nodes:
        if node not in poses:
            continue
        where = f"{file}, node {node}"
        cameras = _cameras(calibration, where)
        first = first or cameras[0][0]
        for at, (camera, T_base_cam) in enumerate(cameras):
            if abs(camera.fx / first.fx - 1) > SAME_LENS:
                raise RecordingError(f"{where}: its cameras have other lenses; one is read")
            name = f"{node:06}" if len(cameras) == 1 else f"{node:06}-{at}"
            colour, depth = (
                NodeImage(database, column, node, at, len(cameras)) for column in ("image", "depth")
            )
            T = checked_pose(poses[node] @ T_base_cam, where)
            entries.append(FrameEntry(name, colour, depth, T, float(stamp)))
    if left_out := len(nodes) - len({node for node, *_ in nodes} & set(poses)):
        _log.warning(
            "%s: %d of %d nodes are not joined to its map, and are left out",
            file.name,
            left_out,
            len(nodes),
        )
    return RecordingListing(tuple(entries), first, MILLIMETRES)


def _file(path: Path) -> Path | None:
    """The database at `path`, or the only one in this folder, also a damaged one; None: no such."""
    found = [path] if path.suffix.lower() == ".db" else sorted(path.glob("*.db"))[:2]
    if len(found) != 1 or not found[0].is_file():
        return None
    try:
        with found[0].open("rb") as stream:
            if stream.read(len(SIGNATURE)) != SIGNATURE:
                return None
        return found[0] if Database(found[0]).rows(_TABLES) == [(4,)] else None
    except OSError:
        return None
    except RecordingError:
        return found[0]  # to be refused as damaged when it is read


def _poses(database: Database, odometry: dict[int, Pose]) -> dict[int, Pose]:
    """Poses of the base by node, after the last optimisation, or by the links between nodes."""
    columns = {name for _, name, *_ in database.rows("PRAGMA table_info(Admin)")}
    kept = database.rows("SELECT opt_ids, opt_poses FROM Admin") if "opt_ids" in columns else []
    for ids, poses in kept:
        if ids and poses:
            numbers = _unpacked(ids, np.int32, f"{database.path}, ids of poses")
            rows = _unpacked(poses, np.float32, f"{database.path}, poses")
            if len(rows) != _POSE * len(numbers):
                raise RecordingError(f"{database.path}: {len(numbers)} nodes, {len(rows)} numbers")
            return dict(zip(numbers.tolist(), map(_matrix, rows.reshape(-1, _POSE)), strict=True))
    _log.warning("%s keeps no optimised poses; its links are adjusted", database.path.name)
    order = {node: place for place, node in enumerate(odometry)}
    edges = [
        PoseConstraint(order[a], order[b], inverse(_pose(T)), INFORMATION)
        for a, b, T in database.rows(_LINKS)
        if a in order and b in order
    ]
    return dict(zip(order, adjusted(list(odometry.values()), edges), strict=True))


def _cameras(calibration: bytes | None, where: str) -> list[tuple[Intrinsics, Pose]]:
    """Cameras of a node, each with its pose in the robot's base."""
    data = calibration or b""
    if len(data) < _HEADER.size:
        raise RecordingError(f"{where} has no calibration")
    if _HEADER.unpack_from(data)[0] >= _VERSIONS:
        return _cameras_of_floats(data, where)
    found = list[tuple[Intrinsics, Pose]]()
    while data:
        if len(data) < _HEADER.size:
            raise RecordingError(f"{where}: its calibration is cut short")
        _, _, _, kind, width, height, *sizes = _HEADER.unpack_from(data)
        if kind == _STEREO:
            raise RecordingError(f"{where} has two images of a stereo camera; depth would work")
        end = _HEADER.size + 8 * sum(sizes[:4]) + 4 * sizes[4]
        if min(sizes) < 0 or len(data) < end or sizes[0] != 9 or sizes[4] not in (0, _POSE):
            raise RecordingError(f"{where}: its calibration is damaged")
        numbers = np.frombuffer(data, "<f8", sum(sizes[:4]), _HEADER.size)
        # rectified images follow P, where there is one
        matrix = (
            numbers[-12:].reshape(3, 4)[:, :3] if sizes[3] == _POSE else numbers[:9].reshape(3, 3)
        )
        mount = np.frombuffer(data, "<f4", sizes[4], end - 4 * sizes[4])
        T_base_cam = _matrix(mount) if sizes[4] else np.eye(4)
        found.append((_sized(matrix, width, height, where), T_base_cam))
        data = data[end:]
    return found


def _cameras_of_floats(data: bytes, where: str) -> list[tuple[Intrinsics, Pose]]:
    """Cameras as databases before 0.18 have them: fx, fy, cx, cy, width, height and the mount."""
    if len(data) % (4 * _FLOATS):
        raise RecordingError(f"{where} has a calibration of {len(data)} bytes, which is not read")
    found = list[tuple[Intrinsics, Pose]]()
    for fx, fy, cx, cy, width, height, *mount in np.frombuffer(data, "<f4").reshape(-1, _FLOATS):
        K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
        found.append((_sized(K, width, height, where), _matrix(np.array(mount))))
    return found


def _sized(K: NDArray[np.float64], width: float, height: float, where: str) -> Intrinsics:
    camera = intrinsics_from_matrix(K, where)
    return replace(camera, width=int(width) or None, height=int(height) or None)


def _pose(blob: bytes) -> Pose:
    return _matrix(np.frombuffer(blob, "<f4"))


def _matrix(numbers: NDArray[np.float32]) -> Pose:
    T = np.eye(4)
    T[:3] = numbers.reshape(3, 4)
    return T


def _unpacked(blob: bytes, kind: type[np.generic], where: str) -> NDArray[Any]:
    """Numbers (n,) of a matrix: zlib's stream, then rows, columns and OpenCV's type."""
    stream = zlib.decompressobj()
    try:
        data = stream.decompress(blob[:-12], MAX_UNPACKED)
    except zlib.error as error:
        raise RecordingError(f"{where} are damaged: {error}") from error
    if not stream.eof or len(data) % 4:
        raise RecordingError(f"{where} are cut short")
    return np.frombuffer(data, kind)


FORMAT = Format("rtabmap-db", "rtabmap.db", matches, read)
