"""Segmentation of the surface: voxels in a box, and parts that are joined."""

from __future__ import annotations

import numpy as np
import pytest

from mapping.things.segmentation import VoxelIndex, connected_parts

SIDES = np.eye(3, dtype=np.int64)


def cloud(seed: int, count: int, side: int) -> np.ndarray:
    """(n, 3) different voxels in a cube."""
    return np.unique(np.random.default_rng(seed).integers(0, side, (count, 3)), axis=0)


def test_voxels_in_a_box_are_counted_wherever_it_lies() -> None:
    cells, draw = cloud(1, 4000, 50), np.random.default_rng(2)
    index = VoxelIndex(cells)
    counts = list[int]()
    for _ in range(200):
        low = draw.integers(-30, 70, 3)
        high = low + draw.integers(0, 40, 3)
        counts.append(index.count(low, high))
        assert counts[-1] == ((cells >= low) & (cells <= high)).all(1).sum()
    assert min(counts) == 0 and max(counts) > 300
    assert VoxelIndex(cells[:0]).count(np.zeros(3, int), np.ones(3, int)) == 0


@pytest.mark.parametrize("count", [0, 60, 600, 1500])
def test_joined_parts_are_those_a_walk_from_side_to_side_reaches(count: int) -> None:
    cells = cloud(3, count, 14)
    there = {tuple(cell): n for n, cell in enumerate(cells.tolist())}
    expected, number = np.full(len(cells), -1), 0
    for start in range(len(cells)):
        if expected[start] >= 0:
            continue
        waiting = [start]
        while waiting:
            one = waiting.pop()
            if expected[one] < 0:
                expected[one] = number
                steps = np.concatenate([cells[one] + SIDES, cells[one] - SIDES]).tolist()
                waiting += [there[step] for step in map(tuple, steps) if step in there]
        number += 1
    assert connected_parts(cells, SIDES).tolist() == expected.tolist()
