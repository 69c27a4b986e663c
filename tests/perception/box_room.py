"""An empty room with a pillar, seen by a depth camera: closed form, no noise."""

import numpy as np

from perception.frames import Frame

LOW, HIGH = np.array([-2.5, -2.0, 0.0]), np.array([2.5, 2.0, 2.5])  # [m] corners of the room
PILLAR = np.array([[0.9, -0.2, 0.0], [1.2, 0.1, 2.5]])  # [m] its two corners
K = np.array([[70.0, 0.0, 39.5], [0.0, 70.0, 29.5], [0.0, 0.0, 1.0]])
SIZE = (60, 80)  # rows, columns
LARGE_K = np.array([[280.0, 0.0, 159.5], [0.0, 280.0, 119.5], [0.0, 0.0, 1.0]])
LARGE = (240, 320)
PATCH = 0.11  # [m] edge of the patches


def pose(x: float, y: float, heading: float, z: float = 1.2, pitch: float = 0.3) -> np.ndarray:
    """Camera -> world of a camera that looks along `heading` [rad], down by `pitch` [rad]."""
    c, s = np.cos(heading), np.sin(heading)
    ahead = np.array([c * np.cos(pitch), s * np.cos(pitch), -np.sin(pitch)])
    right = np.array([s, -c, 0.0])
    T = np.eye(4)
    T[:3, :3] = np.stack([right, np.cross(ahead, right), ahead], axis=1)
    T[:3, 3] = x, y, z
    return T


def room_frame(T: np.ndarray, number: int) -> Frame:
    """What a camera at `T` (4, 4) sees."""
    depth, hit, _ = _seen(T, K, SIZE)
    rgb = np.full((*SIZE, 3), 90, np.uint8)
    rgb[hit] = 200
    return Frame(f"frame-{number:06d}", rgb, depth, K, T, 1e9 + number)


def papered_frame(T: np.ndarray, number: int, seed: int = 0) -> Frame:
    """What a camera at `T` (4, 4) sees where all surfaces have a pattern of patches, each once."""
    depth, _, points = _seen(T, LARGE_K, LARGE)
    cells = np.floor(points / PATCH + 1e-3).astype(np.int64)
    mixed = np.bitwise_xor.reduce((cells + 1000) * [73856093, 19349663, 83492791], axis=2)
    mixed = ((mixed + 7919 * seed) * 2654435761) % 2**32
    grey = (((mixed ^ (mixed >> 15)) * 2246822519) % 2**32) >> 24
    rgb = np.repeat(grey.astype(np.uint8)[..., None], 3, axis=2)
    return Frame(f"frame-{number:06d}", rgb, depth, LARGE_K, T, 1e9 + number)


def _seen(T, K, size):
    """Depth (H, W) [m], the pixels of the pillar, and the points (H, W, 3) in the world."""
    v, u = np.mgrid[0 : size[0], 0 : size[1]]
    rays = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(size)], axis=2)
    d = rays @ T[:3, :3].T
    with np.errstate(divide="ignore"):
        walls = np.where(d > 0, (HIGH - T[:3, 3]) / d, (LOW - T[:3, 3]) / d).min(axis=2)
        one, other = ((corner - T[:3, 3]) / d for corner in PILLAR)
    enter, leave = np.minimum(one, other).max(axis=2), np.maximum(one, other).min(axis=2)
    hit = (enter < leave) & (enter > 0)
    depth = np.where(hit, np.minimum(enter, walls), walls)
    return depth.astype(np.float32), hit, T[:3, 3] + d * depth[..., None]


def round_tour(count: int = 40) -> list[np.ndarray]:
    """Poses of a camera that goes half around the room and looks about."""
    t = np.linspace(0, 1, count)
    return [pose(-1.5 + 1.2 * s, -1.2 + 1.4 * s, 0.2 + 0.8 * np.sin(3 * s)) for s in t]
