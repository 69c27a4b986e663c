"""Gravity alignment of a recording's world: z up, floor about z = 0.

Up comes from, in this order: the caller; the folder's gravity-direction.txt (7-Scenes); the
surfaces in the depth images. From surfaces, up is the normal that most flat patches share, while
most other patches, the walls, are square to it. Only normals near the cameras' own up are
candidates, so a recording held on its side needs `up`.

The heading is kept: the map's x axis is the world's x axis laid flat (the world's z axis, where x
is itself upright). The map's origin lies straight below (or above) the world's, on the floor.

Images of a camera that is mounted or held on its side are turned upright by quarter turns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from perception.camera.intrinsics import Intrinsics
from perception.camera.poses import Pose
from perception.frames import Frame, Recording
from perception.number_tables import all_numbers

Up = str | Sequence[float] | NDArray[np.float64]

AXES = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}
FRAMES = 16  # spread evenly over the recording
PATCH = 20  # [px] edge of the squares a plane is fitted to
FLATNESS = 0.004  # largest RMS residual of a patch's inverse depth, relative
ALIGNED = np.cos(np.radians(6.0))  # normals that agree on one direction
SQUARE = np.sin(np.radians(4.0))  # normals square to it
CAMERA_UP = np.cos(np.radians(50.0))  # how far up may lie from the cameras' own up
CONTRADICTED = 1.5  # times as many surfaces must fit another up, to contradict the given one
REACH = 8.0  # [m] farther patches may be what a simulator or a driver shows for nothing ...
FEW = 100  # ... where there are so many nearer ones
HEIGHT_BIN = 0.05  # [m]
FLOOR_SHARE = 0.08  # of the level patches that a level needs to be a floor
LOWEST = 1.0  # percentile of all heights that stands for the floor where no level does


@dataclass(frozen=True, slots=True)
class Patches:
    """Flat squares of the depth images, in the recording's world."""

    centre: NDArray[np.float64]  # (n, 3) [m]
    normal: NDArray[np.float64]  # (n, 3) unit, towards the camera that saw it
    camera_up: NDArray[np.float64]  # (3,) unit, mean of the cameras' own up
    cameras: NDArray[np.float64]  # (m, 3) [m] centres of the cameras


def read_gravity(folder: Path) -> NDArray[np.float64] | None:
    """Up (3,) from the folder's gravity-direction.txt, which points down; None without the file."""
    path = folder / "gravity-direction.txt"
    if not path.is_file():
        return None
    numbers = all_numbers(path)
    if numbers.size != 3 or not np.isfinite(numbers).all() or np.linalg.norm(numbers) < 1e-6:
        raise RecordingError(f"{path}: expected the three numbers of a direction, got {numbers}")
    return -numbers / np.linalg.norm(numbers)


def parse_up(up: Up) -> NDArray[np.float64]:
    """Unit vector (3,) from "x", "-y", "+z", ... or three numbers (also as text, "0 -1 0.1").

    Raises RecordingError for anything else.
    """
    given = up
    if isinstance(up, str):
        sign = -1.0 if up.startswith("-") else 1.0
        if up.lstrip("+-").lower() in AXES:
            return sign * np.array(AXES[up.lstrip("+-").lower()], np.float64)
        up = up.replace(",", " ").split()  # type: ignore[assignment]
    try:
        vector = np.array([float(x) for x in up])
    except (TypeError, ValueError):
        vector = np.zeros(0)
    if vector.shape != (3,) or not np.isfinite(vector).all() or np.linalg.norm(vector) < 1e-9:
        raise RecordingError(f"up is one of x, -x, y, -y, z, -z or three numbers, got {given!r}")
    unit: NDArray[np.float64] = vector / np.linalg.norm(vector)
    return unit


