"""Thing mapper: things without a name, as the views of a recording show them at its end.

A part that stands out of its surroundings and lies in no box of a named object is a thing. A thing
that was there before keeps its IRI. One that nobody named leaves the map where the surface no
longer shows it, where views show the place and not the thing, or once a named object is there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.maps.object_pictures import MAX_BYTES, ObjectPictures
from kg.maps.semantic_map import SemanticMap
from kg.maps.surface.voxels import Surface
from kg.model import vocabulary as v
from kg.model.errors import GraphError
from kg.model.oriented_boxes import OrientedBox, along
from kg.model.records import SURFACE, Evidence, ObjectRecord
from mapping.objects.object_mapper import ObjectChanges
from mapping.places.place_registry import PlaceRegistry
from mapping.things.recent_views import RecentViews, SeenView
from mapping.things.thing_finder import FoundThing, ThingFinder, is_covered
from mapping.things.view_parts import MAX_LENGTH
from perception.annotate import decode_jpeg
from perception.frames import Frame
from perception.object_picture import object_picture

_SAME: Final = 0.2  # overlap of boxes from which on a thing is one that was there before
_DOUBT: Final = 3.0  # views after which a thing is as likely as not to be one
_VOXELS: Final = 10  # of the surface in the box of a thing that is still there, at least
_LOOKS: Final = 5  # views of its place from which on a thing that they do not show is gone

Floats = NDArray[np.float64]


class ThingMapper:
    """Finds things without a name in the views of a recording; writes nothing but pictures."""

    def __init__(
        self, semantic_map: SemanticMap, places: PlaceRegistry, recording: str, pictures: bool
    ) -> None:
        self._map, self._places, self._recording = semantic_map, places, recording
        path = semantic_map.store.path
        self._pictures = ObjectPictures(path) if path is not None and pictures else None
        self._views = RecentViews(pictures=self._pictures is not None)
        self._finder = ThingFinder()
        self._shown = dict[str, SeenView]()  # best views of this run, by IRI

    def add(self, frame: Frame, people: NDArray[np.float32]) -> None:
        """Look for things in a frame from a new viewpoint, and keep its view for pictures."""
        if self._views.add(frame, people):
            self._finder.add(frame, people)

    def changes(self, surface: Surface, named: Sequence[ObjectRecord]) -> ObjectChanges:
        """Changes that make the things those that `surface` shows, beside the `named` objects."""
        self._shown.clear()
        before, asserted = self._before()
        named = [one for one in named if one.iri not in before]
        found = [one for one in self._finder.found(surface) if not is_covered(one.points, named)]
        updated, left = list[ObjectRecord](), dict(before)
        for one in sorted(found, key=lambda one: tuple(np.round(one.box.centre, 2))):
            known = max(left.values(), key=lambda r: _overlap(one, r), default=None)
            if known is not None and _overlap(one, known) >= _SAME:
                del left[known.iri]
                updated.append(self._record(one, known))
            else:
                updated.append(self._record(one, None))
        removed = [
            iri
            for iri, record in left.items()
            if iri not in asserted and not self._is_there(record, surface, named)
        ]
        return ObjectChanges(tuple(updated), tuple(sorted(removed)))

    def _is_there(
        self, record: ObjectRecord, surface: Surface, named: Sequence[ObjectRecord]
    ) -> bool:
        """Whether a thing that this recording did not find may still be in its place."""
        if record.extent is None:
            return False
        points = surface.points.astype(np.float64)
        relative = np.abs(along(points - record.p_map, record.yaw))
        points = points[(relative <= record.extent / 2).all(1)]
        if len(points) < _VOXELS or is_covered(points, named):
            return False
        return self._views.number(points) < _LOOKS

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
        existence = round(one.views / (one.views + _DOUBT), 2)
        return ObjectRecord(
            iri=iri,
            category=v.UNNAMED_THING,
            p_map=one.box.centre,
            confidence=existence,
            existence=existence,
            observations=one.views,
            first_seen=first,
            last_seen=last,
            place=self._places.at(one.box.centre),
            evidence=evidence,
            extent=one.box.extent,
            deviation=None if before is None else before.deviation,
            relations=None,
            yaw=one.box.yaw,
        )


def _overlap(one: FoundThing, record: ObjectRecord) -> float:
    if record.extent is None or np.abs(record.p_map - one.box.centre).max() > MAX_LENGTH:
        return 0.0
    return one.box.overlap(OrientedBox(record.p_map, record.extent, record.yaw))
