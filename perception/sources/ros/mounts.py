"""Mounts: fixed joints of a URDF as transforms."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

import numpy as np

from kg.model.errors import RecordingError
from kg.model.regular_files import read_text
from perception.camera.poses import Pose
from perception.number_tables import floats

STILL: Final = ("fixed",)


def read_mounts(path: Path) -> list[tuple[str, str, Pose]]:
    """Parent, child and pose (4, 4) of the child in it, of each fixed joint.

    Raises RecordingError for what is no URDF.
    """
    try:
        text = read_text(path)
        if "<!" in text.replace("<!--", ""):
            raise RecordingError(f"{path} is no URDF: it declares entities")
        robot = ElementTree.fromstring(text)
    except OSError as error:
        raise RecordingError(
            f"cannot read {path}: {error.strerror}; --camera-in takes a URDF file, or "
            "base_link=X,Y,Z,ROLL,PITCH,YAW"
        ) from error
    except (ElementTree.ParseError, ValueError) as error:
        raise RecordingError(f"{path} is no URDF: {error}") from error
    found = []
    for joint in robot.iter("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if joint.get("type") in STILL and parent is not None and child is not None:
            origin = joint.find("origin")
            T = np.eye(4) if origin is None else _origin(origin, str(path))
            found.append((parent.get("link", ""), child.get("link", ""), T))
    if not found:
        raise RecordingError(f"{path} has no fixed joints, which would say where the camera sits")
    return found


def _origin(element: ElementTree.Element, where: str) -> Pose:
    halves = [floats((element.get(name) or "0 0 0").split(), where) for name in ("xyz", "rpy")]
    if any(len(half) != 3 for half in halves):
        raise RecordingError(f"{where}: an origin has three numbers in xyz and in rpy")
    return pose_of_origin(*halves)


def pose_of_origin(xyz: Sequence[float], rpy: Sequence[float]) -> Pose:
    """Pose (4, 4) by a translation [m] and roll, pitch, yaw [rad], turned about fixed axes."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    T = np.eye(4)
    T[:3, :3] = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    T[:3, 3] = xyz
    return T
