"""A robot with a camera: real frames as the messages that it would record, and changes of these."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.camera.poses import BODY_FROM_CAMERA, Pose, quaternion_from_pose
from perception.inference.recorded_detections import open_detector
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions

BEGIN: Final = 1_700_000_000 * 10**9  # [ns]
STEP: Final = 100_000_000  # [ns] between two frames
EVERY: Final = 5  # of the recording's frames
HALF: Final = 2  # images are scaled down by

COLOUR: Final = "/camera/color/image_raw"
DEPTH: Final = "/camera/aligned_depth_to_color/image_raw"
INFO: Final = "/camera/color/camera_info"
DEPTH_INFO: Final = "/camera/aligned_depth_to_color/camera_info"
OPTICAL: Final = "camera_color_optical_frame"
IMAGE: Final = "sensor_msgs/msg/Image"
COMPRESSED: Final = "sensor_msgs/msg/CompressedImage"
CAMERA_INFO: Final = "sensor_msgs/msg/CameraInfo"
TF: Final = "tf2_msgs/msg/TFMessage"
STATIC: Final = "/tf_static"
ODOMETRY: Final = "nav_msgs/msg/Odometry"
POSE: Final = "geometry_msgs/msg/PoseStamped"
POSE_COVARIANCE: Final = "geometry_msgs/msg/PoseWithCovarianceStamped"
PATH: Final = "nav_msgs/msg/Path"


def pose(x: float, y: float, z: float, yaw: float = 0.0, pitch: float = 0.0) -> Pose:
    """A pose (4, 4) by position [m], yaw and pitch [rad]."""
    c, s, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    T = np.eye(4)
    T[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ [
        [cp, 0, sp],
        [0, 1, 0],
        [-sp, 0, cp],
    ]
    T[:3, 3] = x, y, z
    return T


T_BASE_BODY: Final = pose(0.18, -0.05, 1.1, 0.3, 0.25)  # the camera's body, x ahead
T_BASE_CAM: Final = T_BASE_BODY @ BODY_FROM_CAMERA
T_MAP_ODOM: Final = pose(1.5, -0.7, 0.0, 0.6)
MOUNT: Final = "base_link=0.18,-0.05,1.1,0,0.25,0.3"  # the same for --camera-in: roll, pitch, yaw


@dataclass(frozen=True, slots=True)
class Shot:
    """One frame."""

    stamp: int  # [ns]
    rgb: NDArray[np.uint8]
    depth: NDArray[np.float32]  # [m], nan = no return
    K: NDArray[np.float64]
    T_map_cam: Pose


@dataclass(frozen=True, slots=True)
class Message:
    """A message by the names of its fields, as ROS 2 has them."""

    time: int  # [ns] when recorded
    topic: str
    type: str
    fields: dict[str, Any]


Messages = list[Message]
Change = Callable[[Messages], Messages]


def shots(recording: Path) -> tuple[list[Shot], list[list[Any]]]:
    """Frames of a real recording, half as large, and what the bundled detectors find in each."""
    opened = open_recording(recording, RecordingOptions(check=False))
    detector = open_detector("default", threshold=0.1)
    made, found = list[Shot](), list[list[Any]]()
    for index in range(0, len(opened), EVERY):
        frame = opened.frame(index)
        size = (frame.rgb.shape[1] // HALF, frame.rgb.shape[0] // HALF)
        rgb = cv2.resize(frame.rgb, size, interpolation=cv2.INTER_AREA).astype(np.uint8)
        K = frame.K.copy()
        K[:2] /= HALF
        depth = np.ascontiguousarray(frame.depth[::HALF, ::HALF])
        depth = (np.round(depth * 1000) / 1000).astype(np.float32)
        made.append(Shot(BEGIN + len(made) * STEP, rgb, depth, K, frame.T_map_cam))
        seen = detector.detect(frame)
        found.append(
            [
                [*(float(x) / HALF for x in box), float(score), str(label)]
                for box, score, label in zip(seen.xyxy, seen.score, seen.label, strict=True)
            ]
        )
    return made, found


def write_plain(made: list[Shot], folder: Path) -> Path:
    """The frames as a folder in TUM's layout, and the files that options name."""
    (folder / "rgb").mkdir(parents=True)
    (folder / "depth").mkdir()
    lists: dict[str, list[str]] = {"rgb": [], "depth": [], "groundtruth": []}
    for shot in made:
        name = f"{shot.stamp / 1e9:.6f}"
        cv2.imwrite(str(folder / "rgb" / f"{name}.png"), shot.rgb[:, :, ::-1])
        cv2.imwrite(str(folder / "depth" / f"{name}.png"), millimetres(shot.depth))
        lists["rgb"].append(f"{name} rgb/{name}.png")
        lists["depth"].append(f"{name} depth/{name}.png")
        numbers = [*shot.T_map_cam[:3, 3], *quaternion_from_pose(shot.T_map_cam)]
        lists["groundtruth"].append(" ".join([name, *(f"{n:.9f}" for n in numbers)]))
    for name, lines in lists.items():
        (folder / f"{name}.txt").write_text("\n".join(lines) + "\n")
    K, (height, width) = made[0].K, made[0].depth.shape
    camera = {"fx": K[0, 0], "fy": K[1, 1], "cx": K[0, 2], "cy": K[1, 2]}
    text = json.dumps({**camera, "width": width, "height": height, "depth_scale": 1000})
    (folder / "intrinsics.json").write_text(text)
    (folder / "robot.urdf").write_text(
        '<robot name="r"><link name="base_link"/><link name="camera_link"/>'
        '<joint name="mount" type="fixed"><parent link="base_link"/><child link="camera_link"/>'
        '<origin xyz="0.18 -0.05 1.1" rpy="0 0.25 0.3"/></joint></robot>'
    )
    return folder


