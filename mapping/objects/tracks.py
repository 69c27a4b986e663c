"""Tracks: the Bayes mapper's evidence for one thing, from its first candidate detection on."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import median
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kg.maps.facts.observations import STEP
from kg.model.areas import OrientedBox, upright_bounds
from kg.model.records import DepartedRecord, Evidence, ObjectRecord
from kg.model.usual_sizes import UNUSUAL, SizeOf, UsualSize
from mapping.frames.sighting import ThingSighting
from mapping.objects.absence import KNOWN, Absence
from mapping.objects.existence import (
    MISSED_NAME,
    SIZE,
    CategoryEvidence,
    beyond,
    category_probabilities,
    size_log_likelihood,
    strength,
)
from mapping.objects.extents.box_fit import MAX_VIEWS, Row, pose_of
from mapping.objects.settings import ObjectSettings

Floats = NDArray[np.float64]
_VIEWPOINTS = 100  # remembered of each track
_STEP = 0.05  # [m] of the latest sightings' sides, which change with each
_SAME_LABEL = 0.04  # change of an alternative's probability up to which it is not written again


class _Numbers:
    """Numbers of tracks, each given once."""

    def __init__(self) -> None:
        self._last = 0

    def next(self) -> int:
        """The next number, from 1."""
        self._last += 1
        return self._last

    def reserve(self, given: Iterable[int]) -> None:
        """Reserve the numbers of other runs."""
        self._last = max([self._last, *given])


numbers: Final = _Numbers()

#: cell of the camera's position and direction; looks from one cell are correlated
Viewpoint = tuple[int, ...]
CELL = 0.3  # [m]
_TURN = math.radians(15)


def viewpoint(T_map_cam: Floats) -> Viewpoint:
    """Viewpoint of a camera by its pose (4, 4)."""
    x, y, z = T_map_cam[:3, 2]
    turned = math.atan2(y, x) / _TURN, math.asin(min(max(z, -1.0), 1.0)) / _TURN
    cell = np.floor(T_map_cam[:3, 3] / CELL).astype(int).tolist()
    return (*cell, math.floor(turned[0]), math.floor(turned[1]))


@dataclass(eq=False, slots=True)
class Track:
    """One thing: evidence for its categories, position, extent, and from where it was seen.

    Tentative until it has an IRI; it is then an object of the map.
    """

    p_map: Floats  # (3,) [m]
    size: float  # [m] longest dimension that was seen
    settings: ObjectSettings
    iri: str | None = None
    evidence: dict[str, CategoryEvidence] = field(default_factory=dict)  # by category
    looks: float = 0.0  # that showed its place, each as much as it counts as a miss
    absence: Absence = field(default_factory=Absence)
    early: float = 0.0  # log-odds gained by few looks of the run, as last assessed
    absent: float = 0.0  # probability that it left the spot where it was last seen
    peak: float = 0.0  # greatest existence so far
    stale: bool = False  # whether it was last seen long ago
    observations: int = 0
    weight: float = 0.0  # of the sightings in its position
    sizes: deque[float] = field(default_factory=lambda: deque(maxlen=15))  # of whole boxes
    lows: deque[Floats] = field(default_factory=deque)  # corners of the latest sightings' boxes
    highs: deque[Floats] = field(default_factory=deque)
    low: Floats = field(default_factory=lambda: np.zeros(3))  # (3,) [m] corners of its own
    high: Floats = field(default_factory=lambda: np.zeros(3))
    viewpoints: dict[Viewpoint, int] = field(default_factory=dict)  # with the looks from there
    views: dict[Viewpoint, Row] = field(default_factory=dict)  # its box, as first seen from there
    shown: int = 0  # views so far
    grown: int = 0  # views when its box was last looked for
    box: OrientedBox | None = None  # grown from the surface
    clear_views: set[Viewpoint] = field(default_factory=set)  # through its volume, since seen
    number: int = field(default_factory=numbers.next)  # no other track has it
    together: dict[int, int] = field(default_factory=dict)  # frames that also showed track `number`
    first_seen: float = 0.0  # [s]
    last_seen: float = 0.0
    last_frame: int = 0  # number of the frame that last showed it
    place: str | None = None
    best: Evidence | None = None
    written: ObjectRecord | None = None
    labels: dict[str, float] = field(default_factory=dict)  # alternatives, as last written
    log_odds: dict[str, float] = field(default_factory=dict)  # by category, as last assessed
    category: str = ""  # IRI of the most probable one
    plausible: frozenset[str] = frozenset()  # categories that a detection of it may have
    presence: float = 0.0  # probability that a thing of `category` was where it was last seen
    existence: float = 0.0  # probability that it is still there
    judged: dict[str, float] = field(default_factory=dict)  # log-odds that count its box, too
    name: str = ""  # IRI of the most probable category by these, ...
    certainty: float = 0.0  # ... and the probability that a thing of it is still there
    usual: UsualSize = UNUSUAL  # size of its name
    changed: bool = True  # since it was last stored

    @property
    def outline(self) -> OrientedBox:
        """Its box, or that of the latest sightings, with hidden parts of what stands on the floor.

        The box of a short thing that the surface does not show is around the sightings' mean.
        """
        box = self.box
        if box is None:
            extent = self.high - self.low
            long = float(extent[:2].max()) > self.settings.centred
            centre = (self.low + self.high) / 2 if long else self.p_map
            box = OrientedBox(centre, np.round(extent / _STEP) * _STEP, 0.0)
        return self.usual.whole(box) if self.views else box  # as others measured it

    @property
    def deviation(self) -> float:
        """Standard deviation [m] of each coordinate of its position."""
        s = self.settings
        return s.position_noise + s.size_noise * min(self.size, 2 * s.largest)

    def look(self, viewpoint: Viewpoint) -> float:
        """Count a look from `viewpoint`; returns its weight, as looks from there are correlated."""
        before = self.viewpoints.pop(viewpoint, 0)
        self.viewpoints[viewpoint] = before + 1
        if len(self.viewpoints) > _VIEWPOINTS:
            del self.viewpoints[next(iter(self.viewpoints))]
        return 1 / (1 + before)

    def locate(self, sighting: ThingSighting, novelty: float) -> None:
        """Update position and extent with a sighting.

        A sighting beyond every gate shows a thing whose position was asserted elsewhere. Position
        and extent then start anew from the sighting.
        """
        s = self.settings
        reach = s.gate + 2 * s.gate_size * min(max(self.size, sighting.size), s.largest)
        if self.observations and float(np.linalg.norm(sighting.p_map - self.p_map)) > reach + 0.5:
            self.weight = 0.0
            self.lows.clear()
            self.highs.clear()
            self.views.clear()
            self.shown, self.grown, self.box = 0, 0, None
        weight = novelty * (0.3 if sighting.cut else 1.0) / (0.5 + (sighting.depth or 1.0) ** 2 / 4)
        self.weight = min(self.weight + weight, s.most_weight)
        self.p_map = self.p_map + (sighting.p_map - self.p_map) * min(weight / self.weight, 1.0)
        if sighting.point and self.lows:
            return
        if not sighting.cut:
            self.sizes.append(sighting.size)
            self.size = median(self.sizes)
        elif not self.sizes:
            self.size = max(self.size, sighting.size)
        self.add_box(sighting.low, sighting.high)

    def add_box(self, low: Floats, high: Floats) -> None:
        """Update the extent with one more box, corners (3,) [m]."""
        s = self.settings
        self.lows.append(low)
        self.highs.append(high)
        while len(self.lows) > s.voices:
            self.lows.popleft()
            self.highs.popleft()
        outliers = int(len(self.lows) * s.outliers + 0.5)
        self.low = np.sort(self.lows, axis=0)[outliers]
        self.high = np.sort(self.highs, axis=0)[-1 - outliers]

    def show(self, row: Row) -> None:
        """Keep a view of its box, if it is the first from its viewpoint."""
        seen_from = viewpoint(pose_of(row))
        if seen_from in self.views:
            return
        self.views[seen_from] = row
        self.shown += 1
        if len(self.views) > MAX_VIEWS:
            del self.views[next(iter(self.views))]

    def assume_extent(self) -> None:
        """Use a cube of its size as the extent, where only the position was measured."""
        if self.lows and float((self.high - self.low).max()) < 0.05:
            half = self.size / 2
            self.lows.clear()
            self.highs.clear()
            self.add_box(self.p_map - half, self.p_map + half)

    def hit(self, scores: Mapping[str, float], weight: float, visibility: float) -> None:
        """Count a look that shows it, with the best score of each category."""
        self.looks += weight * visibility
        for category, score in scores.items():
            held = self.evidence.setdefault(category, CategoryEvidence())
            held.strength += weight * strength(score)
            held.looks += weight * visibility

    def assess(self, usual: SizeOf, departed: float = 0.0) -> None:
        """Compute the categories' log-odds and the absence anew.

        `departed` is the prior probability that the thing left since it was last seen.
        """
        self.changed = True
        self.absent = self.absence.probability(departed) if departed else 0.0
        size = median(self.sizes) if self.sizes else 0.0
        sides = [] if self.box is None else self.box.extent.tolist()
        missed = self.looks - max(held.looks for held in self.evidence.values())
        self.log_odds, self.judged = {}, {}
        for category, held in self.evidence.items():
            known = usual(category)
            fit = SIZE * size_log_likelihood(size, known)
            self.log_odds[category] = held.log_odds(self.looks - held.looks, fit, MISSED_NAME)
            fit += self.early + beyond(sides, known, size)
            self.judged[category] = held.log_odds(missed, fit)
        self.conclude()
        self.usual = usual(self.name) or UNUSUAL

    def conclude(self) -> None:
        """Compute category, name and existence from the log-odds and the absence."""
        odds = self.log_odds
        self.category = max(odds, key=lambda c: (odds[c], c))
        top = odds[self.category]
        self.plausible = frozenset(c for c, value in odds.items() if value > top - 3)
        self.presence = category_probabilities(odds)[self.category]
        self.existence = self.presence * (1 - self.absent)
        self.peak = max(self.peak, self.existence)
        self.name = max(self.judged, key=lambda c: (self.judged[c], c))
        self.certainty = category_probabilities(self.judged)[self.name] * (1 - self.absent)

    @property
    def alternatives(self) -> dict[str, float]:
        """Probability that a thing of each other category is there, as written where still so."""
        before = self.labels
        found = dict[str, float]()
        for category, p in category_probabilities(self.judged).items():
            p, old = p * (1 - self.absent), before.get(category, 0.0)
            if category != self.name and max(p, old) >= STEP:
                found[category] = old if abs(p - old) < _SAME_LABEL else p
        return found

    def merge(self, other: Track) -> None:
        """Merge the evidence of `other`, which is the same thing."""
        for category, held in other.evidence.items():
            self.evidence.setdefault(category, CategoryEvidence()).merge(held)
        self.looks += other.looks
        total = self.weight + other.weight
        if total > 0:
            self.p_map = (self.p_map * self.weight + other.p_map * other.weight) / total
        self.weight = min(total, self.settings.most_weight)
        self.absence.merge(other.absence)
        self.sizes.extend(other.sizes)
        for low, high in zip(other.lows, other.highs, strict=True):
            self.add_box(low, high)
        for viewpoint, looks in other.viewpoints.items():
            self.viewpoints[viewpoint] = max(looks, self.viewpoints.get(viewpoint, 0))
        for row in other.views.values():
            self.show(row)
        self.observations += other.observations
        self.first_seen = min(self.first_seen, other.first_seen)
        self.last_seen = max(self.last_seen, other.last_seen)
        self.last_frame = max(self.last_frame, other.last_frame)

    def becomes(self, old: Track) -> None:
        """Continue as `old`, the same thing before it moved here."""
        self.iri, self.written = old.iri, old.written
        self.first_seen = min(self.first_seen, old.first_seen)
        self.observations += old.observations

    def record(self) -> ObjectRecord:
        """Its record, as perception believes it."""
        return ObjectRecord(
            **self._common_fields(),
            confidence=3 * self.certainty,
            existence=self.certainty,
            place=self.place,
            evidence=self.best,
            deviation=self.deviation,
            labels=self.alternatives,
        )

    def departed_record(self, now: float) -> DepartedRecord:
        """Its record as a departed object, found gone at `now` [s]."""
        found_gone = max(now, self.last_seen)
        return DepartedRecord(**self._common_fields(), peak=self.peak, found_gone=found_gone)

    def _common_fields(self) -> dict[str, Any]:
        box = self.outline
        return {
            "iri": self.iri,
            "category": self.name,
            "p_map": box.centre,
            "observations": self.observations,
            "first_seen": self.first_seen,
            "last_seen": self.last_seen,
            "extent": box.extent,
            "yaw": box.yaw,
        }


def track_of(record: ObjectRecord, settings: ObjectSettings, usual_size: SizeOf) -> Track:
    """Track of an object of the map, with evidence that agrees with its record.

    A thing whose record has no extent is of its category's usual size.
    """
    extent, size, box = record.extent, 0.0, None
    if extent is None:
        extent = np.full(3, (usual_size(record.category) or UNUSUAL).longest)
    else:
        size = float(extent.max())
        if record.yaw:
            box = OrientedBox(record.p_map, extent, record.yaw)
            extent = upright_bounds(extent, record.yaw)
    track = Track(
        p_map=record.p_map,
        size=max(size or float(extent.max()), 0.05),
        box=box,
        settings=settings,
        iri=record.iri,
        absence=Absence(hits=min(float(record.observations), KNOWN)),
        observations=record.observations,
        weight=min(0.5 * record.observations, settings.most_weight),
        first_seen=record.first_seen,
        last_seen=record.last_seen,
        place=record.place,
        best=record.evidence,
        written=record,
        labels=dict(record.labels),
    )
    track.low, track.high = record.p_map - extent / 2, record.p_map + extent / 2
    for _ in range(min(record.observations, settings.voices)):
        track.lows.append(track.low)
        track.highs.append(track.high)
    if size > 0:
        track.sizes.extend([size] * min(max(record.observations, 1), 15))
    sides = [] if box is None else box.extent.tolist()
    for category, odds in _log_odds(record).items():
        track.evidence[category] = CategoryEvidence()
        known = usual_size(category)
        fit = SIZE * size_log_likelihood(size, known) + beyond(sides, known, size)
        track.evidence[category].set_log_odds(odds, fit)
    track.assess(usual_size)
    return track


def track_of_departed(
    record: DepartedRecord, settings: ObjectSettings, usual_size: SizeOf
) -> Track:
    """Track of an object that left the map, as it was known there."""
    fields = {name: getattr(record, name) for name in DepartedRecord.__slots__}
    peak = fields.pop("peak")
    del fields["found_gone"]
    known = ObjectRecord(**fields, confidence=3 * peak, existence=peak)
    return track_of(known, settings, usual_size)


def _log_odds(record: ObjectRecord) -> dict[str, float]:
    """Log-odds of a record's category and its alternatives, against there being nothing.

    The inverse of `category_probabilities`; probabilities are kept within 0.005..0.995.
    """
    believed = {**record.labels, record.category: record.existence}
    nothing = max(1 - sum(believed.values()), 0.005)
    return {c: math.log(min(max(p, 0.005), 0.995) / nothing) for c, p in believed.items()}


SEEN_TOGETHER: Final = 2  # frames with a detection of each that prove two things


def count_together(tracks: Sequence[Track]) -> None:
    """Count a frame that shows these tracks as different things."""
    for track in tracks:
        for other in tracks:
            if other is not track:
                times = track.together.get(other.number, 0)
                track.together[other.number] = min(times + 1, SEEN_TOGETHER)


def same_facts(a: ObjectRecord, b: ObjectRecord) -> bool:
    """Whether two records differ by rounding at most."""
    return (
        (a.category, a.observations) == (b.category, b.observations)
        and abs(a.existence - b.existence) < 0.011
        and bool(np.allclose(a.p_map, b.p_map, atol=0.011))
    )
