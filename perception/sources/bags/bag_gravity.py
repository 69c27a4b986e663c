"""Up of a bag's first camera, from the accelerometer of an IMU that is at rest."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from perception.sources.bags.bag_file import BagFile
from perception.sources.bags.bag_index import BagIndex, Stream
from perception.sources.ros.headers import NANOSECONDS, frame_name, nanoseconds

IMU: Final = "sensor_msgs/msg/Imu"
GRAVITY: Final = 9.81  # [m/s^2]
OFF: Final = 0.4  # [m/s^2] from gravity, of the mean acceleration of a camera at rest ...
SHAKEN: Final = 0.3  # [m/s^2] ... and its standard deviation along any axis
AROUND: Final = 0.5  # [s] before and after the first image
MIN_MESSAGES: Final = 10
MAX_MESSAGES: Final = 2000


def up_of_camera(index: BagIndex, colour: Stream, stamp: float) -> NDArray[np.float64] | None:
    """Up (3,) in the colour camera at its first `stamp` [s]; None where no IMU tells it.

    The IMU is one that transforms link to the camera; it has to be at rest then.
    """
    path = Path(index.path)
    topics = [name for name, (kind, _) in sorted(index.others.items()) if kind == IMU]
    if not topics or not path.exists():
        return None
    tree = index.trees.get(index.robot(colour.topic), index.tree)
    with BagFile(path) as bag:
        for topic in topics:
            try:
                frame, accelerations = _accelerations(bag, topic, stamp)
                T = np.eye(4) if frame == colour.frame else tree.at(colour.frame, frame, stamp)
            except RecordingError:  # damaged messages, or an IMU that is not mounted on the camera
                continue
            if T is not None and _is_at_rest(accelerations):
                up: NDArray[np.float64] = T[:3, :3] @ accelerations.mean(axis=0)
                return up / np.linalg.norm(up)
    return None


def _accelerations(bag: BagFile, topic: str, stamp: float) -> tuple[str, NDArray[np.float64]]:
    """The IMU's frame and its accelerations (n, 3) [m/s^2] about a stamp [s]."""
    frame, found = "", list[tuple[float, ...]]()
    begin = int((stamp - AROUND) * NANOSECONDS)
    for raw in itertools.islice(bag.messages({topic}, start=begin), MAX_MESSAGES):
        message = bag.decoded(raw)
        if nanoseconds(message.header) > (stamp + AROUND) * NANOSECONDS:
            break
        a = message.linear_acceleration
        frame = frame_name(message.header.frame_id)
        found.append((a.x, a.y, a.z))
    return frame, np.array(found, np.float64).reshape(-1, 3)


def _is_at_rest(accelerations: NDArray[np.float64]) -> bool:
    """Whether accelerations are those of gravity alone."""
    return (
        len(accelerations) >= MIN_MESSAGES
        and bool(np.isfinite(accelerations).all())
        and abs(float(np.linalg.norm(accelerations.mean(axis=0))) - GRAVITY) < OFF
        and float(accelerations.std(axis=0).max()) < SHAKEN
    )
