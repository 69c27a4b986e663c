"""Mapper lease: optimistic check that no other mapper writes the same recording."""

from __future__ import annotations

from kg.maps.semantic_map import SemanticMap
from kg.maps.subscriptions import ExternalChanges
from kg.model.errors import MapBusyError
from kg.model.records import RecordingRecord


class MapperLease:
    """Lease of a recording by one mapper, in a map that other programs write too.

    Nothing is locked: the recording's progress in the map shows whether another mapper advanced it.
    `record` is the progress when the lease was taken, None for a recording new to the map.
    """

    def __init__(self, semantic_map: SemanticMap, recording: str) -> None:
        self._map, self._recording = semantic_map, recording
        self._watch = ExternalChanges(semantic_map)
        self.record = self._read()
        self._left = _progress(self.record)

    def renew(self, record: RecordingRecord | None) -> None:
        """Note the progress that this mapper has written."""
        if record is not None:
            self._left = _progress(record)

    def check(self) -> None:
        """Raise MapBusyError where another mapper has advanced the recording.

        Cheap where nobody else wrote.
        """
        if not self._watch.take():
            return
        there = _progress(self._read())
        if self._watch.take_restored():
            self._left = there  # the map is as it was once, and the recording is continued there
        if there != self._left:
            raise MapBusyError(
                f"somebody else maps recording {self._recording!r} into this map and is at frame "
                f"{there[0]}, {there[1] or 'none'}; let one of you do it, and map again afterwards"
            )

    def _read(self) -> RecordingRecord | None:
        records = self._map.recordings()
        return next((r for r in records if r.name == self._recording), None)


def _progress(record: RecordingRecord | None) -> tuple[int, str]:
    """Number of frames in the map, and the id of the last one."""
    return (0, "") if record is None else (record.frames_applied, record.last_frame)
