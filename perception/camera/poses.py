"""Camera poses, camera -> world, (4, 4) [m]: read, checked to be rigid, interpolated."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from perception.number_tables import all_numbers, floats, in_seconds, rows

Floats = NDArray[np.float64]

LEVER: Final = 3.0  # [m] weight of an angle beside a distance
HAND_EYE_STEPS: Final = 50
LEVEL: Final = 1e-3  # [rad] from straight up or down
UNSEEN: Final = 0.1  # share of the strongest direction below which one does not show


def motions(steps: Floats) -> Floats:
    """Rigid motions (n, 4, 4) of rotation vectors and translations (n, 6)."""
    angle = np.linalg.norm(steps[:, :3], axis=1)
    S = skew(steps[:, :3])
    a = np.sinc(angle / np.pi)[:, None, None]
    b = (0.5 * np.sinc(angle / (2 * np.pi)) ** 2)[:, None, None]
    T = np.tile(np.eye(4), (len(steps), 1, 1))
    T[:, :3, :3] += a * S + b * (S @ S)
    T[:, :3, 3] = steps[:, 3:]
    return T


def rigid(T: Floats) -> Floats:
    """The rigid motion (4, 4) nearest to a product of many, whose rounding would add up."""
    U, _, Vt = np.linalg.svd(T[:3, :3])
    made = np.eye(4)
    made[:3, :3], made[:3, 3] = U @ Vt, T[:3, 3]
    return made


def inverse(T: Floats) -> Floats:
    """Inverse of a rigid motion (4, 4)."""
    made = np.eye(4)
    made[:3, :3] = T[:3, :3].T
    made[:3, 3] = -T[:3, :3].T @ T[:3, 3]
    return made


def motion_of(step: Floats) -> Floats:
    """Rigid motion (4, 4) of a rotation vector and a translation (6,)."""
    x, y, z, *moved = step.tolist()
    angle = math.hypot(x, y, z)
    a = math.sin(angle) / angle if angle > 1e-9 else 1.0
    b = 0.5 * (math.sin(angle / 2) / (angle / 2)) ** 2 if angle > 1e-9 else 0.5
    T: Floats = np.array(
        [
            [1 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y, moved[0]],
            [b * x * y + a * z, 1 - b * (x * x + z * z), b * y * z - a * x, moved[1]],
            [b * x * z - a * y, b * y * z + a * x, 1 - b * (x * x + y * y), moved[2]],
            [0, 0, 0, 1],
        ]
    )
    return T


def logarithms(T: Floats) -> Floats:
    """Rotation vectors [rad] and translations [m] (n, 6) of motions (n, 4, 4), less than a turn."""
    R = T[:, :3, :3]
    axis = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], 1)
    sine = np.linalg.norm(axis, axis=1) / 2
    cosine = np.clip((np.trace(R, axis1=1, axis2=2) - 1) / 2, -1, 1)
    angle = np.arctan2(sine, cosine)
    scale = np.where(sine > 1e-9, angle / np.maximum(2 * sine, 1e-12), 0.5)
    return np.hstack([axis * scale[:, None], T[:, :3, 3]])


def adjoints(T: Floats) -> Floats:
    """(n, 6, 6) takes a small motion before T to the equal small motion after T."""
    R = T[:, :3, :3]
    made = np.zeros((len(T), 6, 6))
    made[:, :3, :3] = made[:, 3:, 3:] = R
    made[:, 3:, :3] = skew(T[:, :3, 3]) @ R
    return made


def cross(a: Floats, b: Floats) -> Floats:
    """Cross products (..., 3), in a third of `np.cross`'s time."""
    made = np.empty(np.broadcast_shapes(a.shape, b.shape))
    made[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    made[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    made[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return made


def mount_numbers(X: Pose) -> str:
    """x,y,z [m],roll,pitch,yaw [rad] of a camera's body (x ahead, z up), of the camera's pose."""
    T = X @ BODY_FROM_CAMERA.T
    R, level = T[:3, :3], np.hypot(T[2, 1], T[2, 2]) > LEVEL  # else roll and yaw are one
    roll = np.arctan2(R[2, 1], R[2, 2]) if level else 0.0
    yaw = np.arctan2(R[1, 0], R[0, 0]) if level else np.arctan2(-R[0, 1], R[1, 1])
    turned = (roll, -np.arcsin(np.clip(R[2, 0], -1, 1)), yaw)
    return ",".join(f"{round(float(n), 3) + 0.0:g}" for n in (*T[:3, 3], *turned))


def hand_eye(body: Floats, camera: Floats) -> Pose:
    """Pose (4, 4) of a camera on the body that carries it, by the motions (n, 4, 4) of both.

    A X = X B: rotation and translation by turns. Translation along an axis about which the body
    does all its turns is 0, since it does not show.
    """
    X = np.eye(4)
    turned = body[:, :3, :3] - np.eye(3)
    rotated = [LEVER * logarithms(T)[:, :3] for T in (body, camera)]
    for _ in range(HAND_EYE_STEPS):
        moved = body[:, :3, 3] + turned @ X[:3, 3]
        U, _, Vt = np.linalg.svd(
            np.vstack([rotated[0], moved]).T @ np.vstack([rotated[1], camera[:, :3, 3]])
        )
        X[:3, :3] = U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt
        off = camera[:, :3, 3] @ X[:3, :3].T - body[:, :3, 3]
        X[:3, 3] = np.linalg.lstsq(turned.reshape(-1, 3), off.ravel(), rcond=UNSEEN)[0]
    return X


def skew(p: Floats) -> Floats:
    """(..., 3, 3) with `skew(p) @ q` the cross product of p (..., 3) and q."""
    made = np.zeros((*p.shape[:-1], 3, 3))
    made[..., 0, 1], made[..., 0, 2], made[..., 1, 2] = -p[..., 2], p[..., 1], -p[..., 0]
    made[..., 1, 0], made[..., 2, 0], made[..., 2, 1] = p[..., 2], -p[..., 1], p[..., 0]
    return made


Pose = NDArray[np.float64]  # (4, 4)
LOST: Final = np.full((4, 4), np.nan)  # the pose of a frame in which tracking was lost

BODY_FROM_CAMERA = np.array(
    [[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)
#: Conventions of a recording's pose matrices, each with its conversion to camera -> world. The
#: camera's x points right, y down, z ahead. OpenGL's cameras have y up and look along -z; bodies of
#: ROS (REP 103) have x ahead, y left, z up.
CONVENTIONS: dict[str, Callable[[Pose], Pose]] = {
    "camera-to-world": lambda T: T,
    "world-to-camera": lambda T: np.linalg.inv(T).astype(np.float64),
    "opengl": lambda T: T @ np.diag([1.0, -1.0, -1.0, 1.0]),
    "ros": lambda T: T @ BODY_FROM_CAMERA,
}
MAX_COORDINATE = 1e7  # [m] no map is larger than the Earth
UNIT: Final = 0.05  # by which the length of a quaternion may differ from 1
RIGID_TOLERANCE = 5e-3  # largest entry of R'R - I that rounding and drift of trackers explain
GRID = 2.0**40  # steps of the numbers of a quaternion that is exact
MAX_GAP = 0.2  # [s] between two poses of a trajectory that are still interpolated


def rotation_angle(R: NDArray[np.float64]) -> float:
    """Angle [rad], 0..pi, of a rotation (3, 3)."""
    return math.acos(min(max((float(np.trace(R)) - 1) / 2, -1.0), 1.0))


def motion(T_from: Pose, T_to: Pose) -> tuple[float, float]:
    """Distance [m] and angle [rad] between two poses of a camera."""
    distance = float(np.linalg.norm(T_to[:3, 3] - T_from[:3, 3]))
    return distance, rotation_angle(T_from[:3, :3].T @ T_to[:3, :3])


def checked_pose(T: NDArray[np.float64], where: str) -> Pose:
    """The rigid (4, 4) transform nearest to `T`.

    Trackers accumulate rounding: the rotations of 7-Scenes are off by up to 2e-4.

    Raises RecordingError, beginning with `where`, if it is not finite, not (4, 4) with the last row
    0 0 0 1, farther than MAX_COORDINATE from the origin, or if its rotation part is no rotation
    (scaled, sheared or mirrored).
    """
    if T.shape != (4, 4):
        raise RecordingError(f"{where}: a pose is a 4x4 matrix (16 numbers), got {T.size} numbers")
    if not np.isfinite(T).all():
        raise RecordingError(f"{where}: the pose is not finite")
    if np.abs(T[3] - (0, 0, 0, 1)).max() > RIGID_TOLERANCE:
        by_columns = np.abs(T[:, 3] - (0, 0, 0, 1)).max() <= RIGID_TOLERANCE
        raise RecordingError(
            f"{where}: the last row of a pose is 0 0 0 1, got {' '.join(f'{x:g}' for x in T[3])}"
            + ("; its transpose would work" if by_columns else "")
        )
    far = float(np.abs(T[:3, 3]).max())
    if far > MAX_COORDINATE:
        raise RecordingError(
            f"{where}: the pose is {far:.3g} m from the origin; poses are in metres, up to "
            f"{MAX_COORDINATE:g}"
        )
    R = T[:3, :3]
    error = float(np.abs(R.T @ R - np.eye(3)).max())
    if error > RIGID_TOLERANCE or np.linalg.det(R) < 0:
        raise RecordingError(
            f"{where}: the pose is not rigid: its 3x3 part is off a rotation by {error:.2g}, "
            f"determinant {np.linalg.det(R):.3g} (1 wanted)"
        )
    return rigid(T)


def read_pose(path: Path) -> Pose:
    """The one pose a file holds as 16 numbers, row by row, or 12 without the last row."""
    return _pose_of_row(all_numbers(path), str(path))


def _pose_of_row(numbers: NDArray[np.float64], where: str) -> Pose:
    if numbers.size == 12:
        numbers = np.append(numbers, (0, 0, 0, 1))
    return listed_pose(numbers.reshape(4, 4) if numbers.size == 16 else numbers, where)


def listed_pose(T: NDArray[np.float64], where: str) -> Pose:
    """A pose of a list as of `checked_pose`; all nan where tracking was lost: it is not finite."""
    lost = T.shape == (4, 4) and not np.isfinite(T).all()
    return LOST if lost else checked_pose(T, where)


def read_pose_rows(path: Path) -> list[Pose]:
    """One pose a line: 16 numbers row by row, 12 without the last row, or x y z qx qy qz qw.

    A stamp or a number of the image may come before. Or four lines a pose, a row each.
    """
    poses, lines = [], list(rows(path))
    if lines and all(len(words) == 4 for _, words in lines) and len(lines) % 4 == 0:
        lines = [
            (lines[at][0], [word for _, words in lines[at : at + 4] for word in words])
            for at in range(0, len(lines), 4)
        ]
    for where, words in lines:
        numbers = np.array(floats(words, where))
        numbers = numbers[numbers.size in (8, 13, 17) :]
        if numbers.size == 7:
            lost = not np.isfinite(numbers).all()
            T = LOST if lost else pose_from_quaternion(numbers[:3], numbers[3:], where)
            poses.append(T)
            continue
        poses.append(_pose_of_row(numbers, where))
    return poses


def read_pose_log(path: Path) -> dict[int, Pose]:
    """Poses by first key, of a log that repeats a key line of integers and four rows."""
    lines = list(rows(path))
    poses: dict[int, Pose] = {}
    for start in range(0, len(lines), 5):
        where, key = lines[start]
        block = lines[start + 1 : start + 5]
        if len(block) < 4 or not key[0].lstrip("-").isdecimal():
            raise RecordingError(
                f"{where}: a trajectory log repeats a key line and four rows of a 4x4 pose"
            )
        T = np.array([x for at, words in block for x in floats(words, at)])
        poses[int(key[0])] = listed_pose(T.reshape(4, 4) if T.size == 16 else T, where)
    return poses


def pose_from_quaternion(t: NDArray[np.float64], q: NDArray[np.float64], where: str) -> Pose:
    """Pose from a translation (3,) [m] and a quaternion x y z w (4,) of any length but zero."""
    norm = float(np.linalg.norm(q))
    if not np.isfinite(norm) or abs(norm - 1) > UNIT:
        raise RecordingError(f"{where}: a rotation quaternion has length 1, got {norm:.3g}")
    T = np.eye(4)
    T[:3, :3] = _rotation(q / norm)
    T[:3, 3] = t
    return checked_pose(T, where)


def check_pose_numbers(numbers: Sequence[float], where: str) -> None:
    """Raise RecordingError where x y z [m] and a quaternion x y z w are no pose.

    As `pose_from_quaternion` does, in a fraction of its time: bags have millions of transforms.
    """
    far, norm = max(map(abs, numbers[:3])), math.hypot(*numbers[3:])
    # sums tell nan in any place, which the largest of some numbers may hide
    if not (math.isfinite(sum(numbers)) and far <= MAX_COORDINATE and abs(norm - 1) <= UNIT):
        pose_from_quaternion(np.array(numbers[:3]), np.array(numbers[3:]), where)


def quaternion_from_pose(T: Pose) -> NDArray[np.float64]:
    """Unit quaternion (4,) x y z w of the rotation of `T` (4, 4); w is not negative."""
    R = T[:3, :3]
    K = np.array(
        [
            [R[0, 0] - R[1, 1] - R[2, 2], 0, 0, 0],
            [R[0, 1] + R[1, 0], R[1, 1] - R[0, 0] - R[2, 2], 0, 0],
            [R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], R[2, 2] - R[0, 0] - R[1, 1], 0],
            [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], np.trace(R)],
        ]
    )  # Bar-Itzhack 2000: its eigenvector of the largest eigenvalue, from the lower triangle
    _, vectors = np.linalg.eigh(K, "L")
    q: NDArray[np.float64] = vectors[:, 3]
    return -q if q[3] < 0 else q


def gridded_pose(T: Pose) -> Pose:
    """The pose with its rotation moved to one that a quaternion holds exactly.

    Three of the quaternion's numbers become multiples of 2^-40, the fourth, the first of about the
    largest, follows from them. Written as a quaternion and read back, such a pose is the same to
    the last bit; rotations move by 1e-12 rad.
    """
    q = quaternion_from_pose(T)
    free = int(np.flatnonzero(np.abs(q) > np.abs(q).max() - 1e-6)[0])
    grid = np.round(q * (np.sign(q[free]) * GRID)) / GRID
    grid[free] = 0.0
    grid[free] = np.sqrt(1 - grid @ grid)
    gridded = np.eye(4)
    gridded[:3, :3] = _rotation(grid)
    gridded[:3, 3] = T[:3, 3]
    return gridded


def _rotation(q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation (3, 3) of a unit quaternion x y z w."""
    x, y, z, w = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Poses over time."""

    stamp: NDArray[np.float64]  # (n,) [s], increasing
    t: NDArray[np.float64]  # (n, 3) [m]
    q: NDArray[np.float64]  # (n, 4) x y z w, length 1

    def at(self, stamp: float, tolerance: float, max_gap: float = MAX_GAP) -> Pose | None:
        """Pose at `stamp` [s]: between its two neighbours, or of one nearer than `tolerance` [s].

        None where the trajectory does not reach: before its start, after its end, or in a gap
        longer than `max_gap` [s]. Rotation is interpolated spherically.
        """
        if not len(self.stamp):
            return None
        after = int(np.searchsorted(self.stamp, stamp))
        near = min(
            (i for i in (after - 1, after) if 0 <= i < len(self.stamp)),
            key=lambda i: abs(self.stamp[i] - stamp),
        )
        inside = 0 < after < len(self.stamp) and self.stamp[near] != stamp
        if inside and self.stamp[after] - self.stamp[after - 1] <= max_gap:
            return self._between(after - 1, stamp)
        if abs(self.stamp[near] - stamp) <= tolerance:
            return pose_from_quaternion(self.t[near], self.q[near], f"pose at {stamp:.6f}")
        return None

    @property
    def reach(self) -> str:
        """The first and the last stamp, for people."""
        ends = self.stamp[[0, -1]] if len(self.stamp) else ()
        return " to ".join(f"{end:.3f}" for end in ends) or "none is finite"

    def _between(self, i: int, stamp: float) -> Pose:
        share = (stamp - self.stamp[i]) / (self.stamp[i + 1] - self.stamp[i])
        a, b = self.q[i], self.q[i + 1]
        cos = float(a @ b)
        if cos < 0:  # q and -q are one rotation: take the short way round
            b, cos = -b, -cos
        angle = np.arccos(min(cos, 1.0))
        if angle < 1e-6:
            q = a + share * (b - a)
        else:
            q = (np.sin((1 - share) * angle) * a + np.sin(share * angle) * b) / np.sin(angle)
        t = self.t[i] + share * (self.t[i + 1] - self.t[i])
        return pose_from_quaternion(t, q, f"pose at {stamp:.6f}")


_EUROC: Final = (0, 1, 2, 3, 5, 6, 7, 4)
_COLUMN: Final = re.compile(r"[a-df-z]")  # in a name; numbers have e, nan and inf have no x
_ROLES: Final = ("t", "px", "py", "pz", "qx", "qy", "qz", "qw")


def _order_of(names: Sequence[str]) -> tuple[int, ...] | None:
    """Columns of stamp, position and quaternion by their names; None where one has none."""
    roles = []
    for name in map(str.lower, names):
        turn = name[-1] == "w" or re.search(r"q|rot|ori", name) is not None
        is_time = name == "t" or re.search(r"time|stamp", name) is not None
        roles.append("t" if is_time else f"{'q' if turn else 'p'}{name[-1]}")
    return tuple(map(roles.index, _ROLES)) if {*_ROLES} <= {*roles} else None


def read_trajectory(path: Path) -> Trajectory:
    """A trajectory in TUM format: `stamp tx ty tz qx qy qz qw` a line.

    A number of the pose may follow, as RTAB-Map writes it. Names of the columns in the first line
    tell their order; a CSV file without them has qw before qx and perhaps velocities, as EuRoC's.
    Stamps are as of `in_seconds`; lines that are not finite are left out.
    """
    table, csv, lost = list[list[float]](), path.suffix.lower() == ".csv", False
    order: tuple[int, ...] | None = _EUROC if csv else None
    for where, words in rows(path):
        if not table and _COLUMN.search(words[0].lower()):
            order = _order_of([word for word in words if not word.startswith("[")]) or order
            continue
        numbers = floats(words, where)
        if order is not None and len(numbers) > max(order):
            numbers = [numbers[place] for place in order]
        if len(numbers) not in (8, 9):
            raise RecordingError(f"{where}: expected stamp tx ty tz qx qy qz qw, got {words}")
        numbers = numbers[:8]
        if not np.isfinite(numbers).all():
            lost = True
            continue
        pose_from_quaternion(np.array(numbers[1:4]), np.array(numbers[4:]), where)
        table.append(numbers)
    if not table and not lost:
        raise RecordingError(f"{path} holds no poses")
    sheet = np.array(table).reshape(-1, 8)
    sheet[:, 0] = in_seconds(sheet[:, 0], path)
    sheet = sheet[np.unique(sheet[:, 0], return_index=True)[1]]
    q = sheet[:, 4:] / np.linalg.norm(sheet[:, 4:], axis=1, keepdims=True)
    return Trajectory(sheet[:, 0], sheet[:, 1:4], q)
