"""Sensor model of a robot's camera, and motion model: the time of its moves and views."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.settings import LOOK_AROUND, SPEED


@dataclass(frozen=True, slots=True)
class Sensor:
    """Sensor model of an RGB-D camera with a detector.

    A view detects an object with the probability `recall`, and with half of it at the distance
    `half_fade`. A second view from the same square keeps the share 1 - `rho` of its probability,
    since misses are correlated. Raises ValueError for impossible values.
    """

    near: float = 0.8  # [m] depth gate, thesis section 3.2.2
    far: float = 4.6  # [m] depth gate, thesis section 3.2.2
    field_of_view: float = 1.0123  # [rad] 58 degrees, across
    recall: float = 0.7  # probability to detect an object in view, from near
    half_fade: float = np.inf  # [m]
    rho: float = 0.8  # correlation of repeated views

    def __post_init__(self) -> None:
        if not 0 <= self.near < self.far or not 0 < self.field_of_view <= 2 * np.pi:
            raise ValueError(f"needs 0 <= near < far and a field of view in 0..2 pi, got {self}")
        if not 0 < self.recall <= 1 or not 0 <= self.rho <= 1 or not self.half_fade > 0:
            raise ValueError(f"recall and rho must lie in 0..1 and half_fade above 0, got {self}")

    def chance(self, metres: ArrayLike) -> NDArray[np.float64]:
        """Chance to detect at each distance [m]: recall / (1 + (d / half_fade)^4) within range."""
        d = np.asarray(metres, np.float64)
        seen = self.recall / (1.0 + (d / self.half_fade) ** 4)
        return np.where((d >= self.near) & (d <= self.far), seen, 0.0)


@dataclass(frozen=True, slots=True)
class Motion:
    """Time that moving and taking views cost. Defaults are those of the thesis' robot."""

    speed: float = SPEED  # [m/s]
    turn_rate: float = 2 * np.pi / LOOK_AROUND  # [rad/s]: a whole turn is the thesis' look
    picture: float = 1.0  # [s] to stand still for one picture

    def __post_init__(self) -> None:
        if not self.speed > 0 or not self.turn_rate > 0 or not self.picture >= 0:
            raise ValueError(f"speed and turn rate must be > 0 and picture >= 0, got {self}")

    def sweep_seconds(self, extent: ArrayLike, field_of_view: float) -> NDArray[np.float64]:
        """[s] of a sweep over `extent` [rad]: a picture, and the turn beyond its field of view."""
        turned = np.maximum(np.asarray(extent, np.float64) - field_of_view, 0.0)
        whole = np.asarray(extent) >= 2 * np.pi - 1e-9
        return self.picture + np.where(whole, 2 * np.pi, turned) / self.turn_rate


@dataclass(frozen=True, slots=True)
class Sweep:
    """Sweep of the camera: the robot turns on the spot and looks all the way."""

    start: float  # [rad] heading to begin with
    turn: float  # [rad] to turn from there, to the left
    middle: float  # [rad] heading in the middle of all that is in view
    extent: float  # [rad] in view altogether


def sweep_over(at: float, heading: float, extent: float, field_of_view: float) -> Sweep:
    """The shortest sweep that shows `extent` [rad] about `heading`, for a robot that heads `at`.

    It begins at once where the robot has to turn there anyway, and shows what it turns past.
    """
    whole = 2 * np.pi - 1e-9
    if extent >= whole:
        return Sweep(at, 2 * np.pi, heading, extent)
    half = max(extent - field_of_view, 0.0) / 2
    off = float(np.remainder(heading - at + np.pi, 2 * np.pi) - np.pi)
    side = -1.0 if off < 0 else 1.0
    if abs(off) <= half:  # it stands within the sweep: from the nearer end to the other
        return Sweep(heading - side * half, side * 2 * half, heading, extent)
    turn = side * (abs(off) + half)
    return Sweep(at, turn, at + turn / 2, min(abs(turn) + field_of_view, whole))


def angle_between(a: ArrayLike, b: ArrayLike) -> NDArray[np.float64]:
    """[rad] the smaller angle between headings, 0..pi."""
    off = (np.asarray(a) - np.asarray(b) + np.pi) % (2 * np.pi) - np.pi
    return np.asarray(np.abs(off), np.float64)
