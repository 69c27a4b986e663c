"""Colours of the house: floors and ceiling, light on surfaces, soft shadows below things."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.simulation.houses.furniture import Solid
from planner.simulation.houses.house import WALL_HEIGHT, House
from planner.simulation.sensing.ray_casting import Floats, Hits, Rays, Window

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
        depth[nearer] = hits.t[nearer]
        self.solid[window][nearer] = solid
        for i in range(3):
            target = self.normal[i][window]
            if hits.normal is not None:
                target[nearer] = hits.normal[i][nearer]
            elif hits.axis is not None:
                target[nearer] = (hits.axis == i)[nearer]  # its sign comes with the light


class Shader:
    """Paints canvases of one house."""

    def __init__(self, house: House, solids: list[Solid]) -> None:
        self._solids = solids
        self._colours = np.array([s.colour for s in solids], np.float32)
        self._is_box = np.array([s.shape == "box" for s in solids] + [False])
        self._origin = np.array([house.extent[0], house.extent[2]], np.float32)
        self._floor = self._floor_table(house)

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
        colour = self._colours[canvas.solid]  # FLOOR takes the last one, replaced below
        ground = canvas.solid == FLOOR
        colour[ground] = self._ground(point[:, ground])
        light = self._light(canvas, rays) * self._shade(point[2], ground)
        return np.asarray(np.clip(colour * light[..., None], 0, 1) * 255, np.uint8)

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
        colour = np.empty((point.shape[1], 3), np.float32)
        colour[:] = CEILING * np.float32(0.98)
        low = point[2] < 1
        cells = ((point[:2, low] - self._origin[:, None]) / CELL).astype(np.int32)
        rows = np.clip(cells[1], 0, self._floor.shape[0] - 1)
        cols = np.clip(cells[0], 0, self._floor.shape[1] - 1)
        colour[low] = self._floor[rows, cols]
        return colour

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
