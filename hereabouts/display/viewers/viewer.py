"""Viewers take scenes, camera frames, robot poses and remarks, and draw or record them."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, Protocol

import numpy as np

from hereabouts.display.viewers.scene import Scene
from kg.model.errors import PictureError
from kg.model.records import RobotRecord
from perception.frames import Detections, Frame

#: frames of reference: the map's, the robot's (its heading along x), the camera's (z forwards)
MAP: Final = "map"
ROBOT: Final = "robot"
CAMERA: Final = "camera"
#: [s] maximum error of a map's times, which are whole seconds
ROUNDING: Final = 1.0
#: [s] maximum time between flushes of a file
FLUSHED: Final = 5.0
#: [m] side of an object's marker
MARKER: Final = 0.12
#: [m] height of text
TEXT: Final = 0.16
#: [m] between surfaces that would coincide
SURFACE: Final = 0.02
#: opacity of the floors of places, which lie on the occupancy floor
TINT: Final = 0.55


class Viewer(Protocol):
    """Draws or records a map. Stamps are [s] since 1970; every method may raise PictureError."""

    def show(self, scene: Scene, stamp: float) -> None:
        """Draw a scene; unchanged parts need not be written again."""

    def frame(self, frame: Frame, detections: Detections) -> None:
        """Draw a camera frame with its detections."""

    def robot(self, robot: RobotRecord) -> None:
        """Draw the robot at its pose."""

    def remark(self, text: str, stamp: float) -> None:
        """Keep a line of text."""

    def close(self) -> None:
        """Write the rest. Closing twice is allowed."""


class ViewerGroup:
    """Several viewers as one. A viewer that fails is dropped; `close` raises its error."""

    def __init__(self, viewers: Iterable[Viewer]) -> None:
        self._viewers = list(viewers)
        self._failure: PictureError | None = None

    def show(self, scene: Scene, stamp: float) -> None:
        """As `Viewer`."""
        self._each(lambda viewer: viewer.show(scene, stamp))

    def frame(self, frame: Frame, detections: Detections) -> None:
        """As `Viewer`."""
        self._each(lambda viewer: viewer.frame(frame, detections))

    def robot(self, robot: RobotRecord) -> None:
        """As `Viewer`."""
        self._each(lambda viewer: viewer.robot(robot))

    def remark(self, text: str, stamp: float) -> None:
        """As `Viewer`."""
        self._each(lambda viewer: viewer.remark(text, stamp))

    def close(self) -> None:
        """Close all; raises PictureError if one failed, now or before."""
        self._each(lambda viewer: viewer.close())
        self._viewers.clear()
        failure, self._failure = self._failure, None
        if failure is not None:
            raise failure

    def _each(self, call: Callable[[Viewer], None]) -> None:
        for viewer in tuple(self._viewers):
            try:
                call(viewer)
            except PictureError as error:
                self._viewers.remove(viewer)
                self._failure = self._failure or error


def require(module: str, extra: str) -> None:
    """Raise PictureError if `module` of the extra `extra` is not installed."""
    if importlib.util.find_spec(module) is None:
        raise PictureError(f"this needs the package {module}: pip install 'hereabouts[{extra}]'")


def check_new_file(path: Path) -> None:
    """Raise PictureError if no new file can be made at `path`."""
    if path.exists() or path.is_symlink():
        raise PictureError(f"{path} exists; give the name of a new file")
    if not path.parent.is_dir():
        raise PictureError(f"cannot write {path}: there is no folder {path.parent}")
    if not os.access(path.parent, os.W_OK):
        raise PictureError(f"cannot write {path}: the folder is read-only")


@contextmanager
def picture_errors(path: Path) -> Iterator[None]:
    """Turn errors of the operating system or a writer into a PictureError about `path`."""
    try:
        yield
    except (OSError, RuntimeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise PictureError(f"cannot write {path}: {reason}") from error


def heading_quaternion(heading: float) -> tuple[float, float, float, float]:
    """(x, y, z, w) of a turn by `heading` [rad] about z."""
    return 0.0, 0.0, float(np.sin(heading / 2)), float(np.cos(heading / 2))
