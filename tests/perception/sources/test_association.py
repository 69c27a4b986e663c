"""Pairs of two streams' images by their stamps."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.sources.listing import nearest_pairs

stamps = st.lists(st.integers(0, 40), max_size=8).map(lambda n: np.array(n, float) / 8)


@pytest.mark.parametrize(
    ("colour", "depth", "expected"),
    [
        ([0.0, 0.01], [0.012], [(1, 0)]),  # one depth image is used once, by the nearest
        ([0.012], [0.0, 0.01], [(0, 1)]),
        ([0.0, 0.03], [0.001, 0.002, 0.02], [(0, 0), (1, 2)]),
        ([1.0], [1.5], [(0, 0)]),  # the tolerance is included
        ([1.0], [0.5], [(0, 0)]),
        ([1.0], [1.75], []),
        ([], [1.0], []),
        ([1.0], [], []),
        ([2.0, 1.0], [1.0, 2.0], [(0, 1), (1, 0)]),  # in any order
    ],
)
def test_the_nearest_stamps_are_pairs(
    colour: list[float], depth: list[float], expected: list[tuple[int, int]]
) -> None:
    assert sorted(nearest_pairs(np.array(colour), np.array(depth), 0.5)) == expected


@given(stamps, stamps, st.sampled_from([0.0, 0.125, 0.5, 10.0]))
def test_pairs_are_those_of_a_search_through_all(
    a: np.ndarray, b: np.ndarray, tolerance: float
) -> None:
    pairs = nearest_pairs(a, b, tolerance)
    for used in zip(*pairs, strict=True):
        assert len(set(used)) == len(pairs)  # no image twice
    left = {(i, j) for i in range(len(a)) for j in range(len(b)) if abs(a[i] - b[j]) <= tolerance}
    for i, j in pairs:
        assert abs(a[i] - b[j]) == min(abs(a[m] - b[n]) for m, n in left)
        left = {(m, n) for m, n in left if m != i and n != j}
    assert not left
