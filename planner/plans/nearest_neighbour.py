"""Nearest-neighbour order: always on to the nearest of what remains (thesis section 3.4)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

T = TypeVar("T")


def nearest_neighbour(items: Iterable[T], metres: Callable[[T | None, T], float]) -> Iterator[T]:
    """Yields `items` in nearest-neighbour order; of those equally near, the one given first.

    `metres(here, item)` is the distance [m] from the item that was last yielded, None at the start.
    It is called anew before each item, so that it may depend on where a robot is by then.
    """
    left, here = list(items), None
    while left:
        distances = [metres(here, item) for item in left]
        here = left.pop(distances.index(min(distances)))
        yield here
