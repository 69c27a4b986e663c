"""Recordings of librealsense's own recorder, from a device in software."""

import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.camera.poses import Pose

#: takes the coordinates of a depth camera that squints beside its colour camera to colour's
T_COLOUR_DEPTH = np.eye(4)
T_COLOUR_DEPTH[:3, :3] = cv2.Rodrigues(np.deg2rad([4.0, -9.0, 6.0]))[0]
T_COLOUR_DEPTH[:3, 3] = (0.06, 0.01, -0.02)  # [m]
UNIT = 0.0005  # [m] of depth
STEP = 0.1  # [s] between frames by the camera's clock
START = 50.0  # [s] of the first frame by that clock
READINGS = 10  # of the accelerometer with each frame


def record(
    path: Path,
    images: Iterable[tuple[NDArray[np.uint8], NDArray[np.float32]]],
    K: NDArray[np.float64],
    *,
    T_colour_depth: Pose | None = None,
    pause: float = 0.02,
    accelerations: Sequence[Sequence[float]] = (),
    streams: Sequence[str] = ("depth", "color", "accel"),
) -> None:
    """Write images, RGB (H, W, 3) and depth (H, W) [m, nan = no return], of one camera matrix.

    `T_colour_depth` (4, 4) takes depth's coordinates to colour's, `pause` [s] is the time between
    frames as they are played, `accelerations` [m/s^2] are repeated, in depth's axes.
    """
    import pyrealsense2 as rs

    shots = list(images)
    streams = [name for name in streams if name != "accel" or accelerations]
    made = SoftwareCamera(rs, K, shots[0][1].shape, streams, T_colour_depth)
    recorder, queue = rs.recorder(str(path), made.device), rs.frame_queue(1)
    for sensor, profile in zip(recorder.query_sensors(), made.profiles.values(), strict=True):
        sensor.open(profile)
        sensor.start(queue)
    for number, (rgb, depth) in enumerate(shots):
        for one in range(READINGS * number, READINGS * (number + 1)) if accelerations else ():
            made.read(accelerations[one % len(accelerations)], one)
            time.sleep(pause / READINGS)
        made.see("depth", np.rint(np.nan_to_num(depth) / UNIT).astype(np.uint16), number)
        made.see("color", np.ascontiguousarray(rgb), number)
        time.sleep(0 if accelerations else pause)
    for sensor in recorder.query_sensors():
        sensor.stop()
        sensor.close()
    del recorder


class SoftwareCamera:
    """A device in software, with a sensor for each stream; an accelerometer has depth's axes."""

    def __init__(self, rs, K, shape, streams, T_colour_depth):
        self.rs, self.device = rs, rs.software_device()
        self.device.register_info(rs.camera_info.serial_number, "0123456789")
        self.profiles, self._sensors = dict[str, Any](), dict[str, Any]()
        for number, name in enumerate(streams, 1):
            sensor = self._sensors[name] = self.device.add_sensor(f"{name} sensor")
            if name == "depth":
                sensor.add_read_only_option(rs.option.depth_units, UNIT)
            if name == "accel":
                self.profiles[name] = sensor.add_motion_stream(_motion_stream(rs))
                continue
            stream = _video_stream(rs, name, number, K, shape)
            self.profiles[name] = sensor.add_video_stream(stream)
        for name in self.profiles if "color" in self.profiles else ():
            if name != "color":
                beside = rs.extrinsics()
                T = np.eye(4) if T_colour_depth is None else T_colour_depth
                beside.rotation = T[:3, :3].T.ravel().tolist()  # column by column
                beside.translation = T[:3, 3].tolist()
                self.profiles[name].register_extrinsics_to(self.profiles["color"], beside)

    def see(self, name: str, image: NDArray[Any], number: int) -> None:
        """Give an image of a stream, where there is such a stream."""
        if name in self.profiles:
            frame = self.rs.software_video_frame()
            frame.pixels, frame.bpp = image, image[0, 0].nbytes
            frame.stride = image[0].nbytes
            profile = self.profiles[name].as_video_stream_profile()
            self._sensors[name].on_video_frame(self._stamped(frame, profile, number, 1))

    def read(self, acceleration: Sequence[float], number: int) -> None:
        """Give a reading of the accelerometer."""
        frame, vector = self.rs.software_motion_frame(), self.rs.vector()
        vector.x, vector.y, vector.z = (float(x) for x in acceleration)
        frame.data = vector
        profile = self.profiles["accel"].as_motion_stream_profile()
        self._sensors["accel"].on_motion_frame(self._stamped(frame, profile, number, READINGS))

    def _stamped(self, frame: Any, profile: Any, number: int, a_step: int) -> Any:
        frame.timestamp = 1000 * (START + STEP * number / a_step)
        frame.domain = self.rs.timestamp_domain.global_time
        frame.frame_number, frame.profile = number + 1, profile
        return frame


def _video_stream(rs, name, number, K, shape):
    stream, camera = rs.video_stream(), rs.intrinsics()
    camera.height, camera.width = shape
    camera.fx, camera.fy, camera.ppx, camera.ppy = K[0, 0], K[1, 1], K[0, 2], K[1, 2]
    camera.model, camera.coeffs = rs.distortion.brown_conrady, [0.0] * 5
    stream.height, stream.width = shape
    stream.type = getattr(rs.stream, name)
    stream.fmt, stream.bpp = (rs.format.z16, 2) if name == "depth" else (rs.format.rgb8, 3)
    stream.index, stream.uid, stream.fps, stream.intrinsics = 0, number, 30, camera
    return stream


def _motion_stream(rs: Any) -> Any:
    stream = rs.motion_stream()
    stream.type, stream.fmt = rs.stream.accel, rs.format.motion_xyz32f
    stream.index, stream.uid, stream.fps = 0, 9, 100
    stream.intrinsics = rs.motion_device_intrinsic()
    return stream
