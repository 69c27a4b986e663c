"""A room before a camera that steps back, with a real mapper and a real map in memory."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from kg.maps.semantic_map import SemanticMap
from kg.model.records import MapUpdate, ObjectRecord
from mapping.mapper import Mapper
from perception.frames import Detections, Frame

MIDDLE = (29, 21, 35, 27)  # about the optical axis: map (2, 0, 1)


class Room:
    """A wall 2 m ahead of the first view with things before it, and a mapper that watches."""

    def __init__(self, semantic_map: SemanticMap, step_back: Callable[..., Frame]) -> None:
        self.map, self.view = semantic_map, step_back
        self.views = 0
        self.mapper = Mapper(semantic_map, detector="scripted")

    def see(self, *found: tuple[str, float, tuple[float, ...]], times: int = 1) -> MapUpdate:
        """Detections (label, score, box) from so many new viewpoints; the last change."""
        for _ in range(times):
            update = self.mapper.add(self.view(self.views % 8), detections(*found))
            self.views += 1
        return update

    def look(self, depth: float) -> MapUpdate:
        """Detect nothing, with all of the image at `depth` [m], from a new viewpoint."""
        frame = self.view(self.views % 8)
        self.views += 1
        return self.mapper.add(replace(frame, depth=np.full_like(frame.depth, depth)), detections())

    @property
    def one(self) -> ObjectRecord:
        (record,) = self.map.objects()
        return record

    def label(self, record: ObjectRecord) -> str:
        return self.map.catalogue.label(record.category)


def detections(*found: tuple[str, float, tuple[float, ...]], **sources: object) -> Detections:
    return Detections(
        np.array([box for _, _, box in found], dtype=np.float32).reshape(-1, 4),
        np.array([score for _, score, _ in found], dtype=np.float32),
        tuple(label for label, _, _ in found),
        **sources,
    )


def box(column: float, row: float = 24, half: float = 3) -> tuple[float, ...]:
    return (column - half, row - half, column + half, row + half)


CUP = ("cup", 0.95, MIDDLE)
