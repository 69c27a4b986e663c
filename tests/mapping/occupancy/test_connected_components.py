"""Connected components of masks, against a search cell by cell."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from mapping.occupancy.connected_components import connected_components, neighbours

masks = npst.arrays(np.bool_, st.tuples(st.integers(1, 7), st.integers(1, 7)))


def beside(mask: np.ndarray, x: int, y: int) -> list[tuple[int, int]]:
    around = [(x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1)]
    return [(i, j) for i, j in around if 0 <= i < mask.shape[0] and 0 <= j < mask.shape[1]]


@given(masks)
def test_cells_share_a_number_where_a_way_joins_them(mask: np.ndarray) -> None:
    labels = connected_components(mask)
    assert ((labels >= 0) == mask).all()
    found = 0
    left = {(int(x), int(y)) for x, y in np.argwhere(mask)}
    while left:
        part, border = set(), {min(left)}
        while border:
            part |= border
            border = {c for at in border for c in beside(mask, *at) if mask[c]} - part
        assert len({int(labels[cell]) for cell in part}) == 1
        left -= part
        found += 1
    assert set(np.unique(labels[mask]).tolist()) == set(range(found))


@given(masks)
def test_neighbours_are_the_four_cells_beside_each(mask: np.ndarray) -> None:
    expected = np.zeros_like(mask)
    for x, y in np.argwhere(mask).tolist():
        for cell in beside(mask, x, y):
            expected[cell] = True
    assert (neighbours(mask) == expected).all()
