"""RealSense cameras by librealsense: a device, or a recording of one (.db3) that is played.

Both are opened sensor by sensor, and their frames become ROS' messages. So all else is as for
topics: colour and depth are paired by their stamps, depth is projected into the colour camera by
the places of the sensors, and an accelerometer at rest tells up.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from kg.model.errors import RecordingError
from kg.model.regular_files import check_regular
from perception.sources.bags.bag_file import MAX_FILE, RawMessage
from perception.sources.bags.bag_index import CAMERA, IMAGES, TRANSFORMS
from perception.sources.bags.bag_poses import IMU
from perception.sources.live.connection import Inbox
from perception.sources.ros.message_maker import MessageMaker
from perception.sources.ros.message_types import serialised

QUEUED: Final = 64  # frames of all sensors that wait to become messages
SILENT: Final = 1.0  # [s] without a frame, after which the camera may be gone
RATE: Final = 30  # images a second, or the next to it
SIZE: Final = (640, 480)  # [px] of images, or the next to it
#: streams that are read, each with its formats, the best first
FORMATS: Final = {
    "color": ("rgb8", "bgr8", "rgba8", "bgra8", "yuyv", "uyvy"),
    "depth": ("z16",),
    "accel": ("motion_xyz32f",),
}
TOPICS: Final = {
    "/tf_static": TRANSFORMS[0],
    "/color/camera_info": CAMERA,
    "/color/image_raw": IMAGES[0],
    "/depth/camera_info": CAMERA,
    "/depth/image_raw": IMAGES[0],
    "/accel/imu": IMU,
}


@dataclass(frozen=True, slots=True)
class RealSenseCamera:
    """A camera with colour and depth, or a recording of one."""

    address: str  # "realsense", "realsense:SERIAL" or "realsense:FILE.db3"
    context: Any  # of librealsense, which knows the device
    device: Any
    streams: dict[str, tuple[int, Any]]  # sensor's number and profile, by a name of FORMATS

    @classmethod
    def at(cls, address: str) -> RealSenseCamera:
        """The camera at an address; raises RecordingError."""
        import pyrealsense2 as rs

        context = rs.context()
        with _errors(address):
            device = _device(context, address.partition(":")[2], rs.camera_info.serial_number)
        return cls.of(address, context, device)

    @classmethod
    def of(cls, address: str, context: Any, device: Any) -> RealSenseCamera:
        """The camera that is a device; raises RecordingError where it has no colour and depth."""
        with _errors(address):
            found = [
                (number, profile, profile.stream_type().name)
                for number, sensor in enumerate(device.query_sensors())
                for profile in sensor.get_stream_profiles()
            ]
            usable = [one for one in found if one[1].format().name in FORMATS.get(one[2], ())]
            usable.sort(key=lambda one: _rank(one[1], FORMATS[one[2]]))
        streams = {kind: (number, profile) for number, profile, kind in reversed(usable)}
        if not {"color", "depth"} <= streams.keys():
            named = ", ".join(sorted({kind for _, _, kind in found})) or "none"
            raise RecordingError(f"{address} has no colour with depth; its streams: {named}")
        return cls(address, context, device, streams)

    def run(self, inbox: Inbox, ended: threading.Event) -> None:
        """Pass messages to `inbox` until `ended`, or until the recording has been played.

        Raises RecordingError where the camera cannot be started, or is unplugged.
        """
        import pyrealsense2 as rs

        queue, sensors = rs.frame_queue(QUEUED), self.device.query_sensors()
        has_imu = "accel" in self.streams
        used = sorted({number for number, _ in self.streams.values()})
        inbox.wanted({t: type_ for t, type_ in TOPICS.items() if type_ != IMU or has_imu})
        try:
            with _errors(self.address):
                unit = sensors[self.streams["depth"][0]].get_option(rs.option.depth_units)
                for number in used:
                    sensors[number].open([p for at, p in self.streams.values() if at == number])
                for number in used:
                    sensors[number].start(queue)
                messages = _Messages(self.streams, unit)
                for frame in self._frames(queue, ended):
                    for raw in messages.of(frame):
                        inbox.offer(raw, is_ros1=False)
        finally:
            for number in used:
                for end in (sensors[number].stop, sensors[number].close):
                    with contextlib.suppress(RuntimeError):  # not started, or unplugged
                        end()

    def _frames(self, queue: Any, ended: threading.Event) -> Iterator[Any]:
        last = time.monotonic()
        while not ended.is_set():
            came, frame = queue.try_wait_for_frame(100)
            if came:
                yield from frame.as_frameset() if frame.is_frameset() else (frame,)
            elif time.monotonic() < last + SILENT:
                continue
            elif not self.context.query_devices().contains(self.device):
                raise RecordingError(f"{self.address}: the camera was unplugged")
            elif self.device.is_playback() and _is_played(self.device.as_playback()):
                return
            last = time.monotonic()


class _Messages:
    """ROS' messages of frames."""

    def __init__(self, streams: dict[str, tuple[int, Any]], unit: float) -> None:
        self._profiles = {kind: profile for kind, (_, profile) in streams.items()}
        self._unit = np.float32(unit)  # [m] of depth
        self._make = MessageMaker(is_ros1=False)
        self._described = set[str]()  # streams whose camera and place were sent

    def of(self, frame: Any) -> Iterator[RawMessage]:
        """Messages of a frame; before a stream's first, also its camera and place."""
        kind = frame.profile.stream_type().name
        stamp = round(frame.timestamp * 1e6)  # of milliseconds
        header = self._make.header(stamp, kind)
        if kind not in self._described:
            self._described.add(kind)
            yield from self._description(kind, stamp, header)
        if kind == "accel":
            a = frame.as_motion_frame().get_motion_data()
            imu = self._make.acceleration((a.x, a.y, a.z), header)
            yield self._raw("/accel/imu", stamp, imu)
            return
        pixels, encoding = np.asanyarray(frame.get_data()), frame.profile.format().name
        if kind == "depth":
            pixels, encoding = pixels.astype(np.float32) * self._unit, "32FC1"
        image = self._make.image(pixels, encoding, header)
        yield self._raw(f"/{kind}/image_raw", stamp, image)

    def _description(self, kind: str, stamp: int, header: Any) -> Iterator[RawMessage]:
        if kind != "color":
            T, parent = np.eye(4), "color"
            try:
                place = self._profiles[kind].get_extrinsics_to(self._profiles["color"])
                T[:3, :3] = np.reshape(place.rotation, (3, 3)).T  # listed column by column
                T[:3, 3] = place.translation
            except RuntimeError:  # recordings lack it of an accelerometer, which has depth's axes
                parent = "depth" if kind == "accel" else "nowhere"
            placed = self._make.transforms(stamp, parent, kind, T)
            yield self._raw("/tf_static", stamp, placed)
        if kind != "accel":
            camera = self._profiles[kind].as_video_stream_profile().get_intrinsics()
            K = np.array([[camera.fx, 0, camera.ppx], [0, camera.fy, camera.ppy], [0, 0, 1.0]])
            shape = camera.height, camera.width
            info = self._make.camera_info(K, shape, header, camera.coeffs)
            yield self._raw(f"/{kind}/camera_info", stamp, info)

    def _raw(self, topic: str, stamp: int, message: Any) -> RawMessage:
        data = serialised(TOPICS[topic], message, is_ros1=False)
        return RawMessage(topic, TOPICS[topic], stamp, data)


