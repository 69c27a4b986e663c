"""Resumption: the rest of a recording is mapped by the transform that the map has of it.

The gravity alignment of a recording's world is estimated from all its frames, so it changes a
little when the recording grows. The map's transform is kept.
"""

from __future__ import annotations

import numpy as np

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import LayoutError
from kg.model.records import RecordingRecord
from perception.frames import Recording
from perception.sources.recording import FolderRecording


def resumed(recording: Recording, semantic_map: SemanticMap) -> Recording:
    """Recording by the transform that the map has of it; unchanged where it is new to the map.

    Raises LayoutError where another recording of that name is in the map, or this one by another
    transform than the given one.
    """
    known = [record for record in semantic_map.recordings() if record.name == recording.name]
    if not known:
        return recording
    (before,) = known
    _check_same(recording, before)
    if isinstance(recording, FolderRecording):
        _check_same_poses(recording, before)
    if isinstance(recording, FolderRecording) and recording.gravity_aligned:
        return recording.placed(before.T_map_world)
    if isinstance(recording, FolderRecording) and not recording.transform_given:
        between = before.T_map_world @ np.linalg.inv(recording.T_map_world)
        if between[2, 2] > 1 - 1e-6:  # the same up: aligned with the map when it was mapped
            return recording.placed(before.T_map_world)
    if not np.allclose(before.T_map_world, recording.T_map_world, atol=1e-3):
        raise LayoutError(
            f"recording {recording.name!r} is in this map by another T_map_world; "
            "the same transform, another name or another map would work"
        )
    return recording


def _check_same_poses(recording: FolderRecording, before: RecordingRecord) -> None:
    """Estimated poses are in a world of their own."""
    if (recording.estimate is not None) != bool(before.pose_estimate):
        now, then = ("given", "estimated") if before.pose_estimate else ("estimated", "given")
        raise LayoutError(
            f"recording {recording.name!r} is in this map by {then} poses, not by {now} ones; "
            "the same poses, another name or another map would work"
        )


def _check_same(recording: Recording, before: RecordingRecord) -> None:
    last = before.frames_applied - 1
    if 0 <= last < len(recording):
        frame = next(recording.frames(last), None)
        if frame is not None and frame.id != before.last_frame:
            raise LayoutError(
                f"another recording {recording.name!r} is in this map: its frame {last + 1} is "
                f"{before.last_frame}, not {frame.id}; another name would work"
            )
