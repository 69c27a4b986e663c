"""Picture keeper: a small picture of each object's best observation, beside the map's store."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Final

import numpy as np

from kg.maps.object_pictures import MAX_BYTES, ObjectPictures
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import GraphError, ModelError
from kg.model.records import Evidence, MapUpdate, ObjectRecord
from mapping.keepers.look_keeper import LookKeeper
from mapping.looks.known_things import MovedLooks, NamedObject, recognise, remember_named
from mapping.objects.detections.detection_report import BELIEVED
from perception.annotate import Boxes, Image, object_picture
from perception.frames import Detections, Frame

PERSON: Final = "person"  # label of things whose pictures are never kept
RECENT: Final = 15  # frames held, since a thing is a candidate before it is an object
_SUSPECTED: Final = 0.1  # score from which what may be a person is left out of the surface
SURE: Final = 0.5  # and from which it is made unrecognisable in pictures of other things
_COVERED: Final = 0.3  # share of a thing's box that people cover, so that another frame is taken


class PictureKeeper:
    """Keeps pictures of the objects that frames of one recording explain best.

    A map without a folder here keeps no pictures. Where the folder cannot be written, mapping
    continues without pictures.
    """

    def __init__(
        self, semantic_map: SemanticMap, recording: str, looks: LookKeeper | None = None
    ) -> None:
        self._map, self._recording, self._looks = semantic_map, recording, looks
        path = semantic_map.store.path
        self._pictures = None if path is None else ObjectPictures(path)
        self._recent = dict[str, tuple[Image, Boxes]]()  # frame id -> its image, boxes of people
        self.moved = None if path is None else MovedLooks(path, self._picture)
        self.recognised: tuple[NamedObject, ...] = ()  # known things, at the end
        self.problem = ""  # of the known things
        if self._pictures is not None:
            with self._telling():
                remember_named(semantic_map)

    def see(self, frame: Frame, detections: Detections) -> None:
        """Hold a frame for pictures of what it shows."""
        if self._pictures is None:
            return
        self._recent[frame.id] = frame.rgb, people_in(detections, SURE)
        if len(self._recent) > RECENT:
            del self._recent[next(iter(self._recent))]

    def keep(self, update: MapUpdate, joined: Iterable[tuple[str, str]] = ()) -> None:
        """Keep pictures of the objects in `update` whose best observation a recent frame is.

        Pictures of objects that left stay, so that they are known elsewhere. `joined` has the IRIs
        of objects that are no more, and of those that they turned out to be.
        """
        if self._pictures is None:
            return
        try:
            for gone, kept in joined:
                self._pictures.join(kept, gone)
            for iri in {*update.removed} - {record.iri for record in update.departed}:
                self._pictures.remove(iri)
            for record in update.objects:
                self._keep(self._pictures, record)
        except GraphError:
            self._pictures = None

    def _keep(self, pictures: ObjectPictures, record: ObjectRecord) -> None:
        shown = record.evidence
        if shown is None or shown.recording != self._recording or shown.frame not in self._recent:
            return
        if self._map.catalogue.label(record.category) == PERSON:
            pictures.remove(record.iri)
        elif not pictures.has(record):
            _, people = self._recent[shown.frame]
            if covered_share(shown.box, people) > _COVERED and pictures.views_of(record.iri):
                return  # a former view shows more of it
            data = self._picture(shown)
            if data is not None:
                pictures.write(record, data)
                if self._looks is not None and record.existence >= BELIEVED:
                    self._looks.add(record.iri, data)

    def _picture(self, shown: Evidence) -> bytes | None:
        """JPEG of an observation in a recent frame; None in others."""
        if shown.recording != self._recording or shown.frame not in self._recent:
            return None
        rgb, people = self._recent[shown.frame]
        return object_picture(rgb, shown.box, people, MAX_BYTES)

    def finish(self) -> None:
        """Drop the oldest pictures where there are too many, and name the things that are known."""
        if self._pictures is not None:
            self._pictures.limit()
            with self._telling():
                remember_named(self._map)  # also those named meanwhile
                self.recognised += recognise(self._map)

    @contextmanager
    def _telling(self) -> Iterator[None]:
        """Errors of the known things are told, and do not end the mapping."""
        try:
            yield
        except ModelError as error:
            self.problem = f"known things are not looked for: {error}"


def covered_share(box: tuple[float, float, float, float], people: Boxes) -> float:
    """Share of a box (xyxy [px]) that the one of `people` covers who covers most of it, 0..1."""
    x1, y1, x2, y2 = box
    wide = np.clip(np.minimum(people[:, 2], x2) - np.maximum(people[:, 0], x1), 0, None)
    high = np.clip(np.minimum(people[:, 3], y2) - np.maximum(people[:, 1], y1), 0, None)
    area = max((x2 - x1) * (y2 - y1), 1e-9)
    return float((wide * high).max(initial=0.0)) / area


def people_in(detections: Detections, least: float = _SUSPECTED) -> Boxes:
    """Boxes (n, 4) [px] of the people in an image, from a score `least` on."""
    chosen = [
        n
        for n, (label, score) in enumerate(zip(detections.label, detections.score, strict=True))
        if label == PERSON and score >= least
    ]
    return detections.xyxy[chosen]
