"""Optimal assignment against all assignments there are."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from mapping.objects.association import assign

Costs = NDArray[np.float64]


@st.composite
def costs(draw: st.DrawFn) -> Costs:
    """Small cost matrices in which some pairs are impossible."""
    shape = draw(st.integers(1, 4)), draw(st.integers(1, 4))
    cell = st.one_of(st.just(np.inf), st.integers(0, 50).map(lambda n: n / 10))
    values = draw(st.lists(cell, min_size=shape[0] * shape[1], max_size=shape[0] * shape[1]))
    return np.array(values, dtype=np.float64).reshape(shape)


def best(cost: Costs) -> tuple[int, float]:
    """Most pairs that can be made, and the least total cost of that many."""
    rows, columns = cost.shape
    padded = np.full((max(rows, columns), max(rows, columns)), np.inf)
    padded[:rows, :columns] = cost
    outcomes = []
    for order in permutations(range(len(padded))):
        made = [padded[row, column] for row, column in enumerate(order)]
        finite = [value for value in made if np.isfinite(value)]
        outcomes.append((-len(finite), sum(finite)))
    pairs, total = min(outcomes)
    return -pairs, total


@given(costs())
def test_it_is_the_best_of_all_assignments(cost):
    found = assign(cost)
    assert len(set(found.values())) == len(found), "each column at most once"
    total = sum(cost[row, column] for row, column in found.items())
    pairs, least = best(cost)
    assert len(found) == pairs
    assert total == pytest.approx(least)


@given(costs())
def test_rows_and_columns_are_alike(cost):
    one, other = assign(cost), assign(cost.T)
    assert sum(cost[r, c] for r, c in one.items()) == pytest.approx(
        sum(cost[r, c] for c, r in other.items())
    )


def test_a_cheap_pair_gives_way_where_the_whole_is_cheaper():
    assert assign(np.array([[1.0, 2.0], [1.1, 9.0]])) == {0: 1, 1: 0}


@pytest.mark.parametrize("shape", [(0, 0), (0, 3), (3, 0)])
def test_nothing_is_assigned_to_nothing(shape):
    assert assign(np.zeros(shape)) == {}


def test_impossible_pairs_are_not_made():
    assert assign(np.full((2, 2), np.inf)) == {}
    assert assign(np.array([[np.inf, np.inf], [0.5, np.inf]])) == {1: 0}
