"""Likeness: how alike two things look, by features of their pictures."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import numpy as np

from mapping.looks.look_store import Floats


def features_of(rows: Floats) -> Floats:
    """Features (n, F) in rows (n, F + C) of the bundled network."""
    return rows[:, : len(feature_statistics()[0])]


def log_p_of(rows: Floats) -> Floats:
    """Log-probabilities (n, C) of ImageNet's classes in the same rows."""
    return rows[:, len(feature_statistics()[0]) :]


def likeness(a: Floats, b: Floats) -> float:
    """How alike two things are, -1..1, from features (n, F) and (m, F) of their views.

    Features are in deviations from the mean of things in general. Each view counts by the cosine
    to the other thing's most similar view.
    """
    cosines = _directions(a) @ _directions(b).T
    return float(cosines.max(axis=0).mean() + cosines.max(axis=1).mean()) / 2


def most_alike(thing: Floats, others: Iterable[Floats]) -> float | None:
    """Likeness of a thing, features (n, F), to the most similar of `others`; None without any."""
    return max((likeness(other, thing) for other in others), default=None)


@cache
def feature_statistics() -> tuple[Floats, Floats]:
    """(F,) mean and deviation of each feature over boxes of many things in photographs."""
    with Path(__file__).with_name("look_statistics.csv").open(encoding="utf-8") as file:
        rows = [(float(row["mean"]), float(row["deviation"])) for row in csv.DictReader(file)]
    mean, deviation = np.array(rows, np.float32).T
    return mean, deviation


def _directions(features: Floats) -> Floats:
    """Features (n, F) as unit vectors, from the mean of things in general."""
    mean, deviation = feature_statistics()
    scaled: Floats = (features - mean) / deviation
    found: Floats = scaled / np.maximum(np.linalg.norm(scaled, axis=1, keepdims=True), 1e-9)
    return found
