"""Key graph: key frames, the measured motions between them, and the pieces that these make.

A piece is a set of key frames that motions link. Two pieces become one once two pairs of their key
frames say the same of where they lie, or one pair for sure.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from perception.camera.poses import Pose, motion
from perception.camera.rigid_motions import inverse
from perception.odometry.features import Features
from perception.odometry.key_frames import KeyFrame, spare_image
from perception.odometry.place_memory import PlaceMemory
from perception.odometry.pose_graph import ITERATIONS, PoseConstraint, adjusted, needs_adjustment
from perception.odometry.relative_motion import RelativeMotion

NEAR: Final = 1.5  # [m] between key frames that may show the same
SAME_DIRECTION: Final = np.deg2rad(50)
RECENT: Final = 3  # newest other key frames that are compared
NEIGHBOURS: Final = 3  # older key frames near a new one that it is linked with
SIMILAR: Final = 3  # key frames that look like a new one, wherever they are
APART: Final = 12  # key frames between two views that make a loop
ADJUST_STEPS: Final = 6  # iterations while images come
SAME_JOINT: Final = (0.2, np.deg2rad(6))  # by which two recognitions of a piece may differ


@dataclass(slots=True)
class KeyGraph:
    """Key frames in their order, and the motions that link them."""

    keys: list[KeyFrame] = field(default_factory=list)
    edges: list[PoseConstraint] = field(default_factory=list)
    loops: int = 0
    _memory: PlaceMemory = field(default_factory=PlaceMemory)
    _joints: dict[tuple[int, int], list[Pose]] = field(default_factory=dict)
    _adjusted: int = 0  # edges when the poses were adjusted last

    def copy(self) -> KeyGraph:
        """The graph as it is now."""
        keys, joints = (
            [replace(key) for key in self.keys],
            {p: [*j] for p, j in self._joints.items()},
        )
        return replace(self, keys=keys, edges=[*self.edges], _joints=joints)

    def add(self, key: KeyFrame) -> int:
        """Add a key frame; returns its number."""
        self._memory.add(len(self.keys), key.features)
        self.keys.append(key)
        return len(self.keys) - 1

    def spare(self, max_images: int, used: Collection[int]) -> None:
        """Drop the image of a key frame that others replace, where too many have one."""
        number = spare_image(self.keys, max_images, 2 * APART, used)
        if number is not None:
            self.keys[number].features = Features.none()
            self._memory.forget(number)

    def link(self, first: int, second: int, measured: RelativeMotion) -> None:
        """Add the motion between two key frames of a piece."""
        self.edges.append(PoseConstraint(first, second, measured.T, measured.information))
        self.loops += abs(first - second) > APART

    def join(
        self, first: int, second: int, measured: RelativeMotion, *, sure: bool = False
    ) -> None:
        """Join the pieces of two key frames, if it is sure or another pair has said the same."""
        old, new = self.keys[first], self.keys[second]
        joint = old.pose @ inverse(measured.T) @ inverse(new.pose)  # new piece -> old piece
        if old.piece > new.piece:
            old, new, joint = new, old, inverse(joint)
        before = self._joints.setdefault((old.piece, new.piece), [])
        before.append(joint)
        apart = [motion(other, joint) for other in before[:-1]]
        if not sure and not any(f < SAME_JOINT[0] and turn < SAME_JOINT[1] for f, turn in apart):
            return
        self.link(first, second, measured)
        for key in [key for key in self.keys if key.piece == new.piece]:
            key.pose, key.piece, key.way = joint @ key.pose, old.piece, key.way + old.way

    def recent(self, key: int) -> list[int]:
        """A key frame, and the newest others of its piece."""
        piece = self.keys[key].piece
        newest = (k for k in range(len(self.keys) - 1, -1, -1) if self.keys[k].piece == piece)
        return [key, *(k for k in newest if k != key)][: 1 + RECENT]

    def neighbours(self, number: int, linked: Collection[int]) -> list[int]:
        """Key frames that may show what a new one shows: two recent ones, and the nearest."""
        new = self.keys[number]
        apart = []
        for other, key in enumerate(self.keys[:number]):
            if other in linked or key.piece != new.piece or not len(key.features):
                continue
            if math.dist(key.pose[:3, 3], new.pose[:3, 3]) >= NEAR:
                continue
            far, turned = motion(new.pose, key.pose)
            if turned < SAME_DIRECTION:
                apart.append((far + turned, other))
        recent = [other for _, other in apart if number - other <= RECENT][:2]
        nearest = [other for _, other in sorted(apart) if other not in recent]
        return recent + nearest[:NEIGHBOURS]

    def alike_in_piece(self, features: Features, piece: int) -> list[int]:
        """Key frames of a piece that look most like an image."""
        allowed = np.array([key.piece == piece for key in self.keys])
        return self._memory.similar(features, allowed, 2 * SIMILAR)

    def alike_far_away(self, number: int, linked: Collection[int]) -> list[int]:
        """Key frames of other pieces, or long before, that look most like a new one."""
        new = self.keys[number]
        allowed = np.array(
            [
                key.piece != new.piece or (number - other > APART and key.is_in_reach(new))
                for other, key in enumerate(self.keys)
            ]
        )
        allowed[[number, *linked]] = False
        return self._memory.similar(new.features, allowed, SIMILAR)

    def elsewhere(self, number: int) -> list[int]:
        """Earlier key frames of other pieces that may show the same: the last, and alike ones."""
        piece = self.keys[number].piece
        before = [n for n in range(number - 1, -1, -1) if self.keys[n].piece != piece]
        allowed = np.zeros(len(self.keys), np.bool_)
        allowed[before] = True
        alike = self._memory.similar(self.keys[number].features, allowed, 2 * SIMILAR)
        return list(dict.fromkeys([*before[:RECENT], *alike]))

    def adjust(self, *, last: bool = False) -> None:
        """Adjust all poses to the motions, at the end or where new motions ask for it."""
        poses = [key.pose for key in self.keys]
        if len(self.edges) == self._adjusted:
            return
        if not last and not needs_adjustment(poses, self.edges, self._adjusted):
            return
        self._adjusted = len(self.edges)
        found = adjusted(poses, self.edges, ITERATIONS if last else ADJUST_STEPS)
        for key, pose in zip(self.keys, found, strict=True):
            key.pose = pose
