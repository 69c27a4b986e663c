"""Recording options: how a recording is read, and which of its frames."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from perception.camera.gravity_alignment import Up
from perception.camera.intrinsics import Intrinsics
from perception.camera.poses import motion, read_pose_rows, read_trajectory
from perception.number_tables import rows
from perception.sources.listing import FrameEntry, Streams

KEYFRAME_DISTANCE: Final = 0.1  # [m] of the camera from the last key frame ...
KEYFRAME_ANGLE: Final = math.radians(5)  # ... or of its orientation, that make a key frame
POSE_TOLERANCE: Final = 0.02  # [s] within which a pose of a given trajectory is that of a frame
KEY_SHARE: Final = 0.9  # of a trajectory's poses that have a frame, where others have none
_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Selection:
    """Selection of the frames that are read; all by default."""

    every: int = 1  # reads the first frame between `start` and `stop`, and each n-th after it
    limit: int | None = None  # greatest number of frames
    start: float | None = None  # [s] after the recording's first frame
    stop: float | None = None  # [s] after the recording's first frame
    keyframes: bool = False  # reads only frames whose camera has moved since the last one read

    @property
    def reached(self) -> Selection:
        """All frames between the first and the last that are selected."""
        last = None if self.limit is None or self.keyframes else (self.limit - 1) * self.every + 1
        return Selection(limit=last, start=self.start, stop=self.stop)

    @property
    def thinned(self) -> Selection:
        """The selection from the frames of `reached`."""
        return Selection(every=self.every, limit=self.limit, keyframes=self.keyframes)

    def of(self, entries: Sequence[FrameEntry], name: str) -> tuple[FrameEntry, ...]:
        """The selected entries; raises RecordingError where there is none."""
        if not entries:
            raise RecordingError(f"{name} has no frames")
        first = entries[0].stamp
        between = [
            entry
            for entry in entries
            if (self.start is None or entry.stamp - first >= self.start)
            and (self.stop is None or entry.stamp - first <= self.stop)
        ]
        if self.keyframes:
            between = keyframes(between)
        chosen = tuple(between[:: self.every])[: self.limit]
        if not chosen:
            raise RecordingError(
                f"{name}: no frames selected; its {len(entries)} frames last "
                f"{entries[-1].stamp - first:.2f} s"
            )
        return chosen


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingOptions:
    """Options of `open_recording`; None leaves a value to the recording itself.

    Attributes:
        format: name of one of `perception.sources.formats.all_formats`, or "auto".
        name: name of the recording in a map; by default that of its folder or file.
        T_map_world: (4, 4) takes the recording's world to the map frame. Without it the world is
            turned upright (`perception.camera.gravity_alignment`).
        up: direction of up in the recording's world, where `T_map_world` is not given; by default
            that of gravity-direction.txt, else the normal of the floor.
        intrinsics: those of the colour images (`load_intrinsics`).
        depth_scale: depth units a metre.
        start_time: [s since 1970] added to stamps that count from zero; now by default.
        poses: file of a trajectory in TUM format that replaces the recording's own poses.
        estimate_poses: whether poses are estimated from the images (`perception.odometry`); None:
            where there are none. Without poses, False raises RecordingError.
        pose_convention: a name of `perception.camera.poses.CONVENTIONS`.
        check: whether a sample of the depth is compared with poses and colour
            (`perception.sources.depth_check`).
        registered: whether depth is taken as it is for registered to colour, though the recording
            has a depth camera of its own.
        disparity: baseline [m] of two cameras, where depth images are disparities in pixels;
            `depth_scale` is that of the pixels then.
        bgr: whether red and blue of its images are exchanged.
        streams: topics and frames to read from a bag.
        selection: frames to read.
    """

    format: str = "auto"
    name: str | None = None
    T_map_world: NDArray[np.float64] | None = None
    up: Up | None = None
    intrinsics: Intrinsics | None = None
    depth_scale: float | None = None
    start_time: float | None = None
    poses: Path | None = None
    estimate_poses: bool | None = None
    pose_convention: str = "camera-to-world"
    check: bool = True
    registered: bool = False
    bgr: bool = False
    disparity: float | None = None
    streams: Streams = field(default_factory=Streams)
    selection: Selection = field(default_factory=Selection)


#: the options of a call that gives none
DEFAULT_OPTIONS: Final = RecordingOptions()


def keyframes(entries: Sequence[FrameEntry]) -> list[FrameEntry]:
    """The first entry, and each whose camera has moved or turned since the one before of these."""
    chosen: list[FrameEntry] = []
    for entry in entries:
        if chosen:
            distance, angle = motion(chosen[-1].T_world_cam, entry.T_world_cam)
            if distance < KEYFRAME_DISTANCE and angle < KEYFRAME_ANGLE:
                continue
        chosen.append(entry)
    return chosen


def with_trajectory(entries: tuple[FrameEntry, ...], path: Path) -> tuple[FrameEntry, ...]:
    """Entries with the poses of a trajectory; all frames must have one."""
    if len(next(rows(path), ("", []))[1]) in (7, 12, 16):  # without stamps: a pose an image
        poses = read_pose_rows(path)
        if len(poses) != len(entries):
            raise RecordingError(
                f"{path} has {len(poses)} poses without stamps, and there are {len(entries)} "
                "frames; as many of both, or stamps before the poses, would work"
            )
        return tuple(replace(e, T_world_cam=T) for e, T in zip(entries, poses, strict=True))
    trajectory = read_trajectory(path)
    found = [trajectory.at(entry.stamp, POSE_TOLERANCE) for entry in entries]
    posed = [(entry, T) for entry, T in zip(entries, found, strict=True) if T is not None]
    if len(posed) >= KEY_SHARE * len(trajectory.stamp) > 1 and 2 * len(posed) < len(entries):
        _log.warning(
            "%s has poses of %d of %d frames, as of key frames; these are read",
            path,
            len(posed),
            len(entries),
        )
    elif len(posed) < len(entries):
        raise RecordingError(
            f"{path} has a pose for {len(posed)} of {len(entries)} frames; one within "
            f"{POSE_TOLERANCE} s of each frame's stamp, from {entries[0].stamp:.3f} to "
            f"{entries[-1].stamp:.3f}, would work"
        )
    return tuple(replace(entry, T_world_cam=T) for entry, T in posed)
