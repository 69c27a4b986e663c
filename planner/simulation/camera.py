"""A registered RGB-D camera in the house: colour and light, noisy depth, the identity of pixels."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from perception.frames import Frame
from planner.simulation.house import WALL_HEIGHT, House, Solid
from planner.simulation.ray_casting import FAR, Floats, Hits, Rays, Window, hit, rays_of

FLOOR = -1  # `Canvas.solid` of floor and ceiling
CELL = 0.04  # [m] of the lookup tables of the floor
CEILING = np.array([0.96, 0.96, 0.95], np.float32)
SUN = np.array([0.30, -0.45, 0.84], np.float32)  # towards the lights
FILL = np.array([-0.70, 0.50, 0.30], np.float32)


@dataclass(frozen=True, slots=True)
class Canvas:
    """An image under construction: the nearest surface of each pixel so far."""

    depth: Floats  # (H, W) [m]
    normal: Floats  # (3, H, W)
    solid: NDArray[np.int32]  # (H, W) index of the solid, FLOOR

    def put(self, window: Window, hits: Hits, solid: int) -> None:
        """Draw the pixels that are nearer than the surface drawn so far."""
        depth = self.depth[window]
        nearer = hits.t < depth
        np.copyto(depth, hits.t, where=nearer)
        np.copyto(self.solid[window], np.int32(solid), where=nearer)
        for i in range(3):
            target = self.normal[i][window]
            if hits.normal is not None:
                np.copyto(target, hits.normal[i], where=nearer)
            elif hits.axis is not None:
                np.copyto(target, hits.axis == i, where=nearer)  # its sign comes with the light


class Shader:
    """Paints canvases of one house."""

    def __init__(self, house: House, solids: list[Solid]) -> None:
        self._solids = solids
        self._colours = np.array([s.colour for s in solids], np.float32)
        self._is_box = np.array([s.shape == "box" for s in solids] + [False])
        self._origin = np.array([house.extent[0], house.extent[2]], np.float32)
        floor = self._floor_table(house)
        self._floor_shape = floor.shape[:2]
        ceiling = CEILING * np.float32(0.98)
        self._ground_colours = np.concatenate([floor.reshape(-1, 3), ceiling[None]])

    def canvas(self, rays: Rays) -> Canvas:
        """Canvas of floor and ceiling."""
        up = rays.direction[2] > 0
        level = np.where(up, np.float32(WALL_HEIGHT), np.float32(0)) - rays.origin[2]
        depth = np.minimum(level * rays.inverse[2], np.float32(99))
        normal = np.zeros((3, *depth.shape), np.float32)
        normal[2] = np.where(up, -1, 1)
        return Canvas(depth, normal, np.full(depth.shape, FLOOR, np.int32))

    def paint(self, canvas: Canvas, rays: Rays) -> NDArray[np.uint8]:
        """(H, W, 3) uint8: surface colour times light."""
        point = rays.origin[:, None, None] + rays.direction * canvas.depth
        # FLOOR takes the last one, replaced below
        colour = self._colours.take(canvas.solid, axis=0, mode="wrap")
        ground = canvas.solid == FLOOR
        pixels = np.flatnonzero(ground)
        colour.reshape(-1, 3)[pixels] = self._ground(point.reshape(3, -1).take(pixels, axis=1))
        light = self._light(canvas, rays) * self._shade(point[2], ground)
        colour *= light[..., None]
        np.clip(colour, 0, 1, out=colour)
        colour *= 255
        return colour.astype(np.uint8)

    def incidence(self, canvas: Canvas, rays: Rays) -> Floats:
        """(H, W) cosine of the angle between each ray and the surface's normal, 0..1."""
        along = np.abs(np.sum(canvas.normal * rays.direction, axis=0))
        return np.asarray(along / np.linalg.norm(rays.direction, axis=0), np.float32)

    def _light(self, canvas: Canvas, rays: Rays) -> Floats:
        n = canvas.normal
        # a box's normal has no sign yet: that of the visible face is against the ray
        box = self._is_box[canvas.solid]
        sign = np.where(box, -np.sign(np.sum(n * rays.direction, axis=0)), np.float32(1))
        diffuse = np.float32(0.34) * np.maximum(np.einsum("i,ihw->hw", SUN, n) * sign, 0)
        diffuse += np.float32(0.16) * np.maximum(np.einsum("i,ihw->hw", FILL, n) * sign, 0)
        diffuse += np.float32(0.05) * np.abs(n[0])
        away = np.float32(1) / (np.float32(1) + np.float32(0.03) * canvas.depth)
        return np.asarray((np.float32(0.80) + diffuse) * away, np.float32)

    def _ground(self, point: Floats) -> Floats:
        height, width = self._floor_shape
        cols, rows = ((point[:2] - self._origin[:, None]) / CELL).astype(np.int32)
        cells = rows.clip(0, height - 1) * width + cols.clip(0, width - 1)
        cells[point[2] >= 1] = height * width  # the ceiling
        return np.asarray(self._ground_colours.take(cells, axis=0), np.float32)

    @staticmethod
    def _shade(z: Floats, ground: NDArray[np.bool_]) -> Floats:
        """Factor that darkens surfaces a little towards the floor and the ceiling."""
        low = np.float32(1) - np.float32(0.16) * np.exp(-z / np.float32(0.12))
        high = np.float32(1) - np.float32(0.08) * np.exp((z - WALL_HEIGHT) / np.float32(0.15))
        return np.where(ground, np.float32(1), low * high).astype(np.float32)

    def _floor_table(self, house: House) -> Floats:
        """(rows, columns, 3) colours of the floor: boards or tiles, shadow under things."""
        xmin, xmax, ymin, ymax = house.extent
        x = np.arange(xmin, xmax, CELL) + CELL / 2
        y = np.arange(ymin, ymax, CELL) + CELL / 2
        table = np.zeros((len(y), len(x), 3), np.float32)
        for room in house.rooms:
            rows = np.flatnonzero((y >= room.ymin) & (y < room.ymax))
            cols = np.flatnonzero((x >= room.xmin) & (x < room.xmax))
            tint = _tiles if room.floor == "tiles" else _planks
            pattern = tint(x[cols][None, :], y[rows][:, None])
            table[np.ix_(rows, cols)] = pattern[..., None] * np.array(room.floor_colour)
        return table * self._shadow(len(y), len(x))[..., None]

    def _shadow(self, rows: int, cols: int) -> Floats:
        covered = np.zeros((rows, cols), np.float32)
        for solid in self._solids:
            if solid.lo[2] < 0.5 and solid.hi[2] > 0.05:
                lo = ((solid.lo[:2] - self._origin) / CELL).astype(int).clip(0)
                hi = ((solid.hi[:2] - self._origin) / CELL).astype(int) + 1
                covered[lo[1] : hi[1], lo[0] : hi[0]] = 1
        for _ in range(2):
            covered = _blur(_blur(covered, 3).T, 3).T
        return np.float32(1) - np.float32(0.34) * covered


