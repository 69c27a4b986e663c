"""Optimal assignment of rows to columns at least total cost, by shortest augmenting paths."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def assign(cost: NDArray[np.float64]) -> dict[int, int]:
    """Row -> column of least total cost; pairs of infinite cost are never made.

    `cost` (n, m), inf where a pair is impossible. As many pairs as possible are made first.
    """
    possible = np.isfinite(cost)
    rows, columns = np.nonzero(possible.any(axis=1))[0], np.nonzero(possible.any(axis=0))[0]
    if len(rows) == 0:
        return {}
    part = cost[np.ix_(rows, columns)]
    forbidden = 1.0 + 2 * float(part[np.isfinite(part)].sum())
    filled = np.where(np.isfinite(part), part, forbidden)
    flipped = filled.shape[0] > filled.shape[1]
    pairs = _shortest_augmenting_paths(filled.T if flipped else filled)
    found = [(c, r) if flipped else (r, c) for r, c in pairs]
    return {int(rows[r]): int(columns[c]) for r, c in found if np.isfinite(part[r, c])}


def _shortest_augmenting_paths(cost: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Pairs (row, column) for a finite `cost` (n, m) with n <= m."""
    n, m = cost.shape
    row_price, column_price = np.zeros(n + 1), np.zeros(m + 1)
    owner = np.zeros(m + 1, dtype=np.intp)  # row of each column, both from 1; 0: none
    for row in range(1, n + 1):
        owner[0], column = row, 0
        least, used = np.full(m + 1, np.inf), np.zeros(m + 1, dtype=bool)
        before = np.zeros(m + 1, dtype=np.intp)
        while owner[column] != 0:
            used[column] = True
            current = owner[column]
            reduced = cost[current - 1] - row_price[current] - column_price[1:]
            better = ~used[1:] & (reduced < least[1:])
            least[1:][better], before[1:][better] = reduced[better], column
            column = int(np.argmin(np.where(used, np.inf, least)[1:])) + 1
            step = least[column]
            row_price[owner[used]] += step
            column_price[used] -= step
            least[~used] -= step
        while column != 0:
            owner[column] = owner[before[column]]
            column = int(before[column])
    return [(int(owner[c]) - 1, c - 1) for c in range(1, m + 1) if owner[c] != 0]
