"""Sightings of one frame: detections of all detectors, grouped by thing and localised."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kg.model.usual_sizes import UNUSUAL, SizeOf
from mapping.frames.projection import back_project, bounds, to_map
from mapping.frames.sighting import Box, Floats, Sighting, ThingSighting
from mapping.labels.label_resolver import LabelResolver
from mapping.objects.detections.detection_report import DetectionFates, Fate
from mapping.objects.settings import ObjectSettings
from mapping.reference.depth_histogram import box_depth
from perception.frames import Detections, Frame

_SAMPLES = 1000  # pixels of a box that are sampled
_MIN_DEPTH = 0.05  # share of a box with depth; lit screens and glass have less
_MIN_PIXELS = 10
_PERCENTILE = 35  # of the depths in a box
_THICKNESS = 0.25  # share of its longer side that a thing's surface lies before or behind its depth
_RING = 0.15  # width of the ring around such a box, as a share of its side


@dataclass(frozen=True, slots=True)
class _Detection:
    detector: str
    category: str
    score: float
    box: Box
    mask: NDArray[np.bool_] | None = None  # which pixels of the box show it


class SightingExtractor:
    """Turns detections into sightings; `unplaced` counts things without usable depth."""

    def __init__(self, labels: LabelResolver, usual_size: SizeOf, settings: ObjectSettings) -> None:
        self._labels, self._usual_size, self._settings = labels, usual_size, settings
        self.unplaced = 0
        self.fates = DetectionFates(labels.name)

    def sightings(self, frame: Frame, detections: Detections) -> list[ThingSighting]:
        """Sightings of one frame, strongest first."""
        known = list(self._known(detections))
        found: list[ThingSighting] = []
        for group in group_detections(known, self._settings):
            sighting = self._localised(frame, group)
            if sighting is None:
                self.unplaced += 1
            elif not any(self._same_thing(sighting, other) for other in found):
                found.append(sighting)
            else:
                self.fates.unused(Fate.DOUBLE, sighting.categories)
        return found

    def of_position(self, sighting: Sighting) -> ThingSighting:
        """Sighting by a robot that measures positions itself, of the category's usual size."""
        size = (self._usual_size(sighting.category) or UNUSUAL).longest
        return ThingSighting(
            scores={("", sighting.category): sighting.score},
            p_map=sighting.p_map,
            low=sighting.p_map - 0.02,
            high=sighting.p_map + 0.02,
            size=size,
            depth=sighting.depth,
            box=sighting.box,
            cut=False,
            categories=frozenset((sighting.category,)),
            point=True,
        )

    def _known(self, detections: Detections) -> Iterator[_Detection]:
        least = self._settings.min_score
        labelled = list(zip(detections.label, detections.score, detections.xyxy, strict=True))
        self._labels.learn(label for label, score, _ in labelled if score >= least)
        self.fates.unused(Fate.WEAK, [label for label, score, _ in labelled if score < least])
        sources = detections.source or ("",) * len(detections)
        masks = detections.mask or (None,) * len(detections)
        for (label, score, box), source, mask in zip(labelled, sources, masks, strict=True):
            category = self._labels.category(label) if score >= least else None
            if category is not None:
                x1, y1, x2, y2 = (float(side) for side in box)
                yield _Detection(source, category, float(score), (x1, y1, x2, y2), mask)
            elif score >= least:
                fate = Fate.IGNORED if self._labels.ignores(label) else Fate.UNKNOWN
                self.fates.unused(fate, (label,))

    def _localised(self, frame: Frame, group: Sequence[_Detection]) -> ThingSighting | None:
        s, box = self._settings, group[0].box
        surface = _visible_surface(frame, group)
        if surface is None or not s.min_depth <= surface.depth <= s.max_depth:
            reached = None if surface is None else surface.depth
            self.fates.unplaced(reached, s.min_depth, {one.category for one in group})
            return None
        depth = surface.depth
        p_map = to_map(frame.T_map_cam, surface.centre)
        points = to_map(frame.T_map_cam, surface.points)
        low, high = bounds(points, 0.05)
        x1, y1, x2, y2 = box
        height, width = frame.depth.shape
        scores: dict[tuple[str, str], float] = {}
        for one in group:
            key = (one.detector, one.category)
            scores[key] = max(scores.get(key, 0.0), one.score)
        return ThingSighting(
            scores=scores,
            p_map=p_map,
            low=np.minimum(low, p_map - 0.02),
            high=np.maximum(high, p_map + 0.02),
            size=depth * max((x2 - x1) / frame.K[0, 0], (y2 - y1) / frame.K[1, 1]),
            depth=depth,
            box=box,
            cut=min(x1, y1) < s.border or x2 > width - s.border or y2 > height - s.border,
            categories=frozenset(one.category for one in group),
        )

    def _same_thing(self, a: ThingSighting, b: ThingSighting) -> bool:
        """Whether two sightings share a category and stand too close to be two things of it."""
        shared = a.categories & b.categories
        if not shared:
            return False
        width = max((self._usual_size(category) or UNUSUAL).width for category in shared)
        distance = float(np.linalg.norm(a.p_map - b.p_map))
        return distance < self._settings.separation * width


