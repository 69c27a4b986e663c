"""A recording that a map holds already, as far as it was then: the rest of it is mapped as before.

How a recording stands is found from all that it shows, so it is found a little otherwise when there
is more of it. What the map holds stays where it is, and the rest comes where it would have come.
"""

from __future__ import annotations

import numpy as np

from kg.errors import LayoutError, MapBusyError
from kg.others import OthersWrites
from kg.records import RecordingRecord
from kg.semantic_map import SemanticMap
from perception.frame import Recording
from perception.recording import FolderRecording


def as_before(
    recording: Recording, semantic_map: SemanticMap
) -> tuple[Recording, RecordingRecord | None]:
    """`recording` as the map stands it, and how far the map holds it; None where it does not.

    Raises LayoutError where another recording of that name lies in the map, or this one by another
    transform than the given one.
    """
    known = [record for record in semantic_map.recordings() if record.name == recording.name]
    if not known:
        return recording, None
    (before,) = known
    _refuse_another(recording, before)
    if isinstance(recording, FolderRecording) and recording.stood_upright:
        return recording.placed(before.T_map_world), before
    if not np.allclose(before.T_map_world, recording.T_map_world, atol=1e-3):
        raise LayoutError(
            f"recording {recording.name!r} is in this map by another T_map_world; "
            "the same transform, another name or another map would work"
        )
    return recording, before


class OneMapper:
    """Whether a recording is mapped by nobody else meanwhile, into a map that others write too."""

    def __init__(self, semantic_map: SemanticMap, recording: str) -> None:
        self._map, self._recording = semantic_map, recording
        self._watch = OthersWrites(semantic_map)
        self._left = self._progress()

    def note(self, record: RecordingRecord | None) -> None:
        """Remember how far this mapper has brought the recording."""
        if record is not None:
            self._left = (record.frames_applied, record.last_frame)

    def refuse_others(self) -> None:
        """Raise MapBusyError where somebody else maps the recording; cheap where nobody wrote."""
        if not self._watch.take():
            return
        there = self._progress()
        if there != self._left:
            raise MapBusyError(
                f"somebody else maps recording {self._recording!r} into this map and is at frame "
                f"{there[0]}, {there[1] or 'none'}; let one of you do it, and map again afterwards"
            )

    def _progress(self) -> tuple[int, str]:
        """Frames that the map holds, and the last of them."""
        for record in self._map.recordings():
            if record.name == self._recording:
                return record.frames_applied, record.last_frame
        return 0, ""


def _refuse_another(recording: Recording, before: RecordingRecord) -> None:
    last = before.frames_applied - 1
    if 0 <= last < len(recording):
        frame = next(recording.frames(last)).id
        if frame != before.last_frame:
            raise LayoutError(
                f"another recording {recording.name!r} is in this map: its frame {last + 1} is "
                f"{before.last_frame}, not {frame}; another name would work"
            )
