"""Persistence of objects: half-lives of classes, from a table and from what this map has seen."""

from __future__ import annotations

import csv
from collections.abc import Collection, Iterable
from functools import cache
from pathlib import Path

import numpy as np

from planner.settings import HALF_LIVES, UNLISTED


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
    """Chance that what was seen `age` seconds ago has not moved since."""
    return float(0.5 ** (max(age, 0.0) / half_life))
