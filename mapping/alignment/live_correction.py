"""Live correction: what a live camera mapped follows the loops that its tracker closes later.

The frames that were mapped are kept. Where loops moved them, they are mapped once more by their
corrected poses, as a recording is (`mapping.alignment.pose_correction`).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

from kg.maps.semantic_map import SemanticMap
from mapping.alignment.pose_correction import CorrectionReport, correct_poses
from mapping.mapping_options import MappingOptions
from mapping.runs.progress_report import MappingReport
from perception.frames import Frame, Recording
from perception.sources.live.live_recording import KeptFrames, LiveRecording

MOVED: Final = 0.03  # [m] by which loops move the camera before what was mapped follows
REST: Final = 10.0  # times as long as the last correction took, until the next one begins


MapInto = Callable[[Recording, SemanticMap, MappingOptions], MappingReport]


@dataclass(slots=True)
class LiveCorrection:
    """Corrections of what one live recording mapped, while it goes on and at its end."""

    recording: LiveRecording
    kept: KeptFrames
    corrections: int = 0  # so far
    _next: float = 0.0  # [s] when the next one may begin

    def keep(self, frame: Frame) -> None:
        """Keep a frame that was mapped just now."""
        if self.recording.tracker is not None:
            self.kept.add(frame)

    def run(
        self,
        semantic_map: SemanticMap,
        map_into: MapInto,
        options: MappingOptions,
        tell: Callable[[str], None],
    ) -> MappingReport:
        """Map the live recording until its end; the map follows the loops, with a line each time.

        `map_into` maps a recording, the live one or its kept frames, into a map. Raises what
        `map_into` and `correct_poses` do.
        """
        self.recording.pauses = self._is_due
        report = None
        while True:
            part = map_into(self.recording, semantic_map, options)
            report = part if report is None else report.followed_by(part)
            if self._is_needed():
                tell(f"loops moved the camera by up to {self._moved():.2f} m; the map follows")
                tell(self._correct(semantic_map, map_into, options).summary())
            if not self.recording.paused:
                return report

    def _moved(self) -> float:
        tracker = self.recording.tracker
        return 0.0 if tracker is None else tracker.moved

    def _is_needed(self) -> bool:
        """Whether loops moved what was mapped, and all of its frames are kept."""
        return self.kept.whole and len(self.kept) > 0 and self._moved() > MOVED

    def _is_due(self) -> bool:
        return self._is_needed() and time.monotonic() >= self._next

    def _correct(
        self, semantic_map: SemanticMap, map_into: MapInto, options: MappingOptions
    ) -> CorrectionReport:
        before, live = time.monotonic(), self.recording
        T, poses = live.T_map_world, live.corrected_poses()
        without_rooms = replace(options, find_places=False)
        report = correct_poses(
            self.kept.recording(live.name, T, poses),
            self.kept.recording(live.name, T),
            semantic_map,
            lambda frames, apart: map_into(frames, apart, without_rooms),
            options,
        )
        self.kept.moved(poses)
        self.corrections += 1
        now = time.monotonic()
        self._next = now + REST * (now - before)
        return report
