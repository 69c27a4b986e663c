"""Persistence of objects: half-lives of classes, from a table and from a map's observations."""

from __future__ import annotations

import csv
from collections.abc import Collection, Iterable
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Final

import numpy as np

_HOUR: Final = 3600.0
_DAY: Final = 24 * _HOUR

#: [s] after which half of the objects of a mobility class have left the spot where they were seen.
#: Orders of magnitude, not measurements; `mapping/mobility.csv` has the class of each category.
HALF_LIVES: Final = MappingProxyType(
    {
        "moving": 300.0,  # goes by itself: people, animals, vehicles
        "in use": 12 * _HOUR,  # picked up many times a day: cups, phones
        "consumed": 2 * _DAY,  # food
        "carried": 4 * _DAY,  # bags, books, toys
        "tool": 30 * _DAY,  # has its spot and returns to it: keyboards, vases
        "furniture": 365 * _DAY,  # chairs are moved, though mostly within their room
        "fixed": 3650 * _DAY,  # refrigerators, toilets, sinks
    }
)
#: mobility class of categories that the file does not list
UNLISTED: Final = "carried"
MIN_DEPARTED: Final = 0.02  # greatest prior probability that a thing left at once, ...
MAX_DEPARTED: Final = 0.2  # ... and after any time


@cache
def mobility_table() -> dict[str, str]:
    """Label of a category, or of one above it, to its mobility class."""
    with Path(__file__).with_name("mobility.csv").open(encoding="utf-8", newline="") as file:
        return {row["category"]: row["mobility"] for row in csv.DictReader(file)}


def listed_half_life(label: str, above: Collection[str] = ()) -> float:
    """[s] for a category by its own label, or else by the shortest-lived of those above it."""
    table = mobility_table()
    if label in table:
        return HALF_LIVES[table[label]]
    lives = [HALF_LIVES[table[name]] for name in above if name in table]
    return min(lives, default=HALF_LIVES[UNLISTED])


def departed(half_life: float, age: float) -> float:
    """Prior probability that a thing last seen `age` seconds ago has left its spot.

    It stays at or below MAX_DEPARTED, since most things that people use return to their spots. It
    begins with the probability of a day, at most MIN_DEPARTED, since people carry things away in
    front of the camera.
    """
    first = min(MIN_DEPARTED, _DAY / half_life)
    return first + (MAX_DEPARTED - first) * (1.0 - holds(half_life, age))


def learned_half_life(listed: float, stays: Iterable[float]) -> float:
    """[s] of a class, from its `listed` half-life [s] and how long its objects were seen to stay.

    Objects leave at a constant rate; a Gamma prior of one departure in the time that `listed` makes
    one likely, then the witnessed seconds without a departure. Each stay counts up to twice the
    listed half-life, so that one thing glued down does not speak for its whole class.
    """
    prior = listed / np.log(2)
    witnessed = sum(min(max(stay, 0.0), 2 * listed) for stay in stays)
    return float((prior + witnessed) * np.log(2))


def holds(half_life: float, age: float) -> float:
    """Probability that a thing seen `age` seconds ago has not moved since."""
    return float(0.5 ** (max(age, 0.0) / half_life))
