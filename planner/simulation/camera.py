"""A registered RGB-D camera in the house: colour, noisy depth, and what each pixel shows.

Depth noise follows Nguyen, Izadi and Lovell 2012 (Kinect v1, axial): it grows with z^2.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perception.frame import Frame
from planner.simulation.furniture import Solid
from planner.simulation.house import House
from planner.simulation.paint import Painter
from planner.simulation.raycast import FAR, Window, hit, rays_of

NOTHING = -1  # instance of walls, floor and furnishings


@dataclass(frozen=True, slots=True)
class CameraModel:
    """Pinhole camera and depth sensor."""

    width: int = 320  # [px]
    height: int = 240
    focal: float = 280.0  # [px]: a field of view of 59 x 46 deg, near a Kinect's 58 x 48
    near: float = 0.5  # [m] no depth nearer
    far: float = 6.0  # [m] no depth beyond
    mount_height: float = 1.25  # [m] above the floor
    pitch: float = np.deg2rad(14.0)  # [rad] downwards

    @property
    def K(self) -> NDArray[np.float64]:  # noqa: N802 the symbol everywhere
        """(3, 3) intrinsics [px]."""
        u, v = (self.width - 1) / 2, (self.height - 1) / 2
        return np.array([[self.focal, 0, u], [0, self.focal, v], [0, 0, 1.0]])

    def pose(self, x: float, y: float, heading: float) -> NDArray[np.float64]:
        """T_map_cam (4, 4) of a robot at (x, y) [m] that faces `heading` [rad]."""
        forward = np.array([np.cos(heading), np.sin(heading), 0.0])
        optical = np.cos(self.pitch) * forward - np.sin(self.pitch) * np.array([0, 0, 1.0])
        right = np.array([np.sin(heading), -np.cos(heading), 0.0])
        T = np.eye(4)
        T[:3, :3] = np.column_stack([right, np.cross(optical, right), optical])
        T[:3, 3] = x, y, self.mount_height
        return T


@dataclass(frozen=True, slots=True)
class View:
    """What the camera truly sees: free of noise, and with the identity of every pixel."""

    T_map_cam: NDArray[np.float64]  # (4, 4)
    depth: NDArray[np.float32]  # (H, W) [m] true
    instance: NDArray[np.int32]  # (H, W) index into House.objects, NOTHING elsewhere
    rgb: NDArray[np.uint8]  # (H, W, 3)
    silhouette: dict[int, float]  # instance -> pixels it would fill with nothing in front of it


class SimulatedCamera:
    """Renders the house. The same pose and frame id always give the same frame."""

    def __init__(self, house: House, model: CameraModel | None = None, seed: int = 0) -> None:
        self.house = house
        self.model = model or CameraModel()
        self._seed = seed
        instances = [(s, i) for i, item in enumerate(house.objects) for s in item.solids()]
        dead = [s for item in house.furnishings for s in item.solids()]
        dead += [s for wall in house.walls for s in wall.solids()]
        self._solids: list[Solid] = [s for s, _ in instances] + dead
        self._instance = [i for _, i in instances] + [NOTHING] * len(dead)
        self._corners = np.stack([_corners(s) for s in self._solids])  # (n, 8, 3)
        self._painter = Painter(house, self._solids)
        self._direction_cam = self._directions()
        self._last: View | None = None

    def frame(self, frame_id: str, T_map_cam: NDArray[np.float64], stamp: float) -> Frame:
        """One frame as a real sensor would give it."""
        view = self.view(T_map_cam)
        rng = self.random(frame_id, "depth")
        depth = view.depth + self._noise(view.depth, rng)
        depth[(view.depth < self.model.near) | (view.depth > self.model.far)] = np.nan
        return Frame(frame_id, view.rgb, depth, self.model.K, T_map_cam.copy(), stamp)

    def view(self, T_map_cam: NDArray[np.float64]) -> View:
        """What is truly seen from a pose; the last one is kept, for the senses look at it again."""
        if self._last is None or not np.array_equal(self._last.T_map_cam, T_map_cam):
            self._last = self._render(T_map_cam)
        return self._last

    def random(self, frame_id: str, purpose: str) -> np.random.Generator:
        """Randomness that depends on seed, frame and purpose alone, not on the order."""
        return np.random.default_rng([self._seed, zlib.crc32(f"{purpose}/{frame_id}".encode())])

    @staticmethod
    def _noise(depth: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.float32]:
        sigma = 0.0012 + 0.0019 * (depth - 0.4) ** 2
        return sigma * rng.standard_normal(depth.shape, dtype=np.float32)

    def _directions(self) -> NDArray[np.float32]:
        m = self.model
        u = (np.arange(m.width) - m.K[0, 2]) / m.focal
        v = (np.arange(m.height) - m.K[1, 2]) / m.focal
        grid_u, grid_v = np.meshgrid(u, v)
        return np.stack([grid_u, grid_v, np.ones_like(grid_u)]).astype(np.float32)

    def _render(self, T_map_cam: NDArray[np.float64]) -> View:
        rays = rays_of(self._direction_cam, T_map_cam)
        canvas = self._painter.canvas(rays)
        silhouettes: dict[int, NDArray[np.bool_]] = {}
        hidden: dict[int, float] = {}
        for k, window, nearest in self._in_sight(T_map_cam):
            instance = self._instance[k]
            if nearest > 0.5 and canvas.depth[window].max() < nearest:
                area = canvas.depth[window].size
                hidden[instance] = hidden.get(instance, 0.0) + 0.6 * area
                continue
            hits = hit(self._solids[k], rays, window)
            if instance != NOTHING:
                mask = silhouettes.setdefault(instance, np.zeros(canvas.depth.shape, np.bool_))
                mask[window] |= hits.t < FAR
            canvas.put(window, hits, k)
        silhouette = {i: hidden.get(i, 0.0) + float(m.sum()) for i, m in silhouettes.items()}
        solid_to_instance = np.append(np.array(self._instance, np.int32), NOTHING)
        return View(
            T_map_cam=T_map_cam.copy(),
            depth=canvas.depth,
            instance=solid_to_instance[canvas.solid],
            rgb=self._painter.paint(canvas, rays),
            silhouette=silhouette,
        )

    def _in_sight(self, T_map_cam: NDArray[np.float64]) -> list[tuple[int, Window, float]]:
        """(solid, pixels it may fill, least depth) of what the frustum touches, nearest first."""
        m = self.model
        p_cam = (self._corners - T_map_cam[:3, 3]) @ T_map_cam[:3, :3]  # (n, 8, 3)
        z = p_cam[..., 2]
        nearest, furthest = z.min(axis=1), z.max(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            uv = p_cam[..., :2] / z[..., None] * m.focal + m.K[:2, 2]
        lo, hi = np.floor(uv.min(axis=1)), np.ceil(uv.max(axis=1)) + 1
        behind = nearest < 0.05  # some corner has no place in the image: look everywhere
        lo[behind], hi[behind] = 0, (m.width, m.height)
        lo, hi = np.maximum(lo, 0), np.minimum(hi, (m.width, m.height))
        seen = (furthest > 0.05) & (lo < hi).all(axis=1)
        order = np.flatnonzero(seen)[np.argsort(nearest[seen], kind="stable")]
        return [
            (
                int(k),
                (slice(int(lo[k, 1]), int(hi[k, 1])), slice(int(lo[k, 0]), int(hi[k, 0]))),
                float(nearest[k]),
            )
            for k in order
        ]


def _corners(solid: Solid) -> NDArray[np.float64]:
    choice = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, 8).T
    return np.where(choice, solid.hi, solid.lo)
