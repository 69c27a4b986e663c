"""Key frames: images whose features are kept, and whether drift lets two show one place."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Final

from perception.camera.poses import Pose, motion
from perception.camera.rigid_motions import inverse
from perception.odometry.features import Features
from perception.odometry.spread_poses import spare

REACH: Final = 4.0  # [m] between two views whose depth may show a common part
DRIFT: Final = (0.25, 0.03)  # [m], and share of the way, by which a loop may move the camera


@dataclass(slots=True)
class KeyFrame:
    """An image whose features stay."""

    features: Features
    pose: Pose  # camera to world of its piece
    piece: int
    way: float  # [m] of the camera up to here
    frame: int  # number of the image

    def is_in_reach(self, other: KeyFrame) -> bool:
        """Whether drift lets two key frames of a piece show the same."""
        return math.dist(self.pose[:3, 3], other.pose[:3, 3]) < REACH + self._drift(other)

    def makes_loop(self, other: KeyFrame, T: Pose) -> bool:
        """Whether drift explains a motion `T` to another key frame: else two places look alike."""
        off, _ = motion(other.pose, self.pose @ inverse(T))
        return off < self._drift(other)

    def _drift(self, other: KeyFrame) -> float:
        return DRIFT[0] + DRIFT[1] * abs(other.way - self.way)


def spare_image(
    keys: Sequence[KeyFrame], held: int, recent: int, used: Collection[int]
) -> int | None:
    """The key frame that another one replaces best, where more than `held` have features.

    It is none of the `recent` last ones, and none that is `used`. None: there are not too many.
    """
    full = [number for number, key in enumerate(keys) if len(key.features)]
    free = [number for number in full if number < len(keys) - recent and number not in used]
    if len(full) <= held or len(free) < 2:
        return None
    return free[spare([keys[number].pose for number in free])]
