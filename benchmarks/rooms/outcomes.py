"""Outcomes: frames mapped by one mapper, matched to their truth; and their scores."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from statistics import fmean
from typing import Final

from benchmarks.rooms.recordings import detector_of
from kg.serving.opening import in_memory_map
from lab.maps.existence_curve import existence_curve
from lab.maps.existence_scores import THRESHOLDS, matchings_by_existence
from lab.maps.map_evaluation import MapEvaluation, mapped_objects, pooled
from lab.maps.relation_scores import RelationOutcomes
from lab.maps.session_identity import SHOWN
from lab.maps.truth_matching import MappedObject, TruthMatcher
from mapping.mapper import Mapper
from mapping.mapping_options import MappingOptions
from perception.frames import Frame
from perception.inference.recorded_detections import RecordedDetector

DEFAULT, REFERENCE = "default", "reference"
MAPPERS: Final = (DEFAULT, REFERENCE)
CLOSE: Final = 0.3  # [m] reach of a match for the strict scores
_ALONE: Final = MappingOptions(occupancy=False, pictures=False, check_poses=False)
_OPTIONS: Final = {
    DEFAULT: _ALONE,
    REFERENCE: replace(_ALONE, mode="reference", surface=None),
}
_MIN_SCORE: Final = {DEFAULT: _ALONE.min_score, REFERENCE: 0.25}

Row = tuple[str, str, str]  # room, network, stretch: what is scored together
Scores = dict[str, float | None]  # None of nothing


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """Frames mapped by one mapper."""

    row: Row
    mapper: str
    frames: int
    seconds: float  # [s] of processor time in the mapper
    evaluation: MapEvaluation
    close: MapEvaluation  # with matches up to `CLOSE` only
    unnamed: int  # things without a name in the map


def outcome(
    row: Row,
    mapper: str,
    frames: Sequence[Frame],
    seen: Sequence[RecordedDetector],
    matcher: TruthMatcher,
) -> Outcome:
    """Map frames by what networks saw in them, as maps of users are; the objects are matched."""
    detector, seconds = detector_of(seen, _MIN_SCORE[mapper]), 0.0
    with in_memory_map(base="https://example.org/map/") as semantic_map:
        mapping = Mapper(semantic_map, _OPTIONS[mapper], detector=detector.name)
        for frame in frames:
            detections = detector.detect(frame)
            begun = time.process_time()
            mapping.add(frame, detections)
            seconds += time.process_time() - begun
        mapping.flush()
        objects = mapped_objects(mapping.objects(), semantic_map.catalogue.label)
        unnamed = len(semantic_map.unnamed_things())
    close = TruthMatcher(matcher.truth, matcher.T_map_world, CLOSE)
    evaluations = evaluated(objects, matcher), evaluated(objects, close)
    return Outcome(row, mapper, len(frames), seconds, *evaluations, unnamed)


def evaluated(objects: Sequence[MappedObject], matcher: TruthMatcher) -> MapEvaluation:
    """Objects of a map matched to the truth."""
    matchings, curve = matchings_by_existence(objects, matcher), existence_curve(objects, matcher)
    return MapEvaluation(matcher, matchings, None, curve, RelationOutcomes())


def scores(outcomes: Sequence[Outcome]) -> Scores:
    """Scores of the objects of all outcomes together, at existence 0.5 where they need one.

    "right names" is the share of objects with a right name among those near something true.
    """
    found, close = (pooled([getattr(o, k) for o in outcomes]) for k in ("evaluation", "close"))
    shown, strict = (one.thresholds[THRESHOLDS.index(SHOWN)] for one in (found, close))
    named = shown.matched + shown.wrong
    return {
        "recall": shown.recall,
        "precision": shown.precision,
        "AP": found.average_precision,
        "recall, 0.3 m": strict.recall,
        "precision, 0.3 m": strict.precision,
        "AP, 0.3 m": close.average_precision,
        "right names": shown.matched / named if named else None,
        "doubles": shown.duplicates,
        "unnamed": sum(o.unnamed for o in outcomes),
        "best F1": found.best_f1,
        "error [m]": shown.error,
        "ECE": found.calibration.ece,
        "95 % ellipse": found.coverage.ellipse,
        "ms a frame": 1000 * sum(o.seconds for o in outcomes) / sum(o.frames for o in outcomes),
    }


def mean(several: Iterable[Scores]) -> Scores:
    """Mean of each score over those that have it."""
    by_name: dict[str, list[float]] = {}
    for one in several:
        for name, value in one.items():
            by_name.setdefault(name, []).extend([] if value is None else [value])
    return {name: fmean(values) if values else None for name, values in by_name.items()}
