"""Class scores: a map's objects matched to hand-made truth, class by class."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapping.frames.projection import to_map
from mapping.reference.settings import ReferenceSettings

Points = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Truth:
    """Ground truth of a recording: parallel labels and positions."""

    names: tuple[str, ...]  # (n,)
    labels: tuple[str, ...]  # (n,) object categories
    p_world: Points  # (n, 3) [m] in the recording's own world
    complete_for: tuple[str, ...]  # labels whose every instance is listed


@dataclass(frozen=True, slots=True)
class ClassScore:
    """Score of one class: true, mapped, matched and duplicate objects, position error."""

    truth: int
    mapped: int
    matched: int
    duplicates: int
    position_error_median: float | None  # [m] over the matched


@dataclass(frozen=True, slots=True)
class MapScore:
    """Score of a map. Shares are None of nothing."""

    precision: float | None  # matched / mapped, over the classes whose truth is complete
    recall: float | None  # matched / true, over all true objects
    position_error_median: float | None  # [m] over the matched
    duplicates: int  # unmatched objects as near a matched true one as a match may be
    per_class: Mapping[str, ClassScore]  # every class with a true or a mapped object
    complete_for: tuple[str, ...] = ()  # classes that precision counts

    def to_json(self) -> dict[str, Any]:
        """Plain values, for `--json`."""
        values = asdict(self)
        del values["complete_for"]
        return values


def match(mapped: Points, true: Points, limit: float) -> list[tuple[int, int, float]]:
    """One-to-one pairs (mapped, true, distance [m]) up to `limit`, nearest first.

    `mapped` (m, 3) and `true` (n, 3) [m] are of one class. Greedy: the nearest pair left is taken,
    which can match one pair fewer than the best assignment, never one more.
    """
    distances = np.linalg.norm(mapped[:, None, :] - true[None, :, :], axis=2)
    pairs: list[tuple[int, int, float]] = []
    for flat in np.argsort(distances, axis=None, kind="stable"):
        m, t = divmod(int(flat), len(true))
        if distances[m, t] > limit:
            break
        if all(m != pair[0] and t != pair[1] for pair in pairs):
            pairs.append((m, t, float(distances[m, t])))
    return pairs


def score_map(objects: Sequence[tuple[str, Points]], truth: Truth, T_map_world: Points) -> MapScore:
    """Score (category label, p_map (3,) [m]) of a map's objects against `truth`.

    Same class, one to one, within `match_distance` (large things `match_distance_large`).
    """
    s = ReferenceSettings()
    p_truth = to_map(T_map_world, truth.p_world)
    errors: list[float] = []
    per_class: dict[str, ClassScore] = {}
    for label in sorted({label for label, _ in objects} | set(truth.labels)):
        limit = s.match_distance_large if label in s.large_labels else s.match_distance
        mapped = np.array([p for name, p in objects if name == label]).reshape(-1, 3)
        true = p_truth[[name == label for name in truth.labels]]
        pairs = match(mapped, true, limit)
        errors += [distance for _, _, distance in pairs]
        per_class[label] = ClassScore(
            truth=len(true),
            mapped=len(mapped),
            matched=len(pairs),
            duplicates=_duplicates(mapped, true, pairs, limit),
            position_error_median=_median([distance for _, _, distance in pairs]),
        )
    complete = [per_class[label] for label in truth.complete_for if label in per_class]
    return MapScore(
        precision=_share(sum(c.matched for c in complete), sum(c.mapped for c in complete)),
        recall=_share(len(errors), len(truth.labels)),
        position_error_median=_median(errors),
        duplicates=sum(c.duplicates for c in per_class.values()),
        per_class=per_class,
        complete_for=truth.complete_for,
    )


def _duplicates(
    mapped: Points, true: Points, pairs: Sequence[tuple[int, int, float]], limit: float
) -> int:
    matched = {m for m, _, _ in pairs}
    found = true[[t for _, t, _ in pairs]]
    return sum(
        bool(np.any(np.linalg.norm(found - mapped[m], axis=1) <= limit))
        for m in range(len(mapped))
        if m not in matched
    )


def _share(part: int, whole: int) -> float | None:
    return part / whole if whole else None


def _median(values: Sequence[float]) -> float | None:
    return statistics.median(values) if values else None
