"""Recording listing: a folder's image pairs with camera poses, as a format's reader finds them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kg.errors import RecordingError
from perception.camera.intrinsics import Intrinsics

FRAME_RATE = 30.0  # [Hz] of formats that number their frames and say nothing of time


@dataclass(frozen=True, slots=True)
class FrameEntry:
    """Frame entry: a colour image, its depth image and the camera's pose."""

    id: str
    colour: Path
    depth: Path
    T_world_cam: NDArray[np.float64]  # (4, 4) camera -> the recording's world [m]
    stamp: float  # [s], relative to the start or since 1970


@dataclass(frozen=True, slots=True)
class DepthCamera:
    """A depth camera apart from the colour camera: its depth is not registered to colour."""

    intrinsics: Intrinsics
    T_colour_depth: NDArray[np.float64]  # (4, 4) depth camera -> colour camera [m]


@dataclass(frozen=True, slots=True)
class RecordingListing:
    """All entries of a recording, in time order, and the camera of the colour images."""

    entries: tuple[FrameEntry, ...]
    camera: Intrinsics | None  # None = the folder does not say
    depth_scale: float  # depth units a metre, unless the intrinsics or the caller say otherwise
    depth_camera: DepthCamera | None = None  # None = depth is registered to colour


@dataclass(frozen=True, slots=True)
class Format:
    """A layout of files on disk that can be read as a recording."""

    name: str
    looks_for: str  # what makes a folder one of this format, for people
    matches: Callable[[Path], bool]
    read: Callable[[Path], RecordingListing]


def subfolder(folder: Path, *names: str) -> Path:
    """The first of the named folders that is there; raises RecordingError if none is."""
    for name in names:
        if (folder / name).is_dir():
            return folder / name
    raise RecordingError(f"{folder} has no folder {' or '.join(f'{n}/' for n in names)}")
