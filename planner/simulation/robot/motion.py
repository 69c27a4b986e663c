"""Motion of the simulated robot: straight lines and turns on the spot, sampled as poses."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """Speeds of the robot, and distances between its pictures."""

    speed: float = 0.5  # [m/s]
    turn_rate: float = 0.8  # [rad/s]
    stride: float = 0.6  # [m] driven between two pictures, at most
    swing: float = np.deg2rad(30.0)  # [rad] turned between two pictures, at most


@dataclass(frozen=True, slots=True)
class TimedPose:
    """A pose of the robot, with its time."""

    x: float  # [m] map frame
    y: float
    heading: float  # [rad] about z, 0 along x
    seconds: float  # [s] since the start of the motion

    @property
    def xy(self) -> NDArray[np.float64]:
        """(2,) [m] position."""
        return np.array([self.x, self.y])


def drive(pose: TimedPose, corners: NDArray[np.float64], gait: MotionLimits) -> Iterator[TimedPose]:
    """Poses along `corners` (n, 2) [m], turning on the spot at each; the start is not repeated."""
    for corner in corners:
        offset = corner - pose.xy
        distance = float(np.hypot(*offset))
        if distance < 1e-6:
            continue
        heading = float(np.arctan2(offset[1], offset[0]))
        for pose in turn(pose, _wrapped(heading - pose.heading), gait):  # noqa: B020 the last counts
            yield pose
        start, steps = pose, int(np.ceil(distance / gait.stride - 1e-9))
        for k in range(1, steps + 1):
            x, y = start.xy + offset * (k / steps)
            seconds = start.seconds + distance * (k / steps) / gait.speed
            pose = TimedPose(float(x), float(y), heading, seconds)
            yield pose


def turn(pose: TimedPose, angle: float, gait: MotionLimits) -> Iterator[TimedPose]:
    """Poses of a turn on the spot by `angle` [rad], the start not repeated."""
    steps = int(np.ceil(abs(angle) / gait.swing - 1e-9))
    for k in range(1, steps + 1):
        heading = _wrapped(pose.heading + angle * k / steps)
        seconds = pose.seconds + abs(angle) * k / steps / gait.turn_rate
        yield TimedPose(pose.x, pose.y, heading, seconds)


def look_around(pose: TimedPose, gait: MotionLimits) -> Iterator[TimedPose]:
    """Poses of one full turn to the left (thesis section 3.4: 360 degrees at each goal)."""
    return turn(pose, 2 * np.pi, gait)


def _wrapped(angle: float) -> float:
    return float((angle + np.pi) % (2 * np.pi) - np.pi)
