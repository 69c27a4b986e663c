"""Up of a camera, from the accelerometer of an IMU that is at rest."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from perception.sources.bags.bag_file import BagFile
from perception.sources.bags.bag_index import BagIndex, Stream
from perception.sources.ros.headers import NANOSECONDS, frame_name, nanoseconds
from perception.sources.ros.transform_tree import TransformTree

IMU: Final = "sensor_msgs/msg/Imu"
GRAVITY: Final = 9.81  # [m/s^2]
OFF: Final = 0.4  # [m/s^2] from gravity, of the mean acceleration of a camera at rest ...
SHAKEN: Final = 0.3  # [m/s^2] ... and its standard deviation along any axis
AROUND: Final = 0.5  # [s] before and after the image
MAX_NAME: Final = 256  # characters of a frame
MIN_MESSAGES: Final = 10
MAX_MESSAGES: Final = 2000


class Reading(NamedTuple):
    """Reading of an IMU: the acceleration in a frame at a time."""

    stamp: int  # [ns]
    frame: str
    acceleration: tuple[float, float, float]  # [m/s^2]

    @classmethod
    def of(cls, message: Any) -> Reading:
        """The reading of a sensor_msgs/Imu."""
        a, header = message.linear_acceleration, message.header
        return cls(nanoseconds(header), frame_name(header.frame_id)[:MAX_NAME], (a.x, a.y, a.z))


def up_of_camera(index: BagIndex, colour: Stream, stamp: float) -> NDArray[np.float64] | None:
    """Up (3,) in the colour camera at its first `stamp` [s]; None where no IMU tells it.

    The IMU is one that transforms link to the camera; it has to be at rest then.
    """
    path = Path(index.path)
    topics = [name for name, (kind, _) in sorted(index.others.items()) if kind == IMU]
    if not topics or not path.exists():
        return None
    tree = index.trees.get(index.robot(colour.topic), index.tree)
    begin = int((stamp - AROUND) * NANOSECONDS)
    with BagFile(path) as bag:
        for topic in topics:
            raws = itertools.islice(bag.messages({topic}, start=begin), MAX_MESSAGES)
            readings = (Reading.of(bag.decoded(raw)) for raw in raws)
            up = up_by_imu(readings, tree, colour.frame, stamp)
            if up is not None:
                return up
    return None


def up_by_imu(
    readings: Iterable[Reading], tree: TransformTree, camera: str, stamp: float
) -> NDArray[np.float64] | None:
    """Up (3,) in the frame `camera` at a `stamp` [s], by one IMU's readings.

    None where the IMU is not at rest then, or `tree` does not link it to the camera.
    """
    frame, found = "", list[tuple[float, float, float]]()
    try:
        for one in readings:
            if one.stamp > (stamp + AROUND) * NANOSECONDS:
                break
            if one.stamp >= (stamp - AROUND) * NANOSECONDS:
                frame = one.frame
                found.append(one.acceleration)
        T = np.eye(4) if frame == camera else tree.at(camera, frame, stamp)
    except RecordingError:  # damaged messages, or an IMU that is not mounted on the camera
        return None
    accelerations = np.array(found, np.float64).reshape(-1, 3)
    if T is None or not _is_at_rest(accelerations):
        return None
    up: NDArray[np.float64] = T[:3, :3] @ accelerations.mean(axis=0)
    return up / np.linalg.norm(up)


def _is_at_rest(accelerations: NDArray[np.float64]) -> bool:
    """Whether accelerations are those of gravity alone."""
    return (
        len(accelerations) >= MIN_MESSAGES
        and bool(np.isfinite(accelerations).all())
        and abs(float(np.linalg.norm(accelerations.mean(axis=0))) - GRAVITY) < OFF
        and float(accelerations.std(axis=0).max()) < SHAKEN
    )
