"""Thing mapper: things without a name, as the surface shows them at the end of a recording.

A part that stands out of the surface and lies in no box of a named object is a thing. A thing that
was there before keeps its IRI. One that nobody named leaves the map where the surface no longer
shows it, or once a named object is there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.maps.object_pictures import MAX_BYTES, ObjectPictures
from kg.maps.semantic_map import SemanticMap
from kg.maps.surface.voxels import Surface
from kg.model import vocabulary as v
from kg.model.errors import GraphError
from kg.model.oriented_boxes import OrientedBox, along, along_nearest_axes
from kg.model.records import SURFACE, Evidence, ObjectRecord
from mapping.objects.extents.walls import Walls
from mapping.objects.object_mapper import ObjectChanges
from mapping.places.place_registry import PlaceRegistry
from mapping.things.recent_views import RecentViews, SeenView
from mapping.things.segmentation import members, segments
from perception.annotate import decode_jpeg
from perception.frames import Frame
from perception.object_picture import object_picture

SMALLEST: Final = 0.08  # [m] longest side of a thing, at least ...
LARGEST: Final = 1.0  # ... and at most
MIN_COUNT: Final = 2  # frames that showed a voxel, at least
_COVERED: Final = 0.5  # share of its voxels in the box of a named object, from which on it is that
_AROUND: Final = 0.05  # [m] around the box of a named object
_SAME: Final = 0.2  # overlap of boxes from which on a thing is one that was there before
_DOUBT: Final = 3.0  # frames after which a thing is as likely as not to be one
_SURE: Final = 0.5  # existence from which on a named object hides a thing

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class FoundThing:
    """A thing that stands out of the surface."""

    box: OrientedBox
    points: Floats  # (n, 3) [m] centres of its voxels
    frames: int  # that showed it
    last_seen: float  # [s]


class ThingMapper:
    """Finds things without a name in the surface of a map; writes nothing but pictures itself."""

    def __init__(
        self, semantic_map: SemanticMap, places: PlaceRegistry, recording: str, pictures: bool
    ) -> None:
        self._map, self._places, self._recording = semantic_map, places, recording
        path = semantic_map.store.path
        self._pictures = ObjectPictures(path) if path is not None and pictures else None
        self._views = RecentViews(pictures=self._pictures is not None)
        self._shown = dict[str, SeenView]()  # best views of this run, by IRI

    def add(self, frame: Frame, people: NDArray[np.float32]) -> None:
        """Keep a view of a frame, for pictures of things."""
        self._views.add(frame, people)

    def changes(self, surface: Surface, named: Sequence[ObjectRecord]) -> ObjectChanges:
        """Changes that make the map's things those of `surface`, beside the `named` objects."""
        self._shown.clear()
        before, asserted = self._before()
        named = [one for one in named if one.iri not in before]
        found = [one for one in things_of(surface) if not is_covered(one, named)]
        updated, left = list[ObjectRecord](), dict(before)
        for one in sorted(found, key=lambda one: tuple(np.round(one.box.centre, 2))):
            known = max(left.values(), key=lambda r: _overlap(one, r), default=None)
            if known is not None and _overlap(one, known) >= _SAME:
                del left[known.iri]
                updated.append(self._record(one, known))
            else:
                updated.append(self._record(one, None))
        removed = tuple(sorted(iri for iri in left if iri not in asserted))
        return ObjectChanges(tuple(updated), removed)

    def keep_pictures(self) -> None:
        """Write the pictures of the things that the last changes gave another best view."""
        if self._pictures is None:
            return
        try:
            for record in self._map.perceived.objects(tuple(self._shown)):
                self._keep(self._pictures, record, self._shown[record.iri])
            self._pictures.limit()
        except GraphError:
            self._pictures = None
        self._shown.clear()

    def _keep(self, pictures: ObjectPictures, record: ObjectRecord, view: SeenView) -> None:
        if record.evidence is None:
            return
        rgb = decode_jpeg(view.jpeg)
        data = object_picture(rgb, record.evidence.box, view.people, MAX_BYTES)
        if data is not None:
            pictures.write(record, data)

    def _before(self) -> tuple[dict[str, ObjectRecord], frozenset[str]]:
        """Things in the map by IRI, with those that people named, and those with assertions."""
        asserted = self._map.assertions.all()
        named = [
            one.subject
            for one in asserted
            if one.property == "category" and one.perceived == v.UNNAMED_THING
        ]
        iris = [*(record.iri for record in self._map.unnamed_things()), *named]
        records = self._map.perceived.objects(tuple(dict.fromkeys(iris)))
        return {record.iri: record for record in records}, frozenset(a.subject for a in asserted)

    def _record(self, one: FoundThing, before: ObjectRecord | None) -> ObjectRecord:
        """Record of a thing, which was known as `before`."""
        iri = self._map.new_object_iri() if before is None else before.iri
        evidence = None if before is None else before.evidence
        first = last = one.last_seen
        best = self._views.best(one.points)
        if best is not None:
            view, share, (x1, y1, x2, y2) = best
            first, last = min(view.stamp, last), max(view.stamp, last)
            if evidence is None or evidence.recording == self._recording or share > evidence.score:
                evidence = Evidence(
                    view.frame,
                    self._recording,
                    view.stamp,
                    (x1, y1, x2, y2),
                    round(share, 2),
                    SURFACE,
                )
                if before is None or evidence != before.evidence:
                    self._shown[iri] = view
        if before is not None:
            first, last = min(first, before.first_seen), max(last, before.last_seen)
        existence = round(one.frames / (one.frames + _DOUBT), 2)
        return ObjectRecord(
            iri=iri,
            category=v.UNNAMED_THING,
            p_map=one.box.centre,
            confidence=existence,
            existence=existence,
            observations=one.frames,
            first_seen=first,
            last_seen=last,
            place=self._places.at(one.box.centre),
            evidence=evidence,
            extent=one.box.extent,
            deviation=None if before is None else before.deviation,
            relations=None,
            yaw=one.box.yaw,
        )


