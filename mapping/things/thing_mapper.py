"""Thing mapper: things without a name, which several views of a recording show at its end.

A part that stands out of its surroundings and lies in no box of a named object is a thing. A thing
that was there before keeps its IRI. One that nobody named leaves the map where the surface no
longer shows it, where views show the place and not the thing, or once a named object is there.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.maps.object_pictures import MAX_BYTES, ObjectPictures
from kg.maps.semantic_map import SemanticMap
from kg.maps.surface.voxels import Surface, keys_of
from kg.model import vocabulary as v
from kg.model.areas import OrientedBox, along, along_nearest_axes
from kg.model.errors import GraphError
from kg.model.records import SURFACE, Evidence, ObjectRecord
from mapping.frames.projection import to_camera
from mapping.objects.extents.surface_growth import Walls
from mapping.objects.object_mapper import ObjectChanges
from mapping.objects.tracks import Viewpoint, viewpoint
from mapping.places.place_registry import PlaceRegistry
from mapping.things.agreement import AgreedPart, SeenPart, agreed_parts
from mapping.things.view_parts import MAX_LENGTH, parts_of
from perception.annotate import decode_jpeg, encode_jpeg, object_picture
from perception.depth_image import DepthImage
from perception.frames import Frame

MAX_VIEWS: Final = 300  # that are kept; the oldest are dropped
_STEP: Final = 8  # [px] between kept values of depth
_NEAR: Final = 0.3  # [m] from which on a camera sees things
_BEHIND: Final = 0.1  # [m], and a share, by which a point may lie behind the measured depth
_POINTS: Final = 60  # of a thing that are looked for
_MIN_SHARE: Final = 0.5  # share of these that a view must show


@dataclass(frozen=True, slots=True, eq=False)
class SeenView:
    """A frame from one viewpoint."""

    frame: str
    stamp: float  # [s]
    T_map_cam: Floats  # (4, 4)
    K: Floats  # (3, 3)
    depth: NDArray[np.float32]  # (h, w) [m], every eighth pixel
    size: tuple[int, int]  # [px] width and height of the image
    jpeg: bytes  # of the whole image; empty where no pictures are kept
    people: NDArray[np.float32]  # (n, 4) xyxy [px]

    def shows(self, points: Floats) -> tuple[float, tuple[float, float, float, float]] | None:
        """Share of `points` (n, 3) [m] in the open in the image, and their box xyxy [px]."""
        p = to_camera(self.T_map_cam, points)
        if p[:, 2].min() < _NEAR:
            return None
        u = p[:, 0] / p[:, 2] * self.K[0, 0] + self.K[0, 2]
        v = p[:, 1] / p[:, 2] * self.K[1, 1] + self.K[1, 2]
        inside = (u >= 0) & (v >= 0) & (u < self.size[0]) & (v < self.size[1])
        if inside.mean() < _MIN_SHARE:
            return None
        rows, columns = self.depth.shape
        row = np.clip(v[inside] / _STEP, 0, rows - 1).astype(np.intp)
        column = np.clip(u[inside] / _STEP, 0, columns - 1).astype(np.intp)
        behind = p[inside, 2] - self.depth[row, column]
        seen = (behind < _BEHIND * np.maximum(p[inside, 2], 1.0)).sum() / len(points)
        u, v = np.clip(u, 0, self.size[0] - 1), np.clip(v, 0, self.size[1] - 1)
        box = float(u.min()), float(v.min()), float(u.max()), float(v.max())
        return float(seen), box


class RecentViews:
    """Views of one recording, one of each viewpoint."""

    def __init__(self, pictures: bool) -> None:
        self._pictures = pictures
        self._views = dict[Viewpoint, SeenView]()

    def add(self, frame: Frame, people: NDArray[np.float32]) -> bool:
        """Keep a frame, if none is kept from there; whether it is kept."""
        key = viewpoint(frame.T_map_cam)
        if key in self._views:
            return False
        height, width = frame.depth.shape
        jpeg = encode_jpeg(frame.rgb, 85) if self._pictures else b""
        depth = np.nan_to_num(frame.depth[::_STEP, ::_STEP], nan=np.inf)
        depth = np.where(depth > 0, depth, np.inf).astype(np.float32)
        self._views[key] = SeenView(
            frame.id, frame.stamp, frame.T_map_cam, frame.K, depth, (width, height), jpeg, people
        )
        if len(self._views) > MAX_VIEWS:
            del self._views[next(iter(self._views))]
        return True

    def number(self, points: Floats) -> int:
        """Number of the views that show most of `points` (n, 3) [m]."""
        some = points[:: max(1, len(points) // _POINTS)]
        shown = (view.shows(some) for view in self._views.values())
        return sum(one is not None and one[0] >= _MIN_SHARE for one in shown)

    def best(self, points: Floats) -> tuple[SeenView, float, tuple[float, ...]] | None:
        """The view that shows most of `points` (n, 3) [m], large, with the share and the box."""
        some = points[:: max(1, len(points) // _POINTS)]
        found = None
        for view in self._views.values():
            shown = view.shows(some)
            if shown is None or shown[0] < _MIN_SHARE:
                continue
            share, box = shown
            worth = share * ((box[2] - box[0]) * (box[3] - box[1])) ** 0.25
            if found is None or worth > found[0]:
                found = worth, view, share, box
        return None if found is None else found[1:]


MIN_LENGTH: Final = 0.08  # [m] longest side of a thing, at least; at most MAX_LENGTH
MAX_PARTS: Final = 20_000  # that are kept; those of the oldest views are dropped
_THERE: Final = 0.3  # share of the voxels of a thing that the surface still has, at least
_COVERED: Final = 0.5  # share of its points in the box of a named object, from which on it is that
_AROUND: Final = 0.05  # [m] around the box of a named object
_SURE: Final = 0.5  # existence from which on a named object hides a thing


@dataclass(frozen=True, slots=True, eq=False)
class FoundThing:
    """A thing that stands out of its surroundings."""

    box: OrientedBox
    points: Floats  # (n, 3) [m] of its surface
    views: int  # that show it, from different viewpoints
    last_seen: float  # [s]


class ThingFinder:
    """Parts of the views of one recording, and the things that they agree on."""

    def __init__(self) -> None:
        self._seen, self._views = list[SeenPart](), 0

    def add(self, frame: Frame, people: NDArray[np.float32]) -> None:
        """Add the parts of a view, without what is in the boxes xyxy [px] of `people`."""
        depth = frame.depth.copy()
        for x1, y1, x2, y2 in np.maximum(people, 0).astype(np.intp).tolist():
            depth[y1 : y2 + 1, x1 : x2 + 1] = 0
        parts = parts_of(DepthImage.of(depth, frame.K, frame.T_map_cam))
        self._seen += [SeenPart(part, self._views, frame.stamp) for part in parts]
        self._views += 1
        del self._seen[:-MAX_PARTS]

    def found(self, surface: Surface) -> list[FoundThing]:
        """Things of 8 cm to 1 m that `surface` still shows."""
        if not len(surface):
            return []
        walls = Walls.of(surface.points.astype(np.float64), surface.size)
        yaw = 0.0 if walls is None else walls.yaw
        there = np.sort(keys_of(_cells(surface.points, surface.size).T))
        found = list[FoundThing]()
        for agreed in agreed_parts(self._seen, yaw):
            points = np.concatenate([one.part.points for one in agreed.seen])
            cells, first = np.unique(_cells(points, surface.size), axis=0, return_index=True)
            longest = (agreed.high - agreed.low).max()
            if MIN_LENGTH <= longest <= MAX_LENGTH and _share(cells, there) >= _THERE:
                found.append(_thing(agreed, points[first].astype(np.float64), yaw))
        return found


def _cells(points: NDArray[np.float32], size: float) -> NDArray[np.int64]:
    cells: NDArray[np.int64] = np.floor(points / size).astype(np.int64)
    return cells


def _share(cells: NDArray[np.int64], there: NDArray[np.int64]) -> float:
    """Share of `cells` (n, 3) that are among `there`, sorted keys of voxels."""
    keys = keys_of(cells.T)
    at = np.searchsorted(there, keys)
    return float((there[np.minimum(at, len(there) - 1)] == keys).mean())


def _thing(agreed: AgreedPart, points: Floats, yaw: float) -> FoundThing:
    size = agreed.high - agreed.low
    x, y, turn = along_nearest_axes(float(size[0]), float(size[1]), yaw)
    centre = along((agreed.low + agreed.high) / 2, -yaw)
    box = OrientedBox(centre, np.array([x, y, size[2]]), float(turn))
    return FoundThing(box, points, len(agreed.seen), max(one.stamp for one in agreed.seen))


def is_covered(points: Floats, named: Sequence[ObjectRecord]) -> bool:
    """Whether most points (n, 3) [m] of a thing lie in the box of a named object."""
    for record in named:
        if record.extent is None or record.existence < _SURE:
            continue
        relative = np.abs(along(points - record.p_map, record.yaw))
        if (relative <= record.extent / 2 + _AROUND).all(1).mean() > _COVERED:
            return True
    return False


_SAME: Final = 0.2  # overlap of boxes from which on a thing is one that was there before
_DOUBT: Final = 3.0  # views after which a thing is as likely as not to be one
_VOXELS: Final = 10  # of the surface in the box of a thing that is still there, at least
_AHEAD: Final = 3  # frames that wait to be looked at
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
        self._worker = ThreadPoolExecutor(1, "things")
        self._waiting = deque[Future[None]]()  # frames that are looked at beside the mapping
        self._shown = dict[str, SeenView]()  # best views of this run, by IRI

    def add(self, frame: Frame, people: NDArray[np.float32]) -> None:
        """Look for things in a frame from a new viewpoint, and keep its view for pictures.

        This happens in a thread, in order, since only `changes` needs the result.
        """
        self._finish(_AHEAD)
        self._waiting.append(self._worker.submit(self._add, frame, people))

    def _add(self, frame: Frame, people: NDArray[np.float32]) -> None:
        if self._views.add(frame, people):
            self._finder.add(frame, people)

    def _finish(self, left: int = 0) -> None:
        """Wait until at most so many frames are not looked at yet."""
        while len(self._waiting) > left:
            self._waiting.popleft().result()

    def changes(self, surface: Surface, named: Sequence[ObjectRecord]) -> ObjectChanges:
        """Changes that make the things those that `surface` shows, beside the `named` objects."""
        self._finish()
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
