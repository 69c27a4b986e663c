"""Parts of one colour among joined voxels."""

from __future__ import annotations

import numpy as np

from mapping.things.colour_parts import colour_parts
from perception.colours import lab_colours

RED, WHITE = (200, 30, 30), (240, 240, 240)


def in_line(*colours: tuple[int, int, int]) -> list[int]:
    """Parts of voxels in line, each of which touches the next."""
    lab, steps = lab_colours(np.array(colours, np.uint8)), np.arange(len(colours) - 1)
    return colour_parts(lab, steps, steps + 1).tolist()


def test_neighbours_of_different_colours_are_different_parts() -> None:
    parts = in_line(*[RED] * 60, *[WHITE] * 60)
    assert parts == [0] * 60 + [1] * 60


def test_a_few_voxels_of_another_colour_belong_to_the_part_beside_them() -> None:
    assert set(in_line(*[RED] * 60, *[WHITE] * 5)) == {0}


def test_noise_of_a_colour_splits_nothing() -> None:
    noise = np.random.default_rng(1).integers(-6, 7, (200, 3))
    assert set(in_line(*(np.array(WHITE) - 10 + noise))) == {0}


def test_nothing_has_no_parts() -> None:
    nothing = np.empty(0, np.intp)
    assert colour_parts(lab_colours(np.empty((0, 3), np.uint8)), nothing, nothing).tolist() == []
