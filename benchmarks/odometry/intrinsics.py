"""Wrong intrinsics of recordings, and whether their own views tell them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from perception.frames import Frame
from perception.sources.intrinsics_check import WARNED, intrinsics_off

Floats = NDArray[np.float64]

PARTS: Final = {
    "all": slice(None),
    "2nd": slice(None, None, 2),
    "4th": slice(None, None, 4),
    "backwards": slice(None, None, -1),
}


def wrong_intrinsics(K: Floats) -> dict[str, Floats]:
    """The right intrinsics (3, 3) [px] and wrong ones, by name."""

    def times(focal: float, centre: float) -> Floats:
        return K * np.array([[focal, 1, centre], [1, focal, centre], [1, 1, 1]])

    swapped = K.copy()
    swapped[:2, 2] = K[1, 2], K[0, 2]
    return {
        "right": K,
        "focal length 25 % too short": times(0.75, 1),
        "focal length 25 % too long": times(1.25, 1),
        "width and height swapped": swapped,
        "principal point of half the size": times(1, 0.5),
        "all of half the size": times(0.5, 0.5),
        "all of 1.5 times the size": times(1.5, 1.5),
    }


def parts(frames: Sequence[Frame]) -> Iterator[tuple[str, Sequence[Frame]]]:
    """The whole, other rates, and halves and quarters of a recording, by name."""
    for name, part in PARTS.items():
        yield name, frames[part]
    for count in (2, 4):
        size = len(frames) // count
        for number in range(count):
            yield f"{number + 1} of {count}", frames[number * size : (number + 1) * size]


def rows(frames: Sequence[Frame]) -> Iterator[str]:
    """A line for each intrinsics: how many parts tell it, and how far off they are."""
    for name, K in wrong_intrinsics(frames[0].K).items():
        off = np.array([_off(part, K) for _, part in parts(frames)])
        told = off >= WARNED
        reach = f"{off[told].min():.2f} to {off[told].max():.2f}" if told.any() else ""
        yield f"{name:34} told {told.sum()}/{len(told)}  off {reach}"


def _off(frames: Sequence[Frame], K: Floats) -> float:
    changed = [replace(frame, K=K) for frame in frames]
    return intrinsics_off([frame.T_map_cam for frame in frames], changed.__getitem__)[0]
