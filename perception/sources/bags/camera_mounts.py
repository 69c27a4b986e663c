"""Camera mounts: where a camera sits on a robot, by numbers or by the fixed joints of a URDF."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from kg.model.errors import RecordingError
from kg.model.regular_files import read_text
from perception.camera.poses import BODY_FROM_CAMERA, Pose
from perception.number_tables import floats
from perception.sources.ros.image_messages import frame_name
from perception.sources.ros.transform_tree import TransformTree


def add_mount(tree: TransformTree, camera: str, given: str | None) -> None:
    """Add the links that the user gives: of a URDF, or where the camera's body sits on a frame."""
    if given is None:
        return
    frame, _, numbers = given.partition("=")
    if not numbers:
        for parent, child, T in read_mounts(Path(given)):
            tree.link(parent, child, T)
        return
    T = mount(given)
    root = tree.ancestors(camera)[-1]
    T_root_camera = tree.at(root, camera, 0.0)
    if T_root_camera is None or root == frame_name(frame):
        root, T_root_camera = frame_name(camera), np.eye(4)
    tree.link(frame, root, T @ BODY_FROM_CAMERA @ np.linalg.inv(T_root_camera))


def mount(given: str) -> Pose:
    """Pose (4, 4) of the camera's body, x ahead and z up, by FRAME=x,y,z,roll,pitch,yaw [m, rad].

    Raises RecordingError.
    """
    try:
        numbers = [float(word) for word in given.partition("=")[2].split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 6 or not np.isfinite(numbers).all():
        raise RecordingError(
            f"--camera-in {given!r} is no mount; base_link=0.2,0,1.1,0,0,0 is one: a frame, then "
            "x, y, z [m], roll, pitch, yaw [rad] of the camera's body (x ahead, z up); for a bag a "
            "URDF file is another"
        )
    return pose_of_origin(numbers[:3], numbers[3:])


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
        if joint.get("type") == "fixed" and parent is not None and child is not None:
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
