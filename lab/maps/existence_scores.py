"""Scores at existence thresholds: recall, precision, duplicates, wrong labels, ghosts.

`lab.maps.truth_matching` has the rules. Scores of several maps are pooled by counting
the objects of all of them.
"""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from lab.maps.truth_matching import MappedObject, Matching, Pair, TruthMatcher

THRESHOLDS: Final = (0.0, 0.3, 0.5, 0.8)


@dataclass(frozen=True, slots=True)
class ExistenceScore:
    """Score of the objects at or above one existence threshold; shares are None of nothing."""

    threshold: float
    true: int  # objects that count
    mapped: int
    matched: int
    recall: float | None  # matched / true
    precision: float | None  # matched / (matched + duplicates + wrong + ghosts)
    clean: float | None  # precision without duplicates
    duplicates: int
    wrong: int
    ghosts: int
    ignored: int
    error: float | None  # [m] median distance of the matched
    detail: dict[str, list[Any]] = field(default_factory=dict)  # which they are, by kind


def matchings_by_existence(
    objects: Sequence[MappedObject], matcher: TruthMatcher
) -> tuple[Matching, ...]:
    """Matching of a map's objects at or above each of `THRESHOLDS`."""
    return tuple(
        matcher.match(o for o in objects if o.existence >= threshold) for threshold in THRESHOLDS
    )


def scores_by_existence(
    matchings: Sequence[Matching], matcher: TruthMatcher
) -> tuple[ExistenceScore, ...]:
    """Score of a map at each of `THRESHOLDS`, from its matchings."""
    return tuple(
        _score(threshold, [matching], matcher.counted, _detail(matching, matcher))
        for threshold, matching in zip(THRESHOLDS, matchings, strict=True)
    )


def pooled_scores(
    maps: Sequence[Sequence[Matching]], counted: Sequence[int]
) -> tuple[ExistenceScore, ...]:
    """Scores of several maps together: `matchings_by_existence` and true objects of each."""
    by_threshold = zip(THRESHOLDS, zip(*maps, strict=True), strict=True)
    return tuple(_score(t, matchings, sum(counted), {}) for t, matchings in by_threshold)


def _score(
    threshold: float, matchings: Sequence[Matching], true: int, detail: dict[str, list[Any]]
) -> ExistenceScore:
    distances = [pair.distance for matching in matchings for pair in matching.matched]
    n = len(distances)
    duplicates = sum(len(matching.duplicates) for matching in matchings)
    wrong = sum(len(matching.wrong) for matching in matchings)
    ghosts = sum(len(matching.ghosts) for matching in matchings)
    return ExistenceScore(
        threshold=threshold,
        true=true,
        mapped=sum(len(matching.mapped) for matching in matchings),
        matched=n,
        recall=_share(n, true),
        precision=_share(n, n + wrong + ghosts + duplicates),
        clean=_share(n, n + wrong + ghosts),
        duplicates=duplicates,
        wrong=wrong,
        ghosts=ghosts,
        ignored=sum(len(matching.ignored) for matching in matchings),
        error=round(statistics.median(distances), 3) if n else None,
        detail=detail,
    )


def _detail(matching: Matching, matcher: TruthMatcher) -> dict[str, list[Any]]:
    """Label, existence, position, nearest entry and distance of each object, by group."""
    mapped, truth = matching.mapped, matcher.truth

    def row(pair: Pair) -> list[Any]:
        o = mapped[pair.mapped]
        name = truth[pair.true].name if pair.true >= 0 else ""
        p_map = np.round(o.p_map, 2).tolist()
        return [o.label, round(o.existence, 2), p_map, name, round(pair.distance, 2)]

    return {
        "matched": [
            [mapped[p.mapped].label, truth[p.true].name, round(p.distance, 2)]
            for p in matching.matched
        ],
        "missed": [f"{truth[i].name} ({truth[i].label})" for i in matching.missed],
        "duplicates": [row(pair) for pair in matching.duplicates],
        "wrong": [row(pair) for pair in matching.wrong],
        "ghosts": [row(pair) for pair in matching.ghosts],
        "ignored": [row(pair) for pair in matching.ignored],
    }


def _share(part: int, whole: int) -> float | None:
    return round(part / whole, 3) if whole else None
