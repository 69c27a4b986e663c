"""Average precision of a map: recall and precision as the least existence falls.

At each existence that an object has, the objects at or above it are matched to the truth. Average
precision is the area under the envelope of precision over recall: at each recall the best precision
that it, or a higher one, comes with. Curves of several maps are pooled by counting the objects of
all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from lab.maps.truth_matching import MappedObject, TruthMatcher

_DIGITS: Final = 4  # precision of existences


@dataclass(frozen=True, slots=True)
class CurvePoint:
    """The objects at or above one existence."""

    existence: float
    matched: int
    false: int  # duplicates, wrong labels and ghosts


@dataclass(frozen=True, slots=True)
class ExistenceCurve:
    """Right and false objects of a map, or of several, as the least existence falls."""

    true: int  # objects that count
    points: tuple[CurvePoint, ...]  # highest existence first

    def recall(self, point: CurvePoint) -> float:
        """Share of the true objects that are matched."""
        return point.matched / self.true

    @property
    def average_precision(self) -> float | None:
        """Area under the envelope of precision over recall; None where nothing is true."""
        if not self.true:
            return None
        area = reached = best = 0.0
        envelope = list[float]()
        for point in reversed(self.points):
            best = max(best, point.matched / max(point.matched + point.false, 1))
            envelope.append(best)
        for point, precision in zip(self.points, reversed(envelope), strict=True):
            area += max(self.recall(point) - reached, 0.0) * precision
            reached = max(reached, self.recall(point))
        return area

    @property
    def best_f1(self) -> float | None:
        """Highest harmonic mean of recall and precision; None where nothing is true."""
        if not self.true:
            return None
        return max(
            (2 * p.matched / (self.true + p.matched + p.false) for p in self.points), default=0.0
        )


def existence_curve(objects: Sequence[MappedObject], matcher: TruthMatcher) -> ExistenceCurve:
    """Curve of one map."""
    existence = [round(o.existence, _DIGITS) for o in objects]
    points = list[CurvePoint]()
    for least in sorted(set(existence), reverse=True):
        found = matcher.match(o for o, e in zip(objects, existence, strict=True) if e >= least)
        false = len(found.duplicates) + len(found.wrong) + len(found.ghosts)
        points.append(CurvePoint(least, len(found.matched), false))
    return ExistenceCurve(matcher.counted, tuple(points))


def pooled_curve(curves: Sequence[ExistenceCurve]) -> ExistenceCurve:
    """Curve of several maps together."""
    levels = sorted({p.existence for curve in curves for p in curve.points}, reverse=True)
    points = list[CurvePoint]()
    for least in levels:
        at = [_at(curve, least) for curve in curves]
        points.append(CurvePoint(least, sum(p.matched for p in at), sum(p.false for p in at)))
    return ExistenceCurve(sum(curve.true for curve in curves), tuple(points))


def _at(curve: ExistenceCurve, least: float) -> CurvePoint:
    """The objects of `curve` at existence `least` and above."""
    above = [point for point in curve.points if point.existence >= least]
    return above[-1] if above else CurvePoint(least, 0, 0)
