"""Detections of a picture as a robot tells them: with positions in the map."""

from __future__ import annotations

from mapping.projection import to_map
from mapping.reference.depth_histogram import localise
from mapping.reference.settings import ReferenceSettings
from perception.frames import Detections, Frame
from planner.execution.protocol import Detected


def detected(
    frame: Frame,
    detections: Detections,
    nearest: float = 0.0,
    settings: ReferenceSettings | None = None,
) -> tuple[Detected, ...]:
    """What a frame shows from `nearest` [m] up to the settings' largest depth, localised."""
    settings = settings or ReferenceSettings()
    found = []
    masks = detections.mask or (None,) * len(detections)
    for box, score, label, mask in zip(
        detections.xyxy, detections.score, detections.label, masks, strict=True
    ):
        p_cam = localise(frame, box, settings, mask)
        if p_cam is not None and nearest <= p_cam[2] <= settings.max_depth:
            x, y, z = (float(c) for c in to_map(frame.T_map_cam, p_cam))
            found.append(Detected(label, float(score), x, y, z))
    return tuple(found)
