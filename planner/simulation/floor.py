"""Where the robot can stand, and the shortest way there: a grid of the free floor.

Shortest paths are Dijkstra's on the eight-connected grid, straightened where the line is free.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from kg.errors import LayoutError
from planner.simulation.house import House

CELL = 0.10  # [m]
ROBOT_RADIUS = 0.24  # [m]
ROBOT_HEIGHT = 1.30  # [m] what lies above does not stop it
STEP_HEIGHT = 0.02  # [m] what is lower it drives over

_MOVES = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j]


class Floor:
    """The free floor of a house."""

    def __init__(self, house: House) -> None:
        xmin, xmax, ymin, ymax = house.extent
        self._origin = np.array([xmin, ymin])
        columns, rows = round((xmax - xmin) / CELL), round((ymax - ymin) / CELL)
        x, y = xmin + (np.arange(columns) + 0.5) * CELL, ymin + (np.arange(rows) + 0.5) * CELL
        self.free = np.ones((columns, rows), np.bool_)  # (x, y)
        items = [s for item in (*house.objects, *house.furnishings) for s in item.solids()]
        for solid in [*items, *(s for wall in house.walls for s in wall.solids())]:
            if solid.lo[2] > ROBOT_HEIGHT or solid.hi[2] < STEP_HEIGHT:
                continue
            dx = np.maximum(np.maximum(solid.lo[0] - x, x - solid.hi[0]), 0)
            dy = np.maximum(np.maximum(solid.lo[1] - y, y - solid.hi[1]), 0)
            self.free &= np.hypot(dx[:, None], dy[None, :]) > ROBOT_RADIUS

    def path(self, start: NDArray[np.float64], goal: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 2) [m] corners of the shortest way from `start` to where one can stand near `goal`.

        Raises LayoutError where no free floor is reachable.
        """
        source = self._nearest(start, self.free)
        cost, parent = self._flood(source)
        target = self._nearest(goal, np.isfinite(cost))
        cells = [target]
        while cells[-1] != source:
            cells.append(parent[cells[-1]])
        corners = [self._centre(c) for c in self._straightened(cells[::-1])]
        return np.array([np.asarray(start, np.float64), *corners[1:]])

    def _nearest(self, point: NDArray[np.float64], allowed: NDArray[np.bool_]) -> tuple[int, int]:
        cells = np.argwhere(allowed)
        if not len(cells):
            raise LayoutError(f"no free floor near ({point[0]:.2f}, {point[1]:.2f})")
        centres = self._origin + (cells + 0.5) * CELL
        i, j = cells[np.argmin(np.linalg.norm(centres - point, axis=1))]
        return int(i), int(j)

    def _centre(self, cell: tuple[int, int]) -> NDArray[np.float64]:
        return np.asarray(self._origin + (np.array(cell) + 0.5) * CELL, np.float64)

    def _flood(
        self, source: tuple[int, int]
    ) -> tuple[NDArray[np.float64], dict[tuple[int, int], tuple[int, int]]]:
        cost = np.full(self.free.shape, np.inf)
        cost[source] = 0.0
        parent: dict[tuple[int, int], tuple[int, int]] = {}
        queue = [(0.0, source)]
        while queue:
            so_far, cell = heapq.heappop(queue)
            if so_far > cost[cell]:
                continue
            for neighbour, length in self._neighbours(cell):
                if so_far + length < cost[neighbour]:
                    cost[neighbour] = so_far + length
                    parent[neighbour] = cell
                    heapq.heappush(queue, (so_far + length, neighbour))
        return cost, parent

    def _neighbours(self, cell: tuple[int, int]) -> Iterator[tuple[tuple[int, int], float]]:
        columns, rows = self.free.shape
        for i, j in _MOVES:
            x, y = cell[0] + i, cell[1] + j
            if 0 <= x < columns and 0 <= y < rows and self.free[x, y]:
                yield (x, y), CELL * (1.4142135623730951 if i and j else 1.0)

    def _straightened(self, cells: list[tuple[int, int]]) -> list[tuple[int, int]]:
        kept, k = [cells[0]], 0
        while k < len(cells) - 1:
            reach = len(cells) - 1
            while reach > k + 1 and not self._clear(cells[k], cells[reach]):
                reach -= 1
            k = reach
            kept.append(cells[k])
        return kept

    def _clear(self, a: tuple[int, int], b: tuple[int, int]) -> bool:
        n = 3 * max(abs(a[0] - b[0]), abs(a[1] - b[1]), 1)
        line = np.rint(np.linspace(a, b, n + 1)).astype(int)
        return bool(self.free[line[:, 0], line[:, 1]].all())


def length_of(path: NDArray[np.float64]) -> float:
    """Length [m] of a polyline (n, 2)."""
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
