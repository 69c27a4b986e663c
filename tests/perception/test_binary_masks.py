"""Binary masks: components, neighbours, distances and runs, against a search cell by cell."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from perception.binary_masks import connected_components, distance_to_walls, runs, with_neighbours

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
def test_a_mask_grows_by_the_four_cells_beside_each(mask: np.ndarray) -> None:
    expected = mask.copy()
    for x, y in np.argwhere(mask).tolist():
        for cell in beside(mask, x, y):
            expected[cell] = True
    assert (with_neighbours(mask) == expected).all()


@given(masks)
def test_distances_are_to_the_nearest_wall_up_to_the_greatest(mask: np.ndarray) -> None:
    walls = np.argwhere(~np.pad(mask, 1)) - 1
    found = distance_to_walls(mask, 2)
    for cell in np.ndindex(mask.shape):
        nearest = np.sqrt(((walls - cell) ** 2).sum(axis=1).min())
        assert abs(found[cell] - min(nearest, 2.0)) < 1e-5


@given(masks)
def test_runs_hold_the_cells_of_a_mask_without_gaps(mask: np.ndarray) -> None:
    again = np.zeros_like(mask)
    for row, first, end in runs(mask).tolist():
        assert first < end
        assert end == mask.shape[1] or not mask[row, end]
        assert not again[row, max(first - 1, 0) : end].any()
        again[row, first:end] = True
    assert (again == mask).all()


def test_a_mask_without_cells_has_no_components() -> None:
    assert connected_components(np.zeros((0, 3), np.bool_)).shape == (0, 3)
