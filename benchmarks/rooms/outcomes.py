"""Outcomes: a stretch mapped by one mapper, matched to its truth; and their scores."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields
from statistics import fmean
from typing import Final

from benchmarks.rooms.looks import detector
from kg.maps.semantic_map import SemanticMap
from kg.opening import in_memory_map
from mapping.evaluation.average_precision import ExistenceCurve, existence_curve, pooled_curve
from mapping.evaluation.existence_calibration import calibration
from mapping.evaluation.existence_scores import THRESHOLDS, matchings_by_existence, pooled_scores
from mapping.evaluation.map_evaluation import mapped_objects
from mapping.evaluation.position_coverage import coverage
from mapping.evaluation.truth_matching import Matching, TruthMatcher
from mapping.objects.bayes_mapper import BayesObjectMapper
from mapping.objects.object_mapper import ObjectMapper
from mapping.objects.settings import ObjectSettings
from mapping.reference.settings import ReferenceSettings
from perception.frames import Frame
from perception.inference.recorded_detections import RecordedDetector

HALF: Final = 0.5  # least existence of what counts as found


def _bayes(semantic_map: SemanticMap, model: str) -> BayesObjectMapper:
    return BayesObjectMapper(semantic_map, model=model)


def _reference(semantic_map: SemanticMap, model: str) -> ObjectMapper:
    return ObjectMapper(semantic_map, ReferenceSettings(), model=model)


Making = Callable[[SemanticMap, str], BayesObjectMapper | ObjectMapper]

#: Mapper -> least score of what it is given, and how it is made.
MAPPERS: Final[dict[str, tuple[float, Making]]] = {
    "default": (ObjectSettings().min_score, _bayes),
    "reference": (0.25, _reference),
}


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """A stretch mapped by one mapper."""

    room: str
    network: str
    stretch: str
    mapper: str
    frames: int
    seconds: float  # [s] of processor time in the mapper
    matcher: TruthMatcher
    matchings: tuple[Matching, ...]  # at each of THRESHOLDS
    curve: ExistenceCurve

    @property
    def row(self) -> tuple[str, str, str]:
        """What is scored together: room, network and stretch."""
        return self.room, self.network, self.stretch


@dataclass(frozen=True, slots=True)
class Score:
    """Scores of one or several outcomes; None of nothing."""

    recall: float | None  # of objects at existence 0.5 and above
    precision: float | None
    ap: float | None
    f1: float | None  # at the best existence
    error: float | None  # [m] median position error of the matched
    ece: float | None
    ellipse: float | None  # share of 95 % ellipses that hold the true position
    ms: float | None  # [ms] of processor time a frame


def mapped(
    row: tuple[str, str, str],
    mapper: str,
    frames: Sequence[Frame],
    seen: Sequence[RecordedDetector],
    matcher: TruthMatcher,
) -> Outcome:
    """Map frames by what networks saw in them; the map's objects are matched, and not written."""
    threshold, make = MAPPERS[mapper]
    looking, seconds = detector(seen, threshold), 0.0
    with in_memory_map(base="https://example.org/map/") as semantic_map:
        mapping = make(semantic_map, looking.name)
        for frame in frames:
            detections = looking.detect(frame)
            begun = time.process_time()
            mapping.add(frame, detections)
            seconds += time.process_time() - begun
        objects = mapped_objects(mapping.objects(), semantic_map.catalogue.label)
    matchings, curve = matchings_by_existence(objects, matcher), existence_curve(objects, matcher)
    return Outcome(*row, mapper, len(frames), seconds, matcher, matchings, curve)


def score(outcomes: Sequence[Outcome]) -> Score:
    """Score of the objects of all outcomes together."""
    found = pooled_scores([o.matchings for o in outcomes], [o.matcher.counted for o in outcomes])
    half = found[THRESHOLDS.index(HALF)]
    curve = pooled_curve([o.curve for o in outcomes])
    frames = sum(o.frames for o in outcomes)
    return Score(
        recall=half.recall,
        precision=half.precision,
        ap=curve.average_precision,
        f1=curve.best_f1,
        error=half.error,
        ece=calibration(o.matchings[0] for o in outcomes).ece,
        ellipse=coverage((o.matchings[0], o.matcher) for o in outcomes).ellipse,
        ms=1000 * sum(o.seconds for o in outcomes) / frames if frames else None,
    )


def mean(scores: Iterable[Score]) -> Score:
    """Mean of each score over the stretches that have it."""
    every, means = list(scores), dict[str, float | None]()
    for name in (field.name for field in fields(Score)):
        values = [value for one in every if (value := getattr(one, name)) is not None]
        means[name] = fmean(values) if values else None
    return Score(**means)
