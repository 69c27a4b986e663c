"""Detection localiser: detections of a frame become sightings in the map."""

from __future__ import annotations

from collections.abc import Iterator

from mapping.labels.label_resolver import LabelResolver
from mapping.projection import to_map
from mapping.reference.depth_histogram import localise
from mapping.reference.settings import ReferenceSettings
from mapping.sighting import Sighting
from perception.frames import Detections, Frame


class DetectionLocaliser:
    """Localises detections of known labels; `unplaced` counts those without usable depth."""

    def __init__(self, labels: LabelResolver, settings: ReferenceSettings) -> None:
        self._labels, self._settings = labels, settings
        self.unplaced = 0

    def sightings(self, frame: Frame, detections: Detections) -> list[Sighting]:
        """Sightings of one frame, in the order of its detections."""
        least = self._settings.min_score
        self._labels.learn(
            label
            for label, score in zip(detections.label, detections.score, strict=True)
            if score >= least
        )
        return list(self._localised(frame, detections))

    def _localised(self, frame: Frame, detections: Detections) -> Iterator[Sighting]:
        sources = detections.source or ("",) * len(detections)
        reference = detections.detectors[:1] or ("",)  # the thesis knows one detector
        masks = detections.mask or (None,) * len(detections)
        for box, score, label, source, mask in zip(
            detections.xyxy, detections.score, detections.label, sources, masks, strict=True
        ):
            if source not in reference:
                continue
            category = self._labels.category(label)
            if category is None or score < self._settings.min_score:
                continue
            p_cam = localise(frame, box, self._settings, mask)
            if p_cam is None:
                self.unplaced += 1
                continue
            x1, y1, x2, y2 = (float(v) for v in box)
            p_map = to_map(frame.T_map_cam, p_cam)
            yield Sighting(category, float(score), p_map, float(p_cam[2]), (x1, y1, x2, y2))
