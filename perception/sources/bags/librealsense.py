"""Files of librealsense's own recorder and of the RealSense Viewer, from version 2.58 on (.db3).

Images, cameras and the sensors' places are ROS' messages. The rest is text (`std_msgs/String`): the
clock of the camera, since headers have the time of arrival; metres a unit of depth; and the cameras
of files that were converted from an older .bag. Found in files that pyrealsense2 2.59 wrote.
"""

from __future__ import annotations

import re
from array import array
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from perception.sources.ros.image_messages import NANOSECONDS

_SENSOR: Final = r"/device_\d+/sensor_\d+"
IMAGE: Final = re.compile(rf"({_SENSOR}/[^/]+)/image/data(/compressed|/compressedDepth)?")
TEXT: Final = re.compile(
    rf"({_SENSOR}/[^/]+)/(image/metadata|camera_info)|({_SENSOR}/option)/Depth_Units/value"
)
CLOCKS_APART: Final = 0.5  # [s] between two sensors' clocks, which then are not compared


@dataclass(slots=True)
class LibrealsenseText:
    """Text of such a file that concerns its images."""

    captured: dict[str, dict[int, int]] = field(default_factory=dict)  # by sensor: arrival [ns]
    units: list[float] = field(default_factory=list)  # [m] of depth
    cameras: dict[str, SimpleNamespace] = field(default_factory=dict)  # by sensor, as CameraInfo

    def add(self, topic: str, time: int, text: str) -> None:
        """Add a message that was recorded at `time` [ns]; what makes no sense is left out."""
        found = TEXT.fullmatch(topic)
        if found is None:
            return
        sensor, kind, _ = found.groups()
        values = dict(one.split("=", 1) for one in text.split(";") if "=" in one)
        try:
            if kind == "image/metadata":
                captured = round(float(values["timestamp"]) * 1e6)
                self.captured.setdefault(sensor, {})[time] = captured
            elif kind == "camera_info":
                self.cameras[sensor] = _camera(values)
            elif float(text) > 0:
                self.units.append(float(text))
        except (KeyError, ValueError, OverflowError):
            return

    @property
    def depth_scale(self) -> float | None:
        """Depth units a metre; None where the file has none, or several."""
        different = {round(unit, 9) for unit in self.units}
        return 1 / different.pop() if len(different) == 1 else None

    def stamps(self, times: dict[str, array[int]]) -> dict[str, array[int]]:
        """Stamps [ns] of images by the camera's clock, moved to begin as they arrived.

        By sensor, as `times` [ns] of arrival; empty where sensors have clocks of their own.
        """
        late = dict[str, NDArray[np.int64]]()
        for sensor, arrived in times.items():
            captured = self.captured.get(sensor, {})
            if not arrived or not all(time in captured for time in arrived):
                return {}
            late[sensor] = np.array([captured[time] - time for time in arrived])
        middles = [float(np.median(one)) for one in late.values()]
        if not late or max(middles) - min(middles) > CLOCKS_APART * NANOSECONDS:
            return {}
        first = min(int(one.min()) for one in late.values())
        return {
            sensor: array("q", (self.captured[sensor][time] - first for time in arrived))
            for sensor, arrived in times.items()
        }


def _camera(values: dict[str, str]) -> SimpleNamespace:
    """A camera in words, as a CameraInfo."""
    fx, fy, cx, cy = (float(values[name]) for name in ("fx", "fy", "ppx", "ppy"))
    return SimpleNamespace(
        width=int(values["width"]),
        height=int(values["height"]),
        distortion_model="plumb_bob",
        d=[float(one) for one in values["coeffs"].split(",")],
        k=[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        p=[],
        roi=SimpleNamespace(width=0, height=0),
    )