def group_detections(
    detections: Sequence[_Detection], settings: ObjectSettings
) -> list[list[_Detection]]:
    """Groups of detections that show one thing, each with its strongest detection first."""
    groups: list[list[_Detection]] = []
    for one in sorted(detections, key=lambda d: -d.score):
        best, chosen = 0.0, None
        for group in groups:
            overlap = intersection_over_union(group[0].box, one.box)
            if overlap > max(best, _min_overlap(group, one, settings)):
                best, chosen = overlap, group
        if chosen is None:
            groups.append([one])
        else:
            chosen.append(one)
    return groups


def _min_overlap(group: Sequence[_Detection], one: _Detection, settings: ObjectSettings) -> float:
    """IoU above which `one` shows the thing of `group`."""
    same = [other for other in group if other.category == one.category]
    if any(other.detector == one.detector for other in same):
        return 0.75  # the detector itself suppressed duplicates
    return settings.same_label_overlap if same else settings.other_label_overlap


def intersection_over_union(a: Box, b: Box) -> float:
    """IoU of two boxes."""
    width = max(0.0, min(a[2], b[2]) - max(a[0], b[0]))
    height = max(0.0, min(a[3], b[3]) - max(a[1], b[1]))
    shared = width * height
    areas = (a[2] - a[0]) * (a[3] - a[1]) + (b[2] - b[0]) * (b[3] - b[1])
    return shared / (areas - shared + 1e-9)


@dataclass(frozen=True, slots=True)
class _Surface:
    """Visible surface of a thing, in the camera frame."""

    depth: float  # [m] along the optical axis
    centre: Floats  # (3,) [m] on the ray through the middle of its box
    points: Floats  # (n, 3) [m]


def _visible_surface(frame: Frame, group: Sequence[_Detection]) -> _Surface | None:
    """Surface of the thing that a group shows, by its strongest box or mask; None without depth.

    Its depth is a low percentile of the depths in the box, since a box shows more of the background
    than of the foreground. For a box with hardly any depth (a lit screen, glass) it is the depth of
    the ring around the box.
    """
    best = next((one for one in group if one.mask is not None), group[0])
    found = box_depth(frame, np.array(best.box), best.mask)
    if found is None:
        return None
    patch, (top, bottom, left, right), counted = found
    step = max(1, int(np.sqrt(counted / _SAMPLES)))
    rows, columns = np.nonzero(patch[::step, ::step] > 0)  # nan compares false
    if len(rows) * step**2 < max(_MIN_DEPTH * counted, _MIN_PIXELS):
        depth = _ring_depth(frame, (top, bottom, left, right))
        if depth is None:
            return None
        centre = _ray(frame, best.box, depth)
        return _Surface(depth, centre, centre[None])
    depths = patch[::step, ::step][rows, columns].astype(np.float64)
    depth = _percentile(depths, _PERCENTILE if best.mask is None else 50)
    side = depth * max((right - left) / frame.K[0, 0], (bottom - top) / frame.K[1, 1])
    kept = np.abs(depths - depth) < min(max(_THICKNESS * side, 0.1), 1.0)
    rows, columns = rows[kept] * step + top, columns[kept] * step + left
    points = back_project(rows, columns, depths[kept], frame.K)
    return _Surface(depth, _ray(frame, best.box, depth), points)


def _ray(frame: Frame, box: Box, depth: float) -> Floats:
    """Point (3,) [m] in the camera frame at `depth` [m] behind the middle of a box."""
    K, x, y = frame.K, (box[0] + box[2]) / 2, (box[1] + box[3]) / 2
    return depth * np.array([(x - K[0, 2]) / K[0, 0], (y - K[1, 2]) / K[1, 1], 1.0])


def _ring_depth(frame: Frame, clipped: tuple[int, int, int, int]) -> float | None:
    top, bottom, left, right = clipped
    high, wide = int((bottom - top) * _RING) + 4, int((right - left) * _RING) + 4
    outer_top, outer_left = max(top - high, 0), max(left - wide, 0)
    ring = frame.depth[outer_top : bottom + high, outer_left : right + wide]
    depths = ring[ring > 0]
    return None if len(depths) < 10 else _percentile(depths, _PERCENTILE)


def _percentile(values: NDArray[np.floating], percent: int) -> float:
    """Percentile of `values` (n,), as one of them."""
    rank = (len(values) - 1) * percent // 100
    return float(np.partition(values, rank)[rank])
