"""Kept frames: images of a live camera that were mapped, on disk until its run ends.

Where loops move the camera later, they are mapped once more by their corrected poses.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import Final

import numpy as np

from perception.camera.intrinsics import Intrinsics
from perception.camera.poses import Pose
from perception.camera.rectification import Rectifier
from perception.frames import Frame
from perception.odometry.tracking_report import TrackingReport
from perception.sources.folders.image_files import ImageFile
from perception.sources.listing import FrameEntry, RecordingListing
from perception.sources.recording import FolderRecording
from perception.sources.recording_writer import DEPTH_FACTOR, RecordingWriter

MAX_FRAMES: Final = 3000  # 0.9 MB each at 640 x 480


class KeptFrames:
    """Frames of one camera in a temporary folder, up to MAX_FRAMES; use `with`.

    Colour is kept as it is, depth to 0.2 mm and up to 13 m.
    """

    def __init__(self) -> None:
        self._folder = TemporaryDirectory(prefix="hereabouts-live-")
        self._writer = RecordingWriter(Path(self._folder.name))
        self._entries: list[FrameEntry] = []  # poses are in the map
        self._camera: Intrinsics | None = None
        self.whole = True  # whether all frames are here

    def __enter__(self) -> KeptFrames:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        self._folder.cleanup()

    def __len__(self) -> int:
        return len(self._entries)

    def add(self, frame: Frame) -> None:
        """Keep a frame that was mapped; raises RecordingError where the disk is full."""
        if len(self._entries) >= MAX_FRAMES:
            self.whole = False
        if not self.whole:
            return
        name = f"{len(self._entries):06d}"
        self._writer.add(replace(frame, id=name))
        folder = Path(self._folder.name)
        colour, depth = (ImageFile(folder / f"{kind}/{name}.png") for kind in ("rgb", "depth"))
        entry = FrameEntry(frame.id, colour, depth, frame.T_map_cam, frame.stamp)
        self._entries.append(entry)
        if self._camera is None:
            (height, width), K = frame.depth.shape, frame.K
            self._camera = Intrinsics(K[0, 0], K[1, 1], K[0, 2], K[1, 2], width, height)

    def moved(self, poses: Mapping[str, Pose]) -> None:
        """Replace the poses that frames were mapped by, with poses in the map (4, 4) by id."""
        self._entries = [replace(e, T_world_cam=poses[e.id]) for e in self._entries]

    def recording(
        self, name: str, T_map_world: Pose, poses: Mapping[str, Pose] | None = None
    ) -> FolderRecording:
        """The frames as a recording of the world (4, 4), by the poses they were mapped by.

        `poses` in the map (4, 4), by the frames' ids, take their place.
        """
        assert self._camera is not None
        back = np.linalg.inv(T_map_world)
        entries = tuple(
            replace(e, T_world_cam=back @ (e.T_world_cam if poses is None else poses[e.id]))
            for e in self._entries
        )
        count = len(entries)
        return FolderRecording(
            name=name,
            format="live",
            T_map_world=T_map_world,
            listing=RecordingListing(entries, self._camera, DEPTH_FACTOR),
            rectifier=Rectifier.for_camera(self._camera),
            depth_scale=DEPTH_FACTOR,
            start_time=0.0,
            transform_given=True,
            estimate=TrackingReport(count, count, 1, 0, 0.0, (), 0, 0),
        )