def _planks(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    board = np.floor(y / 0.16)
    tone = np.sin(board * 12.9898 + np.floor((x + 0.53 * board) / 1.1) * 78.233) * 43758.5453
    joint = np.mod(y, 0.16) < 0.02
    grain = 0.92 + 0.14 * (tone - np.floor(tone)) - 0.12 * joint
    return np.asarray(grain, np.float64)


def _tiles(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    joint = (np.mod(x, 0.4) < CELL) | (np.mod(y, 0.4) < CELL)
    checker = np.mod(np.floor(x / 0.4) + np.floor(y / 0.4), 2)
    return np.asarray(1.0 - 0.07 * checker - 0.12 * joint, np.float64)


def _blur(values: Floats, radius: int) -> Floats:
    """Box blur along the first axis."""
    padded = np.pad(values, ((radius + 1, radius), (0, 0)), mode="edge")
    total = np.cumsum(padded, axis=0, dtype=np.float32)
    width = 2 * radius + 1
    return np.asarray((total[width:] - total[:-width]) / np.float32(width), np.float32)


NOTHING = -1  # instance of walls, floor and furnishings
KEPT_VIEWS: Final = 8  # frames that may be between reading and mapping
NEAR_PLANE = 0.05  # [m] depth of the near clipping plane
_CORNERS = np.array(np.meshgrid([False, True], [False, True], [False, True])).reshape(3, 8).T
#: pairs of corners that an edge of a box joins
_EDGES = np.array(
    [(a, b) for a in range(8) for b in range(a) if sum(_CORNERS[a] ^ _CORNERS[b]) == 1]
)


@dataclass(frozen=True, slots=True)
class DepthSensor:
    """A depth camera: its range and noise.

    Noise follows Nguyen, Izadi and Lovell, "Modeling Kinect sensor noise for improved 3D
    reconstruction and tracking" (3DIMPVT 2012), axial: it grows with z^2.
    """

    near: float = 0.5  # [m] no depth nearer
    far: float = 6.0  # [m] no depth beyond

    def measure(
        self,
        depth: NDArray[np.float32],
        incidence: NDArray[np.float32],
        returns: NDArray[np.bool_],
        rng: np.random.Generator,
    ) -> NDArray[np.float32]:
        """Measured depth (H, W) [m], nan = no return.

        `depth` (H, W) [m] is the true one, `incidence` (H, W) the cosine between ray and normal,
        `returns` (H, W) whether the surface gives depth at all.
        """
        sigma = 0.0012 + 0.0019 * (depth - 0.4) ** 2
        measured = depth + sigma * rng.standard_normal(depth.shape, dtype=np.float32)
        measured[(depth < self.near) | (depth > self.far)] = np.nan
        return measured


@dataclass(frozen=True, slots=True)
class CameraModel:
    """Pinhole camera and depth sensor."""

    width: int = 320  # [px]
    height: int = 240
    focal: float = 280.0  # [px]: a field of view of 59 x 46 deg, near a Kinect's 58 x 48
    depth: DepthSensor = field(default_factory=DepthSensor)
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
class TrueView:
    """The true view of the camera: without noise, with the identity of every pixel."""

    T_map_cam: NDArray[np.float64]  # (4, 4)
    depth: NDArray[np.float32]  # (H, W) [m] true
    instance: NDArray[np.int32]  # (H, W) index into House.objects, NOTHING elsewhere
    furnishing: NDArray[np.int32]  # (H, W) index into House.furnishings, NOTHING elsewhere
    incidence: NDArray[np.float32]  # (H, W) cosine between the ray and the surface's normal
    returns: NDArray[np.bool_]  # (H, W) whether the surface gives depth at all
    rgb: NDArray[np.uint8]  # (H, W, 3)
    silhouette: dict[int, float]  # instance -> pixels that it fills without occlusion
    inside: dict[int, float]  # instance -> share of its projected bounding box inside the image


class SimulatedCamera:
    """Renders the house. The same pose, time and frame id always give the same frame."""

    def __init__(self, house: House, model: CameraModel | None = None, seed: int = 0) -> None:
        self.house = house
        self.model = model or CameraModel()
        self._seed = seed
        owners = [(s, i, NOTHING) for i, o in enumerate(house.objects) for s in o.solids()]
        owners += [(s, NOTHING, i) for i, o in enumerate(house.furnishings) for s in o.solids()]
        owners += [(s, NOTHING, NOTHING) for wall in house.walls for s in wall.solids()]
        self._solids: list[Solid] = [s for s, _, _ in owners]
        self._instance = np.array([i for _, i, _ in owners] + [NOTHING], np.int32)
        self._furnishing = np.array([i for _, _, i in owners] + [NOTHING], np.int32)
        self._returns = np.array([s.depth_return for s in self._solids] + [True])
        self._painter = Shader(house, self._solids)
        self._direction_cam = self._directions()
        # frames are read while detectors still process earlier ones
        self._views = lru_cache(KEPT_VIEWS)(self._render)

    def frame(self, frame_id: str, T_map_cam: NDArray[np.float64], stamp: float) -> Frame:
        """One frame with the noise and gaps of the sensor."""
        view = self.view(T_map_cam, stamp)
        depth = self.model.depth.measure(
            view.depth, view.incidence, view.returns, self.random(frame_id, "depth")
        )
        return Frame(frame_id, view.rgb, depth, self.model.K, T_map_cam.copy(), stamp)

    def view(self, T_map_cam: NDArray[np.float64], stamp: float = 0.0) -> TrueView:
        """The true view from a pose; the latest ones are cached for the simulated senses."""
        return self._views(T_map_cam.tobytes(), stamp)

    def random(self, frame_id: str, purpose: str) -> np.random.Generator:
        """Randomness that depends on seed, frame and purpose alone, not on the order."""
        return np.random.default_rng([self._seed, zlib.crc32(f"{purpose}/{frame_id}".encode())])

    def _directions(self) -> NDArray[np.float32]:
        m = self.model
        u = (np.arange(m.width) - m.K[0, 2]) / m.focal
        v = (np.arange(m.height) - m.K[1, 2]) / m.focal
        grid_u, grid_v = np.meshgrid(u, v)
        return np.stack([grid_u, grid_v, np.ones_like(grid_u)]).astype(np.float32)

    def _solids_at(self, stamp: float) -> list[Solid]:
        """All solids as they stand at `stamp` [s]; nothing moves in this house."""
        return self._solids

    def _render(self, pose: bytes, stamp: float) -> TrueView:
        """The view from `pose`, the bytes of T_map_cam (4, 4)."""
        T_map_cam = np.frombuffer(pose).reshape(4, 4)
        solids = self._solids_at(stamp)
        boxes = self._projected(solids, T_map_cam)
        rays = rays_of(self._direction_cam, T_map_cam)
        canvas = self._painter.canvas(rays)
        silhouettes: dict[int, NDArray[np.bool_]] = {}
        hidden: dict[int, float] = {}
        for k, window, nearest in self._in_sight(boxes):
            instance = int(self._instance[k])
            if nearest > 0.5 and canvas.depth[window].max() < nearest:
                area = canvas.depth[window].size
                hidden[instance] = hidden.get(instance, 0.0) + 0.6 * area
                continue
            hits = hit(solids[k], rays, window)
            if instance != NOTHING:
                mask = silhouettes.setdefault(instance, np.zeros(canvas.depth.shape, np.bool_))
                mask[window] |= hits.t < FAR
            canvas.put(window, hits, k)
        return TrueView(
            T_map_cam=T_map_cam.copy(),
            depth=canvas.depth,
            instance=self._instance[canvas.solid],
            furnishing=self._furnishing[canvas.solid],
            incidence=self._painter.incidence(canvas, rays),
            returns=self._returns[canvas.solid],
            rgb=self._painter.paint(canvas, rays),
            silhouette={i: hidden.get(i, 0.0) + float(m.sum()) for i, m in silhouettes.items()},
            inside={i: self._inside(boxes, i) for i in silhouettes},
        )

    def _projected(self, solids: list[Solid], T_map_cam: NDArray[np.float64]) -> _Boxes:
        """Boxes in the image around the part of each solid that lies before the camera."""
        m = self.model
        lo_map, hi_map = np.array([s.lo for s in solids]), np.array([s.hi for s in solids])
        corners = np.where(_CORNERS, hi_map[:, None], lo_map[:, None])  # (n, 8, 3)
        p_cam = (corners - T_map_cam[:3, 3]) @ T_map_cam[:3, :3]
        z = p_cam[..., 2]
        nearest, furthest = z.min(axis=1), z.max(axis=1)
        cut = (nearest < NEAR_PLANE) & (furthest > NEAR_PLANE)
        before = np.maximum(z, NEAR_PLANE)[..., None]
        uv = p_cam[..., :2] / before * m.focal + m.K[:2, 2]
        lo, hi = uv.min(axis=1), uv.max(axis=1)
        if cut.any():
            ends = self._cut_edges(p_cam[cut])
            uv_cut = np.where(z[cut][..., None] < NEAR_PLANE, np.nan, uv[cut])
            both = np.concatenate([uv_cut, ends], axis=1)
            lo[cut], hi[cut] = np.nanmin(both, axis=1), np.nanmax(both, axis=1)
        return _Boxes(np.floor(lo), np.ceil(hi) + 1, nearest, furthest, cut)

    def _cut_edges(self, p_cam: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 12, 2) [px] where edges of boxes (n, 8, 3) [m] meet NEAR_PLANE, else nan."""
        a, b = p_cam[:, _EDGES[:, 0]], p_cam[:, _EDGES[:, 1]]
        crossing = (a[..., 2] < NEAR_PLANE) != (b[..., 2] < NEAR_PLANE)
        rise = np.where(crossing, b[..., 2] - a[..., 2], np.nan)
        share = (NEAR_PLANE - a[..., 2]) / rise
        point = a + share[..., None] * (b - a)
        return np.asarray(point[..., :2] / NEAR_PLANE * self.model.focal + self.model.K[:2, 2])

    def _inside(self, boxes: _Boxes, instance: int) -> float:
        own = np.flatnonzero(self._instance[:-1] == instance)
        if boxes.behind[own].any():
            return 0.5  # it stands beside the camera: an unknown part of it is cut off
        lo, hi = boxes.lo[own].min(axis=0), boxes.hi[own].max(axis=0)
        size = self.model.width, self.model.height
        seen = np.maximum(np.minimum(hi, size) - np.maximum(lo, 0), 0)
        return float(np.prod(seen / np.maximum(hi - lo, 1)))

    def _in_sight(self, boxes: _Boxes) -> list[tuple[int, Window, float]]:
        """(solid, window of the image, depth) of solids in the frustum, the nearest first."""
        size = self.model.width, self.model.height
        lo, hi = np.maximum(boxes.lo, 0), np.minimum(boxes.hi, size)
        seen = (boxes.furthest > NEAR_PLANE) & (lo < hi).all(axis=1)
        order = np.flatnonzero(seen)[np.argsort(boxes.nearest[seen], kind="stable")]
        return [
            (
                int(k),
                (slice(int(lo[k, 1]), int(hi[k, 1])), slice(int(lo[k, 0]), int(hi[k, 0]))),
                float(boxes.nearest[k]),
            )
            for k in order
        ]


@dataclass(frozen=True, slots=True)
class _Boxes:
    """Projected bounding boxes of n solids, not cut by the image."""

    lo: NDArray[np.float64]  # (n, 2) [px]
    hi: NDArray[np.float64]  # (n, 2) [px]
    nearest: NDArray[np.float64]  # (n,) [m] depth
    furthest: NDArray[np.float64]  # (n,) [m]
    behind: NDArray[np.bool_]  # (n,) whether a corner lies behind the camera
