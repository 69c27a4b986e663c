"""Floor grid of a simulated house: free floor for the robot, and shortest paths over it.

Paths are those of `planner.freespace.geodesic`, straightened where the line is free.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.freespace.geodesic import distance_fields, shortest_path
from planner.freespace.grid import NO_ROOM, FreeSpace
from planner.simulation.houses.house import House

CELL = 0.10  # [m]
ROBOT_RADIUS = 0.24  # [m]
ROBOT_HEIGHT = 1.30  # [m] solids above do not stop the robot
STEP_HEIGHT = 0.02  # [m] the robot drives over lower solids


class FloorGrid:
    """Occupancy grid of a house, inflated by the robot's radius."""

    def __init__(self, house: House) -> None:
        xmin, xmax, ymin, ymax = house.extent
        self._origin = np.array([xmin, ymin])
        columns, rows = round((xmax - xmin) / CELL), round((ymax - ymin) / CELL)
        x, y = xmin + (np.arange(columns) + 0.5) * CELL, ymin + (np.arange(rows) + 0.5) * CELL
        self.clearance = np.full((columns, rows), np.inf)  # (x, y) [m] to the nearest obstacle
        items = [s for item in (*house.objects, *house.furnishings) for s in item.solids()]
        for solid in [*items, *(s for wall in house.walls for s in wall.solids())]:
            if solid.lo[2] > ROBOT_HEIGHT or solid.hi[2] < STEP_HEIGHT:
                continue
            dx = np.maximum(np.maximum(solid.lo[0] - x, x - solid.hi[0]), 0)
            dy = np.maximum(np.maximum(solid.lo[1] - y, y - solid.hi[1]), 0)
            np.minimum(self.clearance, np.hypot(dx[:, None], dy[None, :]), out=self.clearance)
        self.free = self.clearance > ROBOT_RADIUS  # (x, y)

    def path(self, start: NDArray[np.float64], goal: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 2) [m] corners of the shortest path from `start` to the free floor nearest to `goal`.

        Raises LayoutError where no free floor is reachable.
        """
        space = self._space()
        source = space.nearest(start)
        reached = np.flatnonzero(space.reachable(source))
        away = np.linalg.norm(space.centres(reached) - goal, axis=1)
        field = distance_fields(space, [int(reached[np.argmin(away)])])[0]
        cells = shortest_path(space, field, source)
        corners = space.centres(self._straightened([divmod(int(c), space.shape[1]) for c in cells]))
        return np.array([np.asarray(start, np.float64), *corners[1:]])

    def reachable(self, start: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(x, y) whether the robot can drive to each cell from the floor nearest to `start` [m]."""
        space = self._space()
        return space.reachable(space.nearest(start)).reshape(self.free.shape)

    def centres(self, cells: NDArray[np.bool_]) -> NDArray[np.float64]:
        """(n, 2) [m] centres of the marked cells (x, y)."""
        return np.asarray(self._origin + (np.argwhere(cells) + 0.5) * CELL, np.float64)

    def _space(self) -> FreeSpace:
        return FreeSpace(self._origin, CELL, np.where(self.free, 0, NO_ROOM).astype(np.int32))

    def _straightened(self, cells: list[tuple[int, int]]) -> NDArray[np.intp]:
        """Numbers (n,) of the cells of `cells` (ix, iy) that no free straight line skips."""
        kept, k = [cells[0]], 0
        while k < len(cells) - 1:
            reach = len(cells) - 1
            while reach > k + 1 and not self._clear(cells[k], cells[reach]):
                reach -= 1
            k = reach
            kept.append(cells[k])
        return np.array([i * self.free.shape[1] + j for i, j in kept], np.intp)

    def _clear(self, a: tuple[int, int], b: tuple[int, int]) -> bool:
        n = 3 * max(abs(a[0] - b[0]), abs(a[1] - b[1]), 1)
        line = np.rint(np.linspace(a, b, n + 1)).astype(int)
        return bool(self.free[line[:, 0], line[:, 1]].all())
