"""Beliefs that mislead: a share of what is believed of rooms replaced by what is not so."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

Chances = NDArray[np.float64]


def permuted(share: float, chances: Chances, rng: np.random.Generator) -> Chances:
    """(rooms,) of which `share` is that of other rooms, drawn at random."""
    return np.asarray((1 - share) * chances + share * rng.permutation(chances), np.float64)


def evened(share: float, chances: Chances, rng: np.random.Generator) -> Chances:
    """(rooms,) of which `share` is the mean of all rooms."""
    return np.asarray((1 - share) * chances + share * chances.mean(), np.float64)


CORRUPTED: Final[dict[str, Callable[[Chances, np.random.Generator], Chances]]] = {
    f"{100 * share:.0f} % {word}": partial(how, share)
    for word, how in (("permuted", permuted), ("evened out", evened))
    for share in (0.1, 0.3)
}
