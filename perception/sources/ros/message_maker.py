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

_PNG: Final = [cv2.IMWRITE_PNG_COMPRESSION, 1]


@dataclass(slots=True)
class MessageMaker:
    """Makes messages of a `rosbags` typestore."""

    types: Any
    is_ros1: bool
    number: int = 0  # in headers of ROS 1

    def make(self, kind: str, **fields: Any) -> Any:
        """A message of a type with all its fields."""
        return self.types.types[kind](**fields)

    def header(self, stamp: int, frame: str) -> Any:
        """std_msgs/Header of a stamp [ns]."""
        number = {"seq": self.number} if self.is_ros1 else {}
        return self.make("std_msgs/msg/Header", stamp=self.time(stamp), frame_id=frame, **number)

    def time(self, stamp: int) -> Any:
        """A stamp [ns] as a message."""
        sec, nanosec = divmod(stamp, NANOSECONDS)
        return self.make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)

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
            is_bigendian=0,
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
        region = self.make(
            "sensor_msgs/msg/RegionOfInterest",
            x_offset=0, y_offset=0, height=0, width=0, do_rectify=False,
        )  # fmt: skip
        return self.make(
            "sensor_msgs/msg/CameraInfo",
            header=header,
            height=shape[0],
            width=shape[1],
            distortion_model="plumb_bob",
            binning_x=0,
            binning_y=0,
            roi=region,
            **numbers,
        )

    def acceleration(self, a: Sequence[float], header: Any) -> Any:
        """sensor_msgs/Imu with an acceleration (3,) [m/s^2] alone."""
        vector, unknown = "geometry_msgs/msg/Vector3", np.full(9, -1.0)
        return self.make(
            "sensor_msgs/msg/Imu",
            header=header,
            orientation=self.make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
            orientation_covariance=unknown,
            angular_velocity=self.make(vector, x=0.0, y=0.0, z=0.0),
            angular_velocity_covariance=unknown,
            linear_acceleration=self.make(vector, **dict(zip("xyz", a, strict=True))),
            linear_acceleration_covariance=np.zeros(9),
        )

    def transforms(self, stamp: int, parent: str, child: str, T: Pose) -> Any:
        """tf2_msgs/TFMessage with one transform (4, 4), of `child` to `parent` coordinates."""
        x, y, z, w = (float(n) for n in quaternion_from_pose(T))
        tx, ty, tz = (float(n) for n in T[:3, 3])
        transform = self.make(
            "geometry_msgs/msg/Transform",
            translation=self.make("geometry_msgs/msg/Vector3", x=tx, y=ty, z=tz),
            rotation=self.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w),
        )
        stamped = self.make(
            "geometry_msgs/msg/TransformStamped",
            header=self.header(stamp, parent),
            child_frame_id=child,
            transform=transform,
        )
        return self.make("tf2_msgs/msg/TFMessage", transforms=[stamped])


def whole_millimetres(depth: NDArray[np.float32]) -> NDArray[np.uint16] | None:
    """Depth (H, W) [m] as uint16 [mm], 0 = no return; None where that would not give it back."""
    scaled = np.rint(np.nan_to_num(depth, nan=0.0) * MILLIMETRES)
    if scaled.min() < 0 or scaled.max() >= np.iinfo(np.uint16).max:
        return None
    raw = scaled.astype(np.uint16)
    return raw if np.array_equal(metres(raw, MILLIMETRES), depth, equal_nan=True) else None
