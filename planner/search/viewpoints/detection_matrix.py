"""Detection matrix: the chance of each view to detect an object in each cell, in compressed rows.

Most entries are 0, since a view shows a few square metres of a floor; only the others are stored.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from planner.freespace.grid import Cells, FreeSpace, visible_cells

if TYPE_CHECKING:
    from planner.search.viewpoints.candidate_views import Sensor


@dataclass(frozen=True, slots=True, eq=False)
class DetectionMatrix:
    """(n, c) chances of n views to detect an object in c cells; compressed sparse rows."""

    starts: NDArray[np.intp]  # (n + 1,) of each row in `cell` and `value`
    cell: NDArray[np.intp]  # (m,) columns
    value: NDArray[np.float32]  # (m,) above 0
    columns: int  # c

    def __len__(self) -> int:
        """Number of views."""
        return len(self.starts) - 1

    def __getitem__(self, view: int) -> NDArray[np.float32]:
        """(c,) the row of a view."""
        row = np.zeros(self.columns, np.float32)
        cell, value = self.shown(view)
        row[cell] = value
        return row

    def __matmul__(self, weight: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) sums of `weight` (c,) by the chances."""
        return self.product(weight)

    def product(
        self, weight: NDArray[np.float64], value: NDArray[np.float32] | None = None
    ) -> NDArray[np.float64]:
        """As ``self @ weight``, with other chances `value` (m,) in the place of its own."""
        found = np.zeros(len(self))
        held = np.diff(self.starts) > 0
        if held.any():
            share = (self.value if value is None else value) * weight[self.cell]
            found[held] = np.add.reduceat(share, self.starts[:-1][held])
        return found

    def shown(self, view: int) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
        """Cells (k,) that a view shows, and the chances (k,)."""
        part = slice(self.starts[view], self.starts[view + 1])
        return self.cell[part], self.value[part]

    def rows(self, views: NDArray[np.intp]) -> DetectionMatrix:
        """The matrix of some `views` (k,)."""
        length = np.diff(self.starts)[views]
        starts = np.concatenate([[0], np.cumsum(length)]).astype(np.intp)
        at = np.repeat(self.starts[views] - starts[:-1], length) + np.arange(starts[-1])
        return DetectionMatrix(starts, self.cell[at], self.value[at], self.columns)

    def any(self, views: NDArray[np.bool_] | None = None) -> NDArray[np.bool_]:
        """(c,) cells that any of `views` (n,) shows, by default of all."""
        shown = np.zeros(self.columns, np.bool_)
        shown[self.cell if views is None else self.cell[views.repeat(np.diff(self.starts))]] = True
        return shown

    def greatest(self) -> NDArray[np.float32]:
        """(c,) the greatest chance of any view in each cell."""
        most = np.zeros(self.columns, np.float32)
        np.maximum.at(most, self.cell, self.value)
        return most


def detection_matrix(
    space: FreeSpace,
    sensor: Sensor,
    cells: Cells,
    viewpoints: Cells,
    kinds: Sequence[tuple[float, float]],
    proven: Cells,
) -> DetectionMatrix:
    """Chances in `cells` by views of `kinds` (heading, extent [rad]) from each viewpoint in turn.

    `proven` (m, 2) has pairs of a viewpoint and a cell that a camera showed from there.
    """
    heading, extent = np.array(kinds).reshape(-1, 2).T
    lengths, shown = [np.zeros(0, np.intp)], [np.zeros(0, np.intp)]
    chances = [np.zeros(0, np.float32)]
    for viewpoint in viewpoints:
        seen, offset = visible_cells(space, int(viewpoint), sensor.far)
        at = np.searchsorted(cells, seen)
        kept = (at < len(cells)) & (cells[np.minimum(at, len(cells) - 1)] == seen)
        also = np.unique(proven[proven[:, 0] == viewpoint, 1])
        kept &= ~np.isin(seen, also)
        at, offset = at[kept], offset[kept]
        metres = np.hypot(offset[:, 0], offset[:, 1])
        if len(also):
            there = space.centres(also) - space.centres([viewpoint])
            at, offset = np.append(at, np.searchsorted(cells, also)), np.vstack([offset, there])
            metres = np.append(metres, np.clip(np.hypot(*there.T), sensor.near, sensor.far))
        chance = sensor.chance(metres).astype(np.float32)
        off = (np.arctan2(offset[:, 1], offset[:, 0]) - heading[:, None] + np.pi) % (2 * np.pi)
        inside = (np.abs(off - np.pi) <= extent[:, None] / 2 + 1e-9) & (chance > 0)
        number = np.nonzero(inside)[1]
        lengths.append(inside.sum(axis=1))
        shown.append(at[number])
        chances.append(chance[number])
    starts = np.concatenate([[0], np.cumsum(np.concatenate(lengths))]).astype(np.intp)
    return DetectionMatrix(starts, np.concatenate(shown), np.concatenate(chances), len(cells))
