"""Sightings of one frame: detections of all detectors, grouped by thing and localised."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping.label_resolver import LabelResolver
from mapping.objects.settings import ObjectSettings
from mapping.objects.usual_sizes import UNUSUAL, SizeOf
from mapping.projection import back_project, to_map
from mapping.reference.depth_histogram import box_depth, fullest_bin
from mapping.sighting import Sighting
from perception.frames import Detections, Frame

Floats = NDArray[np.float64]
Box = tuple[float, float, float, float]  # xyxy [px]

_SAMPLES = 4000  # pixels of a box that are looked at
_LEAST_DEPTH = 0.25  # share of a box with depth; lit screens and glass have less
_RING = 0.15  # width of the ring around such a box, as a share of its side


@dataclass(frozen=True, slots=True)
class ThingSighting:
    """One thing in one frame: its detections, position and extent."""

    scores: Mapping[tuple[str, str], float]  # (detector, category IRI) -> best score
    p_map: Floats  # (3,) [m] mean of the visible surface
    low: Floats  # (3,) [m] corners of the visible points' box, in the map's axes
    high: Floats
    size: float  # [m] longer side of the box at its depth
    depth: float | None  # [m] along the optical axis; None: not from a depth image
    box: Box | None  # of the strongest detection
    cut: bool  # whether the image's border cuts the box
    categories: frozenset[str] = frozenset()  # IRIs of its detections' categories
    point: bool = False  # whether nothing but its position was measured; `size` is the usual one


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
        sources = detections.source or ("",) * len(detections)
        masks = detections.mask or (None,) * len(detections)
        for (label, score, box), source, mask in zip(labelled, sources, masks, strict=True):
            category = self._labels.category(label) if score >= least else None
            if category is not None:
                x1, y1, x2, y2 = (float(side) for side in box)
                yield _Detection(source, category, float(score), (x1, y1, x2, y2), mask)

    def _localised(self, frame: Frame, group: Sequence[_Detection]) -> ThingSighting | None:
        s, box = self._settings, group[0].box
        p_cam = _visible_points(frame, group)
        if p_cam is None:
            return None
        centre = p_cam.mean(axis=0)
        depth = float(centre[2])
        if not s.min_depth <= depth <= s.max_depth:
            return None
        p_map = to_map(frame.T_map_cam, centre)
        points = to_map(frame.T_map_cam, p_cam[:: max(len(p_cam) // 400, 1)])
        low, high = np.percentile(points, [5, 95], axis=0)
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
            if overlap > max(best, _least_overlap(group, one, settings)):
                best, chosen = overlap, group
        if chosen is None:
            groups.append([one])
        else:
            chosen.append(one)
    return groups


def _least_overlap(group: Sequence[_Detection], one: _Detection, settings: ObjectSettings) -> float:
    """IoU above which `one` shows the thing of `group`."""
    same = [other for other in group if other.category == one.category]
    if any(other.detector == one.detector for other in same):
        return 0.75  # the detector itself took them for two
    return settings.same_label_overlap if same else settings.other_label_overlap


def intersection_over_union(a: Box, b: Box) -> float:
    """IoU of two boxes."""
    width = max(0.0, min(a[2], b[2]) - max(a[0], b[0]))
    height = max(0.0, min(a[3], b[3]) - max(a[1], b[1]))
    shared = width * height
    areas = (a[2] - a[0]) * (a[3] - a[1]) + (b[2] - b[0]) * (b[3] - b[1])
    return shared / (areas - shared + 1e-9)


def _visible_points(frame: Frame, group: Sequence[_Detection]) -> Floats | None:
    """Points (n, 3) [m] of the thing that a group shows, in the camera frame; None without depth.

    Where a detection has a mask, all points in the strongest one's but outliers; else those of the
    fullest bin of the depth histogram of the strongest box. Of a box that has hardly any depth (a
    lit screen, glass) one point at the median depth of the ring around it.
    """
    best = next((one for one in group if one.mask is not None), group[0])
    found = box_depth(frame, np.array(best.box), best.mask)
    if found is None:
        return None
    patch, pixels, counted = found
    step = max(1, int(np.sqrt(counted / _SAMPLES)))
    rows, columns = np.nonzero(patch[::step, ::step] > 0)  # nan compares false
    rows, columns = rows * step, columns * step
    if len(rows) < max(_LEAST_DEPTH * counted / step**2, 1):
        return _ring_point(frame, pixels)
    depths = patch[rows, columns].astype(np.float64)
    kept = fullest_bin(depths, "fd", 1000) if best.mask is None else _inliers(depths)
    return back_project(rows[kept] + pixels[0], columns[kept] + pixels[2], depths[kept], frame.K)


def _inliers(depths: Floats) -> NDArray[np.bool_]:
    """Mask (n,) of depths that lie no farther outside the quartiles than these from one another.

    A mask's edge shows some of the background, which lies farther.
    """
    low, high = np.percentile(depths, [25, 75])
    reach = max(high - low, 0.02)
    inside: NDArray[np.bool_] = (depths >= low - reach) & (depths <= high + reach)
    return inside


def _ring_point(frame: Frame, clipped: tuple[int, int, int, int]) -> Floats | None:
    top, bottom, left, right = clipped
    high, wide = int((bottom - top) * _RING) + 4, int((right - left) * _RING) + 4
    outer_top, outer_left = max(top - high, 0), max(left - wide, 0)
    ring = frame.depth[outer_top : bottom + high, outer_left : right + wide].copy()
    ring[top - outer_top : bottom - outer_top, left - outer_left : right - outer_left] = np.nan
    depths = ring[ring > 0]
    if len(depths) < 10:
        return None
    row, column = np.array([(top + bottom) // 2]), np.array([(left + right) // 2])
    return back_project(row, column, np.array([float(np.median(depths))]), frame.K)
