"""Key graph: key frames, the measured motions between them, and the places that they show.

A piece is a set of key frames that motions link. Two pieces become one once two pairs of their key
frames say the same of where they lie, or one pair for sure.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.camera.poses import Pose, inverse, motion
from perception.odometry.features import MAX_HAMMING, Features, Image, ScaleFeatureDetector
from perception.odometry.pose_graph import ITERATIONS, PoseConstraint, adjusted, needs_adjustment
from perception.odometry.relative_motion import RelativeMotion, confirmed_motion
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


KEPT: Final = 120  # strongest features of a key frame that are kept
ASKED: Final = 200  # strongest features of an image that vote
NEAREST: Final = 3  # descriptors that a feature votes for
MIN_VOTES: Final = 8


@dataclass(slots=True)
class PlaceMemory:
    """The strongest descriptors of all key frames."""

    _descriptors: list[NDArray[np.uint8]] = field(default_factory=list)
    _keys: list[NDArray[np.intp]] = field(default_factory=list)

    def add(self, key: int, features: Features) -> None:
        """Keep a key frame's strongest features."""
        kept = features.descriptors[:KEPT]
        self._descriptors.append(kept)
        self._keys.append(np.full(len(kept), key))

    def forget(self, key: int) -> None:
        """Forget a key frame's features; its number stays its own."""
        self._descriptors[key], self._keys[key] = self._descriptors[key][:0], self._keys[key][:0]

    def similar(self, features: Features, allowed: NDArray[np.bool_], count: int) -> list[int]:
        """The `count` key frames with the most votes among the `allowed` ones (n,)."""
        chosen = [number for number, ok in enumerate(allowed) if ok and len(self._keys[number])]
        if not chosen or not len(features):
            return []
        stored = np.concatenate([self._descriptors[number] for number in chosen])
        keys = np.concatenate([self._keys[number] for number in chosen])
        nearest = min(NEAREST, len(stored))
        matcher = cv2.BFMatcher(cv2.NORM_HAMMING)
        found = matcher.knnMatch(features.descriptors[:ASKED], stored, k=nearest)
        voted = [keys[m.trainIdx] for row in found for m in row if m.distance <= MAX_HAMMING]
        votes = np.bincount(np.array(voted, np.intp), minlength=len(allowed))
        best = np.argsort(-votes, kind="stable")[:count]
        return [int(key) for key in best if votes[key] >= MIN_VOTES]


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
        joints = {pieces: [*found] for pieces, found in self._joints.items()}
        keys = [replace(key) for key in self.keys]
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


MIN_SHARE: Final = 0.2  # of the matches that have to agree on the motion
AGREES: Final = 0.9  # of the depth of two views that show one scene
OVERLAP: Final = 0.2  # of their depth that both show
MAX_IMAGES: Final = 8  # newest key frames whose images are kept


@dataclass(slots=True)
class WideLinks:
    """SIFT features of key frames, computed where they are first needed."""

    _images: dict[int, Image] = field(default_factory=dict)  # of the newest key frames
    _features: dict[int, Features] = field(default_factory=dict)  # by key frame
    _last: tuple[Image, Features] | None = None
    _detector: ScaleFeatureDetector = field(default_factory=ScaleFeatureDetector)

    def keep_recent(self, key: int, image: Image) -> None:
        """Keep the image of a new key frame, and forget all of an old one."""
        self._images[key] = image
        for old in [number for number in self._images if number <= key - MAX_IMAGES]:
            del self._images[old]
            self._features.pop(old, None)

    def keep(self, key: int, image: Image) -> None:
        """Keep the features of a key frame."""
        self._features[key] = replace(self._features_of(image), grey=np.zeros((0, 0), np.uint8))

    def motion(self, key: int, image: Image) -> RelativeMotion | None:
        """The motion from a key frame to an image that surely shows the same; None: not found."""
        if key not in self._features:
            if key not in self._images:
                return None
            self._features[key] = self._features_of(self._images[key])
        return confirmed_motion(
            self._features[key],
            self._features_of(image),
            image,
            agrees=AGREES,
            overlap=OVERLAP,
            min_share=MIN_SHARE,
        )

    def _features_of(self, image: Image) -> Features:
        if self._last is None or self._last[0] is not image:
            self._last = image, self._detector.features(image)
        return self._last[1]