def gravity_aligned_transform(
    recording: Recording, *, up: Up | None = None, doubted: bool = False
) -> NDArray[np.float64]:
    """Gravity-aligned transform T_map_world (4, 4) of a recording.

    `up` in the recording's world (see parse_up), None = found from the surfaces seen. Raises
    RecordingError where neither a direction nor a floor can be made out, and where floors and walls
    contradict an `up` that is `doubted`.
    """
    step = max(1, len(recording) // FRAMES)
    T_world_map = np.linalg.inv(recording.T_map_world).astype(np.float64)
    samples = [next(recording.frames(i)) for i in range(0, len(recording), step)]
    patches = _patches(samples, T_world_map)
    direction = parse_up(up) if up is not None else find_up(patches)
    if doubted:
        _check_up(recording.name, patches, direction)
    height = find_floor(patches, direction)
    return level_transform(direction, height)


def _check_up(name: str, patches: Patches, up: NDArray[np.float64]) -> None:
    """Raise RecordingError where many more surfaces are level or upright by another direction."""
    try:
        found = find_up(patches)
    except RecordingError:
        return
    given, best = _agreement(patches.normal, np.stack([up, found], axis=1))
    if found @ up < CAMERA_UP and best > CONTRADICTED * given:
        said = ",".join(f"{x:.2f}" for x in up)
        raise RecordingError(
            f"{name}: its poses have up at {said}, but floors and walls say otherwise; --up "
            f"{','.join(f'{x:.3f}' for x in found)} would work, --up {said} keeps it as it is"
        )


def _agreement(n: NDArray[np.float64], ups: NDArray[np.float64]) -> NDArray[np.float64]:
    """Count of normals (n, 3) that are level, half where upright, by each direction (3, m)."""
    count: NDArray[np.float64] = (n @ ups > ALIGNED).sum(0) + 0.5 * (abs(n @ ups) < SQUARE).sum(0)
    return count


def level_transform(up: NDArray[np.float64], floor: float) -> NDArray[np.float64]:
    """T_map_world (4, 4) from unit `up` (3,) and the floor's height along it [m], heading kept."""
    keep = np.array([1.0, 0, 0]) if abs(up[0]) < 0.9 else np.array([0, 0, 1.0])
    x = keep - (keep @ up) * up
    x /= np.linalg.norm(x)
    T = np.eye(4)
    T[:3, :3] = np.stack([x, np.cross(up, x), up])
    T[2, 3] = -floor
    return T


def find_up(patches: Patches) -> NDArray[np.float64]:
    """Up (3,) that most patches agree on as level or upright; raises RecordingError without any."""
    n = patches.normal
    facing = n[n @ patches.camera_up > CAMERA_UP]
    if len(facing) < 10:
        raise RecordingError(
            f"no floor found: only {len(facing)} flat patches face up; say where up is (up=...)"
        )
    candidates = facing[np.random.default_rng(0).integers(len(facing), size=300)]
    score = _agreement(n, candidates.T)
    best: NDArray[np.float64] = candidates[int(score.argmax())]
    for _ in range(5):
        level, wall = n[n @ best > ALIGNED], n[abs(n @ best) < SQUARE]
        # the direction most along the level normals and most square to those of the walls
        values, vectors = np.linalg.eigh(level.T @ level - wall.T @ wall)
        axis = vectors[:, int(values.argmax())]
        best = axis if axis @ best > 0 else -axis
    return best


def find_floor(patches: Patches, up: NDArray[np.float64]) -> float:
    """Height of the floor along `up` [m]: the lowest level surface of some size below the cameras.

    Where there is none, or much lies deeper, a low percentile of all heights.
    """
    height = patches.centre @ up
    below = float((patches.cameras @ up).min())
    deepest = float(np.percentile(height, LOWEST))
    level = height[(patches.normal @ up > np.cos(np.radians(15))) & (height < below)]
    if len(level) < 10:
        return deepest
    edges = np.arange(level.min(), level.max() + 3 * HEIGHT_BIN, HEIGHT_BIN)
    counts, _ = np.histogram(level, edges)
    pairs = counts[:-1] + counts[1:]
    strong = np.flatnonzero(pairs >= FLOOR_SHARE * len(level))
    if not len(strong):
        return deepest
    low = edges[strong[0]]
    floor = float(np.median(level[(level >= low) & (level <= low + 2 * HEIGHT_BIN)]))
    return min(floor, deepest + 3 * HEIGHT_BIN)


def _patches(frames: Sequence[Frame], T_world_map: NDArray[np.float64]) -> Patches:
    centres, normals, ups, cameras, near = [], [], [], [], []
    for frame in frames:
        T = T_world_map @ frame.T_map_cam
        centre, normal = flat_patches(frame.depth, frame.K)
        near.append(centre[:, 2] <= REACH)
        centres.append(centre @ T[:3, :3].T + T[:3, 3])
        normals.append(normal @ T[:3, :3].T)
        ups.append(-T[:3, 1])
        cameras.append(T[:3, 3])
    mean_up = np.mean(ups, axis=0)
    used = np.concatenate(near)
    used |= used.sum() < FEW  # of a hall
    patches = Patches(
        np.concatenate(centres)[used],
        np.concatenate(normals)[used],
        mean_up / max(float(np.linalg.norm(mean_up)), 1e-9),
        np.array(cameras),
    )
    if not len(patches.centre):
        raise RecordingError("no flat surface in any depth image: wrong depth scale or intrinsics?")
    return patches


def flat_patches(
    depth: NDArray[np.float32], K: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Centres (n, 3) [m] and unit normals (n, 3), towards the camera, of flat squares of depth.

    A plane has an inverse depth linear in the pixel coordinates, so one pseudo-inverse fits all
    squares: 1/z = a u + b v + c has the normal (a fx, b fy, a cx + b cy + c).
    """
    rows, columns = depth.shape[0] // PATCH, depth.shape[1] // PATCH
    whole_squares = depth[: rows * PATCH, : columns * PATCH].astype(np.float64)
    grid = whole_squares.reshape(rows, PATCH, columns, PATCH).transpose(0, 2, 1, 3)
    squares = grid.reshape(rows * columns, PATCH * PATCH)
    v0, u0 = (g.ravel() for g in np.mgrid[0:rows, 0:columns] * PATCH + (PATCH - 1) / 2)
    whole = np.isfinite(squares).all(1) & (squares > 0).all(1)
    inverse = 1 / squares[whole]
    dv, du = (g.ravel() - (PATCH - 1) / 2 for g in np.mgrid[0:PATCH, 0:PATCH])
    A = np.stack([du, dv, np.ones(PATCH * PATCH)], axis=1)
    plane = inverse @ np.linalg.pinv(A).T
    residual = np.sqrt(((plane @ A.T - inverse) ** 2).mean(1)) / plane[:, 2]
    flat = residual < FLATNESS
    (a, b, d), u, v = plane[flat].T, u0[whole][flat], v0[whole][flat]
    fx, fy, cx, cy = K[0, 0], K[1, 1], K[0, 2], K[1, 2]
    normal = -np.stack([a * fx, b * fy, d + a * (cx - u) + b * (cy - v)], axis=1)
    centre = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones_like(u)], axis=1) / d[:, None]
    return centre, normal / np.linalg.norm(normal, axis=1, keepdims=True)


#: takes coordinates of a camera turned by a quarter (counter-clockwise) to those of the camera
QUARTER: Final = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
CLEAR: Final = 0.8  # share of the images, by how much of up they show, that must agree
ASIDE: Final = 1.5  # times that the axis down must turn more than that to the right
TURNED: Final = 0.15  # mean turn [rad] of a camera that looked around
SHOWN: Final = 0.3  # mean length of up in the image's plane; less where cameras look down


def upright_turns(poses: Sequence[Pose], up: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weights (4,) of the quarters, counter-clockwise, that bring `up` to the top of images."""
    shown = np.array([T[:3, :3].T @ up for T in poses])  # (n, 3) in the cameras
    quarters = np.round(np.arctan2(shown[:, 0], -shown[:, 1]) / (np.pi / 2)).astype(int) % 4
    return np.bincount(quarters, np.hypot(shown[:, 0], shown[:, 1]), 4).astype(np.float64)


def clear_turns(poses: Sequence[Pose], up: NDArray[np.float64]) -> int:
    """Quarters that turn the images upright; 0 where the images do not agree on it."""
    weights = upright_turns(poses, up)
    best = int(weights.argmax())
    clear = weights[best] >= CLEAR * weights.sum() and weights.sum() >= SHOWN * len(poses)
    return best if clear else 0


def side_up(poses: Sequence[Pose]) -> NDArray[np.float64] | None:
    """Up (3,), or down, of a world in which the camera seems to be held on its side; else None.

    A camera that looks around a room turns about the vertical, so of the axes of its image the
    level one turns most. Held upright that is the axis to the right, held on its side the axis
    down. Where a camera hardly turns, neither does by `ASIDE`.
    """
    right, down = (np.array([T[:3, axis] for T in poses]) for axis in (0, 1))
    across, _ = np.linalg.eigh(right.T @ right / len(poses))  # squared spreads, ascending
    along, directions = np.linalg.eigh(down.T @ down / len(poses))
    if along[1] < max(ASIDE**2 * across[1], TURNED**2):
        return None
    vertical: NDArray[np.float64] = directions[:, 0]
    return vertical


def turned_poses(T: Pose, turns: int) -> Pose:
    """Pose of the turned camera."""
    turned: Pose = T @ np.linalg.matrix_power(QUARTER, turns)
    return turned


def turned_image(image: NDArray[Any], turns: int) -> NDArray[Any]:
    """An image turned counter-clockwise by quarters."""
    return np.ascontiguousarray(np.rot90(image, turns)) if turns else image


def turned_camera(camera: Intrinsics, turns: int) -> Intrinsics:
    """Intrinsics of the turned images of a camera without distortion, of known size."""
    (width, height), fx, fy, cx, cy = camera.size, camera.fx, camera.fy, camera.cx, camera.cy
    for _ in range(turns):
        fx, fy, cx, cy = fy, fx, cy, width - 1 - cx
        width, height = height, width
    return replace(camera, fx=fx, fy=fy, cx=cx, cy=cy, width=width, height=height)
