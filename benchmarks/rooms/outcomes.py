"""Outcomes: frames mapped by one mapper, matched to their truth; and their scores."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Final

from benchmarks.rooms.recordings import detector_of
from kg.maps.semantic_map import SemanticMap
from kg.serving.opening import in_memory_map
from lab.maps.existence_curve import existence_curve
from lab.maps.existence_scores import THRESHOLDS, matchings_by_existence
from lab.maps.map_evaluation import MapEvaluation, mapped_objects, pooled
from lab.maps.relation_scores import RelationOutcomes
from lab.maps.session_identity import SHOWN
from lab.maps.truth_matching import TruthMatcher
from mapping.objects.bayes_mapper import BayesObjectMapper
from mapping.objects.object_mapper import ReferenceObjectMapper
from mapping.objects.settings import ObjectSettings
from mapping.reference.settings import ReferenceSettings
from perception.frames import Frame
from perception.inference.recorded_detections import RecordedDetector

DEFAULT, REFERENCE = "default", "reference"
MAPPERS: Final = (DEFAULT, REFERENCE)
_MIN_SCORE: Final = {DEFAULT: ObjectSettings().min_score, REFERENCE: 0.25}
_MAKE: Final[dict[str, Callable[[SemanticMap, str], BayesObjectMapper | ReferenceObjectMapper]]] = {
    DEFAULT: lambda semantic_map, model: BayesObjectMapper(semantic_map, model=model),
    REFERENCE: lambda semantic_map, model: ReferenceObjectMapper(
        semantic_map, ReferenceSettings(), model=model
    ),
}

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


def outcome(
    row: Row,
    mapper: str,
    frames: Sequence[Frame],
    seen: Sequence[RecordedDetector],
    matcher: TruthMatcher,
) -> Outcome:
    """Map frames by what networks saw in them; the map's objects are matched, and not written."""
    detector, seconds = detector_of(seen, _MIN_SCORE[mapper]), 0.0
    with in_memory_map(base="https://example.org/map/") as semantic_map:
        mapping = _MAKE[mapper](semantic_map, detector.name)
        for frame in frames:
            detections = detector.detect(frame)
            begun = time.process_time()
            mapping.add(frame, detections)
            seconds += time.process_time() - begun
        objects = mapped_objects(mapping.objects(), semantic_map.catalogue.label)
    matchings, curve = matchings_by_existence(objects, matcher), existence_curve(objects, matcher)
    evaluation = MapEvaluation(matcher, matchings, None, curve, RelationOutcomes())
    return Outcome(row, mapper, len(frames), seconds, evaluation)


def scores(outcomes: Sequence[Outcome]) -> Scores:
    """Scores of the objects of all outcomes together; recall, precision, error at existence 0.5."""
    found = pooled([o.evaluation for o in outcomes])
    shown = found.thresholds[THRESHOLDS.index(SHOWN)]
    return {
        "recall": shown.recall,
        "precision": shown.precision,
        "AP": found.average_precision,
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
