"""Key frames: images whose features stay, and the choice of those that may lose theirs."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from perception.camera.poses import Pose
from perception.odometry.features import Features
from perception.odometry.spread_poses import spare


@dataclass(slots=True)
class KeyFrame:
    """An image whose features stay."""

    features: Features
    pose: Pose  # camera to world of its piece
    piece: int
    way: float  # [m] of the camera up to here


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
