"""Pairs of two streams' images by their stamps."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.number_tables import in_seconds
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
def test_the_nearest_stamps_are_pairs(colour, depth, expected):
    assert sorted(nearest_pairs(np.array(colour), np.array(depth), 0.5)) == expected


@given(stamps, stamps, st.sampled_from([0.0, 0.125, 0.5, 10.0]))
def test_pairs_are_those_of_a_search_through_all(a, b, tolerance):
    pairs = nearest_pairs(a, b, tolerance)
    for used in zip(*pairs, strict=True):
        assert len(set(used)) == len(pairs)  # no image twice
    left = {(i, j) for i in range(len(a)) for j in range(len(b)) if abs(a[i] - b[j]) <= tolerance}
    for i, j in pairs:
        assert abs(a[i] - b[j]) == min(abs(a[m] - b[n]) for m, n in left)
        left = {(m, n) for m, n in left if m != i and n != j}
    assert not left


TOLD, UNTOLD = True, False


@pytest.mark.parametrize("rate", [1.0, 10.0, 30.0, 200.0])
@pytest.mark.parametrize(
    ("begin", "per_second", "told"),
    [
        (1_700_000_000, 10**9, UNTOLD),
        (1_700_000_000, 10**6, UNTOLD),
        (1_700_000_000, 10**3, UNTOLD),
        (0, 10**9, TOLD),
        (0, 10**6, TOLD),
        (3_000_000, 10**9, TOLD),  # time since the computer was started: 35 days
        (3_000_000, 10**6, TOLD),
    ],
)
def test_whole_numbers_as_stamps_have_the_unit_of_their_date_or_step(
    rate: float, begin: int, per_second: int, told: bool, caplog: pytest.LogCaptureFixture
) -> None:
    seconds = begin + np.arange(40) / rate
    read = in_seconds(np.rint(seconds * per_second), Path("rgb.txt"))
    np.testing.assert_allclose(read - read[0], seconds - seconds[0], atol=2e-3)
    assert ("rgb.txt: its stamps" in caplog.text) == told


@pytest.mark.parametrize("step", [0.0333, 1.0, 10.0, 33.5])
@pytest.mark.parametrize("begin", [0.0, 1.7e9])
def test_stamps_in_seconds_stay(step: float, begin: float) -> None:
    stamps = begin + step * np.arange(40)
    np.testing.assert_array_equal(in_seconds(stamps, Path("rgb.txt")), stamps)
