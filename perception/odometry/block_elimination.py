"""Block elimination: sparse symmetric systems of 6 x 6 blocks, solved in the order of least degree.

George and Liu, "The evolution of the minimum degree ordering algorithm", SIAM Review 31 (1989).
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(slots=True)
class BlockSystem:
    """A positive definite system: diagonal blocks, blocks beside them, and the right side."""

    diagonal: Floats  # (n, 6, 6)
    right: Floats  # (n, 6)
    beside: list[dict[int, Floats]]  # row -> column -> (6, 6), both (i, j) and (j, i)

    @classmethod
    def of(
        cls,
        diagonal: Floats,
        right: Floats,
        rows: NDArray[np.intp],
        columns: NDArray[np.intp],
        blocks: Floats,
    ) -> BlockSystem:
        """The system with blocks (m, 6, 6) at rows and columns (m,), and their transposes."""
        beside: list[dict[int, Floats]] = [{} for _ in diagonal]
        for i, j, block in zip(rows.tolist(), columns.tolist(), blocks, strict=True):
            beside[i][j] = beside[i][j] + block if j in beside[i] else block
            beside[j][i] = beside[j][i] + block.T if i in beside[j] else block.T
        return cls(diagonal.copy(), right.copy(), beside)

    def solved(self) -> Floats:
        """The solution (n, 6); the system is used up."""
        left = [(len(beside), row) for row, beside in enumerate(self.beside)]
        heapq.heapify(left)
        order = list[tuple[int, list[int], Floats]]()
        done = np.zeros(len(left), bool)
        while left:
            degree, row = heapq.heappop(left)
            if done[row] or degree != len(self.beside[row]):
                continue  # its degree has changed since
            done[row] = True
            order.append((row, *self._eliminated(row)))
            for other in order[-1][1]:
                heapq.heappush(left, (len(self.beside[other]), other))
        found = np.zeros_like(self.right)
        for row, near, factor in reversed(order):
            found[row] = self.right[row]
            if near:
                found[row] -= factor @ found[near].ravel()
        return found

    def _eliminated(self, row: int) -> tuple[list[int], Floats]:
        """Eliminate `row` from the others; its unknown is right - factor @ unknowns of the rows."""
        near = list(self.beside[row])
        if not near:
            self.right[row] = np.linalg.solve(self.diagonal[row], self.right[row])
            return near, np.zeros((6, 0))
        across = np.hstack([self.beside[row][i] for i in near])  # (6, 6 m)
        solved = np.linalg.solve(self.diagonal[row], np.hstack([across, self.right[row][:, None]]))
        factor, self.right[row] = solved[:, :-1], solved[:, -1]
        update = (across.T @ factor).reshape(len(near), 6, len(near), 6)
        self.right[near] -= (across.T @ self.right[row]).reshape(-1, 6)
        for a, i in enumerate(near):
            self.diagonal[i] -= update[a, :, a]
            row_of = self.beside[i]
            del row_of[row]
            for b, j in enumerate(near):
                if i != j:
                    block = update[a, :, b]
                    row_of[j] = row_of[j] - block if j in row_of else -block
        return near, factor
