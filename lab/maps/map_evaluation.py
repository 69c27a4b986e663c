"""Evaluation of a map against a complete truth: all scores of one map, or of several together."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import HistoryError
from kg.model.records import ObjectRecord
from lab.maps.existence_curve import ExistenceCurve, existence_curve, pooled_curve
from lab.maps.existence_scores import (
    THRESHOLDS,
    ExistenceScore,
    matchings_by_existence,
    pooled_scores,
    scores_by_existence,
)
from lab.maps.relation_scores import (
    RelationOutcomes,
    RelationScore,
    relation_outcomes,
)
from lab.maps.session_identity import SHOWN, identity_switches, object_states
from lab.maps.truth_matching import MappedObject, Matching, TruthMatcher
from lab.networks.calibration import Calibration, reliability

CHI2_95: Final = {2: 5.991, 3: 7.815}  # 95 % quantiles by degrees of freedom
_ROUNDING: Final = 0.003  # [m] standard deviation of positions stored to the centimetre


@dataclass(frozen=True, slots=True)
class Coverage:
    """Share of matched objects whose 95 % region holds the true position; None of nothing."""

    objects: int  # matched, with a covariance
    ellipse: float | None  # over the floor: x and y
    ellipsoid: float | None  # x, y and z


@dataclass(frozen=True, slots=True)
class MapScores:
    """Scores of a map, or of several together."""

    thresholds: tuple[ExistenceScore, ...]
    switches: int | None  # identity switches; None: the past is not kept
    calibration: Calibration
    coverage: Coverage
    average_precision: float | None  # over existence; None where nothing is true
    best_f1: float | None  # at the best existence
    relations: tuple[RelationScore, ...] = ()  # empty: the truth knows none

    def to_json(self) -> dict[str, Any]:
        """Plain values, for `--json`."""
        return asdict(self)


@dataclass(frozen=True, slots=True, eq=False)
class MapEvaluation:
    """A map matched to its truth."""

    matcher: TruthMatcher
    matchings: tuple[Matching, ...]  # at each of THRESHOLDS
    switches: int | None
    curve: ExistenceCurve
    relations: RelationOutcomes

    @property
    def shown(self) -> Matching:
        """Matching of the objects at existence 0.5 and above."""
        return self.matchings[THRESHOLDS.index(SHOWN)]

    def scores(self) -> MapScores:
        """Scores of this map."""
        everything = self.matchings[0]
        return MapScores(
            thresholds=scores_by_existence(self.matchings, self.matcher),
            switches=self.switches,
            calibration=calibration([everything]),
            coverage=coverage([(everything, self.matcher)]),
            average_precision=self.curve.average_precision,
            best_f1=self.curve.best_f1,
            relations=self.relations.scores(),
        )


def evaluate_map(semantic_map: SemanticMap, matcher: TruthMatcher, since: int = 0) -> MapEvaluation:
    """Match the objects of a map, now and after each transaction behind number `since`."""
    label = semantic_map.catalogue.label
    records = semantic_map.objects()
    objects = mapped_objects(records, label)
    try:
        states = (mapped_objects(state, label) for state in object_states(semantic_map, since))
        switches = identity_switches(states, matcher)
    except HistoryError:
        switches = None
    matchings = matchings_by_existence(objects, matcher)
    shown = matchings[THRESHOLDS.index(SHOWN)]
    matched = {
        shown.mapped[pair.mapped].iri: pair.true
        for pair in (*shown.matched, *shown.ignored)
        if matcher.matches(shown.mapped[pair.mapped], pair.true)
    }
    relations = relation_outcomes(records, matched, matcher)
    curve = existence_curve(objects, matcher)
    return MapEvaluation(matcher, matchings, switches, curve, relations)


def pooled(evaluations: Sequence[MapEvaluation]) -> MapScores:
    """Scores over the objects of several maps together."""
    switches = [e.switches for e in evaluations if e.switches is not None]
    curve = pooled_curve([e.curve for e in evaluations])
    relations = RelationOutcomes()
    for evaluation in evaluations:
        relations.add(evaluation.relations)
    return MapScores(
        thresholds=pooled_scores(
            [e.matchings for e in evaluations], [e.matcher.counted for e in evaluations]
        ),
        switches=sum(switches) if len(switches) == len(evaluations) else None,
        calibration=calibration(e.matchings[0] for e in evaluations),
        coverage=coverage((e.matchings[0], e.matcher) for e in evaluations),
        average_precision=curve.average_precision,
        best_f1=curve.best_f1,
        relations=relations.scores(),
    )


def mapped_objects(
    records: Iterable[ObjectRecord], label: Callable[[str], str]
) -> tuple[MappedObject, ...]:
    """Objects under evaluation from their records; `label` gives that of a category's IRI."""
    return tuple(
        MappedObject(
            label=label(record.category),
            p_map=record.p_map,
            existence=record.existence,
            iri=record.iri,
            covariance=getattr(record, "covariance", None),
        )
        for record in records
    )


def calibration(matchings: Iterable[Matching]) -> Calibration:
    """Calibration of existence over all objects of one or several maps, matched at existence 0.

    An object is true if it is matched; duplicates, wrong labels and ghosts are false; ignored ones
    are left out.
    """
    outcomes = list[tuple[float, bool]]()
    for matching in matchings:
        false = (*matching.duplicates, *matching.wrong, *matching.ghosts)
        for pairs, is_true in ((matching.matched, True), (false, False)):
            outcomes += [(matching.mapped[pair.mapped].existence, is_true) for pair in pairs]
    return reliability(outcomes)


def coverage(maps: Iterable[tuple[Matching, TruthMatcher]]) -> Coverage:
    """Coverage over the matched objects of one or several maps."""
    errors = [
        (o.p_map - matcher.p_map[pair.true], o.covariance)
        for matching, matcher in maps
        for pair in matching.matched
        if (o := matching.mapped[pair.mapped]).covariance is not None
    ]
    return Coverage(
        objects=len(errors),
        ellipse=_share([_inside(e, c, 2) for e, c in errors if c is not None]),
        ellipsoid=_share([_inside(e, c, 3) for e, c in errors if c is not None]),
    )


def _inside(error: NDArray[np.float64], covariance: NDArray[np.float64], axes: int) -> bool:
    """Whether `error` (3,) [m] lies in the 95 % region of the first `axes` axes."""
    spread = covariance[:axes, :axes] + _ROUNDING**2 * np.eye(axes)
    squared = error[:axes] @ np.linalg.solve(spread, error[:axes])
    return bool(squared <= CHI2_95[axes])


def _share(inside: list[bool]) -> float | None:
    return sum(inside) / len(inside) if inside else None