def _device(context: Any, which: str, number: Any) -> Any:
    """A device by its serial number, of a file, or, by "", the first; raises RecordingError."""
    there = {d.get_info(number): d for d in context.query_devices() if d.supports(number)}
    if which in there or (there and not which):
        return there.get(which) or next(iter(there.values()))
    if not which:
        raise RecordingError(
            "no RealSense camera is connected; realsense:FILE.db3 plays a recording of one"
        )
    try:
        check_regular(Path(which), MAX_FILE)
    except OSError as error:
        raise RecordingError(
            f"{which} is neither a file ({error.strerror}) nor the serial number of a camera; "
            f"connected: {', '.join(there) or 'none'}"
        ) from error
    with _errors(f"{which} is no .db3 of librealsense"):
        return context.load_device(which)


def _is_played(file: Any) -> bool:
    return bool(file.current_status().name == "stopped")


def _rank(profile: Any, formats: tuple[str, ...]) -> tuple[float, ...]:
    """Smaller for a better profile: by its format, its rate, its size."""
    rank = formats.index(profile.format().name), abs(profile.fps() - RATE)
    if not profile.is_video_stream_profile():
        return rank
    video = profile.as_video_stream_profile()
    return (*rank, abs(video.width() - SIZE[0]) + abs(video.height() - SIZE[1]))


@contextlib.contextmanager
def _errors(where: str) -> Iterator[None]:
    """Turn errors of librealsense into a RecordingError of one line."""
    try:
        yield
    except RuntimeError as error:
        reason = " ".join(str(error).split())[:300]
        raise RecordingError(f"{where}: {reason or 'librealsense does not say why'}") from error
