"""Messages of frames: images to the last bit, cameras, transforms; of ROS 1 or ROS 2.

Colour is a PNG; depth is in millimetres where it is whole millimetres, else in floats.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from perception.camera.image_decoding import MILLIMETRES, metres
from perception.camera.poses import Pose, quaternion_from_pose
from perception.frames import Frame
from perception.sources.ros.image_messages import NANOSECONDS
from perception.sources.ros.message_types import made

_PNG: Final = [cv2.IMWRITE_PNG_COMPRESSION, 1]


@dataclass(slots=True)
class MessageMaker:
    """Makes messages of ROS 1 or ROS 2."""

    is_ros1: bool
    number: int = 0  # in headers of ROS 1

    def make(self, kind: str, **fields: Any) -> Any:
        """A message of a type; parts may be dictionaries, and all other fields are 0 or empty."""
        return made(kind, fields, is_ros1=self.is_ros1)

    def header(self, stamp: int, frame: str) -> dict[str, Any]:
        """std_msgs/Header of a stamp [ns]."""
        number = {"seq": self.number} if self.is_ros1 else {}
        return {"stamp": self.time(stamp), "frame_id": frame, **number}

    def time(self, stamp: int) -> dict[str, int]:
        """A stamp [ns]."""
        sec, nanosec = divmod(stamp, NANOSECONDS)
        return {"sec": sec, "nanosec": nanosec}

    def colour(self, frame: Frame, header: Any) -> Any:
        """sensor_msgs/CompressedImage of a frame's colour."""
        encoded, png = cv2.imencode(".png", np.ascontiguousarray(frame.rgb[:, :, ::-1]), _PNG)
        if not encoded:
            raise RecordingError(f"frame {frame.id} cannot be encoded")
        return self.make(
            "sensor_msgs/msg/CompressedImage",
            header=header,
            format="rgb8; png compressed bgr8",
            data=png.ravel(),
        )

    def depth(self, depth: NDArray[np.float32], header: Any) -> Any:
        """sensor_msgs/Image of depth (H, W) [m]."""
        whole = whole_millimetres(depth)
        if whole is None:
            return self.image(depth, "32FC1", header)
        return self.image(whole, "16UC1", header)

    def image(self, pixels: NDArray[Any], encoding: str, header: Any) -> Any:
        """sensor_msgs/Image of pixels (H, W) or (H, W, C)."""
        little = np.ascontiguousarray(pixels, pixels.dtype.newbyteorder("<"))
        return self.make(
            "sensor_msgs/msg/Image",
            header=header,
            height=pixels.shape[0],
            width=pixels.shape[1],
            encoding=encoding,
            step=little[0].nbytes,
            data=little.view(np.uint8).ravel(),
        )

    def camera_info(
        self,
        K: NDArray[np.float64],
        shape: tuple[int, ...],
        header: Any,
        dist: Sequence[float] = (0.0,) * 5,
    ) -> Any:
        """sensor_msgs/CameraInfo of K (3, 3) [px] and images of `shape` (H, W) [px].

        `dist` are the coefficients k1 k2 p1 p2 k3 of distortion.
        """
        P = np.hstack([K, np.zeros((3, 1))])
        numbers = {"d": np.array(dist), "k": K.ravel(), "r": np.eye(3).ravel(), "p": P.ravel()}
        if self.is_ros1:
            numbers = {name.upper(): array for name, array in numbers.items()}
        return self.make(
            "sensor_msgs/msg/CameraInfo",
            header=header,
            height=shape[0],
            width=shape[1],
            distortion_model="plumb_bob",
            **numbers,
        )

    def acceleration(self, a: Sequence[float], header: Any) -> Any:
        """sensor_msgs/Imu with an acceleration (3,) [m/s^2] alone."""
        unknown = np.full(9, -1.0)
        return self.make(
            "sensor_msgs/msg/Imu",
            header=header,
            orientation={"w": 1.0},
            orientation_covariance=unknown,
            angular_velocity_covariance=unknown,
            linear_acceleration=dict(zip("xyz", a, strict=True)),
        )

    def transforms(self, stamp: int, parent: str, child: str, T: Pose) -> Any:
        """tf2_msgs/TFMessage with one transform (4, 4), of `child` to `parent` coordinates."""
        turned = dict(zip("xyzw", map(float, quaternion_from_pose(T)), strict=True))
        moved = dict(zip("xyz", map(float, T[:3, 3]), strict=True))
        stamped = {
            "header": self.header(stamp, parent),
            "child_frame_id": child,
            "transform": {"translation": moved, "rotation": turned},
        }
        return self.make("tf2_msgs/msg/TFMessage", transforms=[stamped])


def whole_millimetres(depth: NDArray[np.float32]) -> NDArray[np.uint16] | None:
    """Depth (H, W) [m] as uint16 [mm], 0 = no return; None where that would not give it back."""
    scaled = np.rint(np.nan_to_num(depth, nan=0.0) * MILLIMETRES)
    if scaled.min() < 0 or scaled.max() >= np.iinfo(np.uint16).max:
        return None
    raw = scaled.astype(np.uint16)
    return raw if np.array_equal(metres(raw, MILLIMETRES), depth, equal_nan=True) else None