def millimetres(depth: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Depth as 16-bit millimetres, 0 = no return."""
    return np.round(np.nan_to_num(depth, nan=0.0) * 1000).astype(np.uint16)


def header(stamp: int, frame: str) -> dict[str, Any]:
    """Fields of a std_msgs/Header."""
    return {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": frame}


def image(stamp: int, frame: str, array: NDArray[Any], encoding: str) -> dict[str, Any]:
    """Fields of a sensor_msgs/Image."""
    data = np.ascontiguousarray(array).view(np.uint8).ravel()
    height, width = array.shape[:2]
    return {
        "header": header(stamp, frame), "height": height, "width": width, "encoding": encoding,
        "is_bigendian": 0, "step": data.size // height, "data": data,
    }  # fmt: skip


def camera_info(stamp: int, frame: str, shot: Shot) -> dict[str, Any]:
    """Fields of a sensor_msgs/CameraInfo."""
    height, width = shot.depth.shape
    P = np.hstack([shot.K, np.zeros((3, 1))])
    return {
        "header": header(stamp, frame), "height": height, "width": width,
        "distortion_model": "plumb_bob", "d": np.zeros(5), "k": shot.K.ravel(),
        "r": np.eye(3).ravel(), "p": P.ravel(),
    }  # fmt: skip


def _numbers(T: Pose, place: str, turn: str) -> dict[str, Any]:
    q = quaternion_from_pose(T)
    return {
        place: dict(zip("xyz", map(float, T[:3, 3]), strict=True)),
        turn: dict(zip("xyzw", map(float, q), strict=True)),
    }


def transform(stamp: int, parent: str, child: str, T: Pose) -> dict[str, Any]:
    """Fields of a tf2_msgs/TFMessage."""
    one = {
        "header": header(stamp, parent), "child_frame_id": child,
        "transform": _numbers(T, "translation", "rotation"),
    }  # fmt: skip
    return {"transforms": [one]}


def odometry(stamp: int, parent: str, child: str, T: Pose) -> dict[str, Any]:
    """Fields of a nav_msgs/Odometry."""
    body = {"pose": _numbers(T, "position", "orientation")}
    return {"header": header(stamp, parent), "child_frame_id": child, "pose": body}


def posed(stamp: int, parent: str, T: Pose) -> dict[str, Any]:
    """Fields of a geometry_msgs/PoseStamped."""
    return {"header": header(stamp, parent), "pose": _numbers(T, "position", "orientation")}


def record(made: Iterable[Shot]) -> Messages:
    """A robot's recording: tf from map over odom and base_link to the camera, colour, depth."""
    said = Messages()
    for number, shot in enumerate(made):
        at = shot.stamp
        T_odom_base = np.linalg.inv(T_MAP_ODOM) @ shot.T_map_cam @ np.linalg.inv(T_BASE_CAM)
        if number == 0:
            links = (("base_link", "camera_link", T_BASE_BODY),
                     ("camera_link", OPTICAL, BODY_FROM_CAMERA))  # fmt: skip
            said += [Message(at, "/tf_static", TF, transform(at, *link)) for link in links]
        said += [
            Message(at, "/tf", TF, transform(at, "odom", "base_link", T_odom_base)),
            Message(at, "/tf", TF, transform(at, "map", "odom", T_MAP_ODOM)),
            Message(at, INFO, CAMERA_INFO, camera_info(at, OPTICAL, shot)),
            Message(at, COLOUR, IMAGE, image(at, OPTICAL, shot.rgb, "rgb8")),
            Message(at, DEPTH_INFO, CAMERA_INFO, camera_info(at, OPTICAL, shot)),
            Message(at, DEPTH, IMAGE, image(at, OPTICAL, millimetres(shot.depth), "16UC1")),
        ]
    return said


def changed(message: Message, **fields: Any) -> Message:
    """The message with other fields."""
    return replace(message, fields=message.fields | fields)


def framed(message: Message, frame: str) -> Message:
    """The message with another frame in its header."""
    return changed(message, header=message.fields["header"] | {"frame_id": frame})


def stamped(message: Message, stamp: int) -> Message:
    """The message with another stamp [ns] in its headers."""
    time = header(stamp, "")["stamp"]
    if message.type == TF:
        links = [
            one | {"header": one["header"] | {"stamp": time}}
            for one in message.fields["transforms"]
        ]
        return changed(message, transforms=links)
    return changed(message, header=message.fields["header"] | {"stamp": time})
