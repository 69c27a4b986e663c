"""Recording listing: a folder's image pairs with camera poses, as a format's reader finds them.

Two streams are associated by their stamps.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from perception.camera.intrinsics import Intrinsics

DAMAGED_SHARE: Final = 0.1  # of a recording's frames that may be damaged
TOLD: Final = 3  # damaged frames that are named
_log = logging.getLogger(__name__)
TOLERANCE: Final = 0.02  # [s] within which two stamps are taken for one moment


def nearest_pairs(
    a: NDArray[np.float64], b: NDArray[np.float64], tolerance: float
) -> list[tuple[int, int]]:
    """Pairs (i, j) with |a[i] - b[j]| <= `tolerance` [s], nearest pair first, each used once."""
    order = np.argsort(b, kind="stable")
    sorted_b = b[order]
    first = np.searchsorted(sorted_b, a - tolerance, "left")
    last = np.searchsorted(sorted_b, a + tolerance, "right")
    counts = last - first
    i = np.repeat(np.arange(len(a)), counts)
    within = np.arange(len(i)) - np.repeat(np.cumsum(counts) - counts, counts)
    j = order[np.repeat(first, counts) + within]
    pairs: list[tuple[int, int]] = []
    used_a, used_b = np.zeros(len(a), bool), np.zeros(len(b), bool)
    for k in np.lexsort((j, i, np.abs(a[i] - b[j]))):
        if not used_a[i[k]] and not used_b[j[k]]:
            used_a[i[k]] = used_b[j[k]] = True
            pairs.append((int(i[k]), int(j[k])))
    return pairs


FRAME_RATE = 30.0  # [Hz] of formats that number their frames and have no times


def stamp_of_number(number: int) -> float:
    """Stamp [s] of a frame by its number, in whole nanoseconds, as messages keep it."""
    return round(number / FRAME_RATE, 9)


class StoredImage(Protocol):
    """An image of a recording, decoded on request; `str` gives its location."""

    def check(self) -> None:
        """Raise RecordingError for damage that shows without decoding the image."""

    def colour(self) -> NDArray[np.uint8]:
        """(H, W, 3) RGB; raises RecordingError for an unreadable image."""

    def depth(self, depth_scale: float) -> NDArray[np.float32]:
        """(H, W) [m], nan = no return; `depth_scale` [units a metre] is that of 16-bit images."""


@dataclass(frozen=True, slots=True)
class FrameEntry:
    """Frame entry: a colour image, its depth image and the camera's pose."""

    id: str
    colour: StoredImage
    depth: StoredImage
    T_world_cam: NDArray[np.float64]  # (4, 4) camera -> the recording's world [m]
    stamp: float  # [s], relative to the start or since 1970
    camera: str = ""  # its name, where the recording has several


@dataclass(frozen=True, slots=True)
class DepthCamera:
    """A depth camera apart from the colour camera: its depth is not registered to colour."""

    intrinsics: Intrinsics
    T_colour_depth: NDArray[np.float64]  # (4, 4) depth camera -> colour camera [m]


@dataclass(frozen=True, slots=True)
class RecordingListing:
    """All entries of a recording, in time order, and the camera of the colour images."""

    entries: tuple[FrameEntry, ...]
    camera: Intrinsics | None  # None = not in the folder
    depth_scale: float  # depth units a metre, unless the intrinsics or the caller have another
    depth_camera: DepthCamera | None = None  # None = depth is registered to colour
    up: NDArray[np.float64] | None = None  # (3,) up in the recording's world, where it is known
    T_map_world: NDArray[np.float64] | None = None  # (4, 4) where the recording itself has it
    no_poses: str = ""  # reason, in a sentence, why the entries' poses are not real; "": they are
    #: reason why the existing poses cannot be used, and a remedy; the entries have none then
    unused_poses: str = ""
    no_pose_found: str = ""  # what to say where the poses of all entries are LOST
    up_of_first_camera: NDArray[np.float64] | None = None  # (3,) of an IMU, where poses are missing
    no_camera: str = ""  # reason why there is no camera, and a remedy
    #: poses (4, 4) of the camera in other frames that the entries may be poses of, by option
    other_frames: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class DamagedImages:
    """Frames whose images are missing or cannot be read: they show nothing, and are told once."""

    recording: str = ""
    frames: int = 0  # of the recording
    causes: dict[str, RecordingError] = field(default_factory=dict)  # by the frame's id
    told: set[str] = field(default_factory=set)  # ids

    def add(self, frame: str, cause: RecordingError) -> None:
        """Count a frame; raises its cause where too many are damaged."""
        self.causes.setdefault(frame, cause)
        if (count := len(self.causes)) > DAMAGED_SHARE * self.frames:
            raise RecordingError(
                f"{cause}; {count} of {self.frames} frames are damaged or incomplete, and at most "
                "a tenth may be: a copy without these frames would work"
            )

    def tell(self, frame: str) -> None:
        """Warn of a frame, where it is one of the first."""
        if frame not in self.told and len(self.told) <= TOLD:
            self.told.add(frame)
            more = len(self.told) > TOLD
            what = "more frames are" if more else f"{self.causes[frame]}; the frame is"
            _log.warning("%s: %s left out", self.recording, what)


@dataclass(frozen=True, slots=True)
class Streams:
    """Which streams of a recording are read, where it has several; None = guessed."""

    colour: str | None = None
    depth: str | None = None
    camera: str | None = None  # colour's CameraInfo
    pose: str | None = None
    pose_frame: str | None = None  # whose poses that topic gives, instead of the frame it names
    camera_frame: str | None = None  # of the colour images, instead of that in their headers
    camera_in: str | None = None  # FRAME=x,y,z,roll,pitch,yaw, or a URDF file
    map_frame: str | None = None
    tolerance: float = TOLERANCE  # [s] between colour and depth of one frame

    @property
    def given(self) -> bool:
        """Whether anything is given."""
        return self != Streams()


@dataclass(frozen=True, slots=True)
class Format:
    """A format of recordings: a layout of files in a folder, or a kind of file."""

    name: str
    looks_for: str  # the files by which it is recognised, for people
    matches: Callable[[Path], bool]  # whether a folder or file is of this format
    read: Callable[[Path, Streams], RecordingListing]  # raises RecordingError


def first_file(folder: Path, *names: str) -> Path | None:
    """The first of the named files that is there; None if none is."""
    return next((folder / name for name in names if (folder / name).is_file()), None)


def subfolder(folder: Path, *names: str) -> Path:
    """The first of the named folders that is there; raises RecordingError if none is."""
    for name in names:
        if (folder / name).is_dir():
            return folder / name
    raise RecordingError(f"{folder} has no folder {' or '.join(f'{n}/' for n in names)}")
