"""Picture keeper: a small picture of each object's best observation, beside the map's store."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.maps.object_pictures import MAX_BYTES, ObjectPictures
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import GraphError
from kg.model.records import MapUpdate, ObjectRecord
from perception.frames import Detections, Frame
from perception.object_picture import object_picture

Image = NDArray[np.uint8]  # (H, W, 3)
Boxes = NDArray[np.float32]  # (n, 4) xyxy [px]

PERSON: Final = "person"  # label of things whose pictures are never kept
RECENT: Final = 15  # frames held, since a thing is a candidate before it is an object
_SURE: Final = 0.1  # score from which a detected person is made unrecognisable in others' pictures


class PictureKeeper:
    """Keeps pictures of the objects that frames of one recording explain best.

    A map without a folder here keeps no pictures. Where the folder cannot be written, mapping
    continues without pictures.
    """

    def __init__(self, semantic_map: SemanticMap, recording: str) -> None:
        self._map, self._recording = semantic_map, recording
        path = semantic_map.store.path
        self._pictures = None if path is None else ObjectPictures(path)
        self._recent = dict[str, tuple[Image, Boxes]]()  # frame id -> its image, boxes of people

    def keep(self, update: MapUpdate, frame: Frame, detections: Detections) -> None:
        """Keep pictures of the objects in `update` whose best observation a recent frame is."""
        if self._pictures is None:
            return
        self._recent[frame.id] = frame.rgb, people_in(detections)
        if len(self._recent) > RECENT:
            del self._recent[next(iter(self._recent))]
        try:
            for iri in update.removed:
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
        elif pictures.path_of(record) is None:
            rgb, people = self._recent[shown.frame]
            data = object_picture(rgb, shown.box, people, MAX_BYTES)
            if data is not None:
                pictures.write(record, data)

    def finish(self) -> None:
        """Drop the oldest pictures where there are too many."""
        if self._pictures is not None:
            self._pictures.limit()


def people_in(detections: Detections) -> Boxes:
    """Boxes (n, 4) [px] of the people in an image, who are left out of pictures."""
    chosen = [
        n
        for n, (label, score) in enumerate(zip(detections.label, detections.score, strict=True))
        if label == PERSON and score >= _SURE
    ]
    return detections.xyxy[chosen]