def things_of(surface: Surface) -> list[FoundThing]:
    """Things of 8 cm to 1 m that stand out of a surface."""
    chosen = surface.count >= MIN_COUNT
    points = surface.points[chosen].astype(np.float64)
    count, last = surface.count[chosen], surface.last_seen[chosen]
    colours = surface.colours[chosen]
    if not len(points):
        return []
    size = surface.size
    walls = Walls.of(points, size)
    yaw = 0.0 if walls is None else walls.yaw
    found = list[FoundThing]()
    for mine in members(segments(points, colours, size, yaw).part):
        own = along(points[mine], yaw)
        low, high = own.min(0) - size / 2, own.max(0) + size / 2
        if not SMALLEST <= (high - low).max() <= LARGEST:
            continue
        x, y, turn = along_nearest_axes(float(high[0] - low[0]), float(high[1] - low[1]), yaw)
        centre = along((low + high) / 2, -yaw)
        box = OrientedBox(centre, np.array([x, y, (high - low)[2]]), float(turn))
        frames = max(int(np.median(count[mine])), 1)
        found.append(FoundThing(box, points[mine], frames, float(last[mine].max())))
    return found


def is_covered(one: FoundThing, named: Sequence[ObjectRecord]) -> bool:
    """Whether a thing lies in the box of a named object."""
    for record in named:
        if record.extent is None or record.existence < _SURE:
            continue
        relative = np.abs(along(one.points - record.p_map, record.yaw))
        if (relative <= record.extent / 2 + _AROUND).all(1).mean() > _COVERED:
            return True
    return False


def _overlap(one: FoundThing, record: ObjectRecord) -> float:
    if record.extent is None or np.abs(record.p_map - one.box.centre).max() > LARGEST:
        return 0.0
    return one.box.overlap(OrientedBox(record.p_map, record.extent, record.yaw))
