"""Grids of a floor, put together from tiles."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kg.model.records import FREE, LOW, TALL, UNKNOWN, FloorTile
from mapping.occupancy.mapped_floor import mapped_floor

SIDE = 8  # cells of a tile
STATES = st.lists(
    st.sampled_from((UNKNOWN, FREE, LOW, TALL)), min_size=SIDE * SIDE, max_size=SIDE * SIDE
)
TILES = st.dictionaries(
    st.tuples(st.integers(-3, 3), st.integers(-3, 3)), STATES, min_size=1, max_size=4
)


@settings(max_examples=40)
@given(TILES, st.sampled_from((0.05, 0.1, 0.25)))
def test_each_cell_of_a_tile_is_in_the_grid_where_it_was(tiles, cell):
    cells = {key: np.array(s, np.uint8).reshape(SIDE, SIDE) for key, s in tiles.items()}
    made = [FloorTile(0, *key, 0.0, cell, states, 0.0) for key, states in cells.items()]
    floor, every = mapped_floor(made), np.concatenate([*cells.values()])
    if not (every == FREE).any():
        assert floor is None
        return
    assert floor is not None
    for (column, row), states in cells.items():
        middles = (np.argwhere(states >= 0) + [column * SIDE, row * SIDE] + 0.5) * cell
        at = np.floor((middles - floor.origin) / floor.resolution).astype(int)
        assert (floor.states[at[:, 0], at[:, 1]] == states.ravel()).all()
        assert {floor.tile_at(p) for p in middles} == {(column, row)}
    occupied = int(np.isin(every, (LOW, TALL)).sum())
    expected = (int((every == FREE).sum()) * cell * cell, occupied * cell * cell)
    assert floor.areas == pytest.approx(expected)
    assert floor.cropped().areas == pytest.approx(expected)
    known = np.argwhere(floor.cropped().states != UNKNOWN)
    assert known.min() == 1  # one unknown cell around it all
