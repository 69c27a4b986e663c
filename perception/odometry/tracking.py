"""Poses of a camera from its own RGB-D images: key frames, tracking, loops, pieces.

Each image is followed from the last key frame; where it shows too little of it, it becomes a key
frame itself. Key frames that show the same are linked, which closes loops, and the pose graph is
adjusted. Depth has to confirm each motion. An image that cannot be followed is looked for among
all key frames; where it is not found, it begins a new piece, which is joined to the others once two
of its key frames are recognised alike. Images without a piece, and pieces that were never
recognised, have no pose.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from perception.camera.poses import Pose, motion
from perception.camera.rigid_motions import inverse
from perception.frames import Frame
from perception.odometry.features import FeatureDetector, Features, Image
from perception.odometry.key_frames import KeyFrame, spare_image
from perception.odometry.place_memory import PlaceMemory
from perception.odometry.pose_graph import ITERATIONS, Edge, adjusted, needs_adjustment
from perception.odometry.relative_motion import (
    MAX_FLOW_POINTS,
    Motion,
    depth_agreement,
    motion_by_features,
    motion_by_flow,
)
from perception.odometry.still_parts import StillParts
from perception.odometry.tracking_report import TrackingReport, tracking_report

KEY_DISTANCE: Final = 0.15  # [m] from a key frame to the next
KEY_ANGLE: Final = np.deg2rad(10)
MIN_SHOWN: Final = 0.35  # of the features of a key frame that an image has to show
MIN_SHARE: Final = 0.3  # of the features in view that have to agree on the motion
MIN_EVIDENCE: Final = 1.28  # of that share and the share of depth that agrees, together
MIN_FEATURES: Final = 80  # of a key frame that begins a piece
REACH: Final = 4.0  # [m] between two views of which depth shows a common part
NEAR: Final = 1.5  # [m] between key frames that may show the same
SAME_DIRECTION: Final = np.deg2rad(50)
RECENT: Final = 3  # key frames before the last one that an image is matched with
NEIGHBOURS: Final = 3  # older key frames near a new one that it is linked with
SIMILAR: Final = 3  # key frames that look like a new one, wherever they are
APART: Final = 12  # key frames between two views that make a loop
LINK_INLIERS: Final = 40
ADJUST_EVERY: Final = 10  # key frames
ADJUST_STEPS: Final = 6  # iterations while images come
FITS: Final = 0.6  # share of depth that agrees, of an image and the key frame it is followed from
LINKS: Final = 0.75  # of two key frames that are linked
MIN_OVERLAP: Final = 0.2  # of the depth of two key frames that show the same
LINK_OVERLAP: Final = 0.35  # by where both are taken to be, for a link to be tried
STRONG_INLIERS: Final = 60
STRONG_SHARE: Final = 0.3
DRIFT: Final = (0.25, 0.03)  # [m], and share of the way, by which a loop may move the camera
SAME_JOINT: Final = (0.2, np.deg2rad(6))  # by which two recognitions of a piece may differ
STILL: Final = (0.03, np.deg2rad(2))  # [m], [rad] from a key frame, which is none of its own
STAYED: Final = Motion(np.eye(4), np.eye(6), 0, 1.0)
MAX_TRACKS: Final = 20  # of the last images, where memory is bounded
SOON: Final = 15  # lost images after which a strong recognition still is enough


@dataclass(frozen=True, slots=True)
class _Track:
    key: int  # number of the key frame
    measured: Motion  # key frame to image
    moved: Pose  # (4, 4) the camera's motion since the image before

    @property
    def T_key_cam(self) -> Pose:  # noqa: N802 - names its frames
        """Pose of the camera in its key frame."""
        return inverse(self.measured.T)


@dataclass(slots=True)
class Odometry:
    """Poses of images in their order; `poses` are in the frame of the first tracked camera."""

    still: NDArray[np.bool_] | None = None  # (H, W) pixels that move with the camera
    max_images: int | None = None  # key frames that keep their image, so that memory is bounded
    keys: list[KeyFrame] = field(default_factory=list)
    edges: list[Edge] = field(default_factory=list)
    loops: int = 0
    _tracks: list[_Track | None] = field(default_factory=list)
    _detector: FeatureDetector = field(default_factory=FeatureDetector)
    _memory: PlaceMemory = field(default_factory=PlaceMemory)
    _joints: dict[tuple[int, int], list[Pose]] = field(default_factory=dict)
    _adjusted: int = 0  # edges when the graph was adjusted last
    _last: tuple[_Track, Image] | None = None
    _image: Image | None = None
    _parts: StillParts = field(default_factory=StillParts)
    _lost: int = 0  # images since the last one with a pose

    def add(self, frame: Frame) -> bool:
        """Track an image; returns whether it is followed. The pose in `frame` is not read."""
        image = Image.of(frame, self.still)
        self._parts.add(frame.depth)
        if self._is_frozen(image):
            self._tracks.append(None)
            return False
        self._image = image
        last = next((track for track in reversed(self._tracks) if track is not None), None)
        track = None if last is None else self._followed(image, last)
        if track is None:
            track = self._found_again(image, last)
        self._lost = 0 if track is not None else self._lost + 1
        self._last = None if track is None else (track, image)
        self._tracks.append(track)
        if self.max_images is not None:
            del self._tracks[:-MAX_TRACKS]
        return track is not None

    def followed(self) -> tuple[int, Pose] | None:
        """Key frame of the last image, and the camera's pose in it; None where it was lost."""
        track = self._tracks[-1] if self._tracks else None
        return None if track is None else (track.key, track.T_key_cam)

    def still_parts(self) -> NDArray[np.bool_] | None:
        """Pixels (H, W) that turned out to move with the camera; None: none, or they are known."""
        if self.still is not None or self._image is None:
            return None
        return self._parts.found(self._image.depth.shape)

    def _is_frozen(self, image: Image) -> bool:
        """Whether the driver repeats the last colour image, though depth goes on."""
        last = self._image
        return (
            last is not None
            and np.array_equal(last.grey, image.grey)
            and not np.array_equal(last.depth, image.depth, equal_nan=True)
        )

    def poses(self) -> list[Pose | None]:
        """The pose (camera to world) of each image added so far; None where it was lost."""
        self._adjust(last=True)
        main = self.main_piece()
        return [
            None
            if track is None or self.keys[track.key].piece != main
            else self.keys[track.key].pose @ track.T_key_cam
            for track in self._tracks
        ]

    def main_piece(self) -> int:
        """The piece with the most images."""
        counts = np.bincount([self.keys[t.key].piece for t in self._tracks if t] or [0])
        return int(counts.argmax())

    def report(self) -> TrackingReport:
        """Counts, and the errors to be expected."""
        tracks = [None if track is None else track.key for track in self._tracks]
        return tracking_report(self.keys, self.edges, self.loops, tracks, self.main_piece())

    def _followed(self, image: Image, last: _Track) -> _Track | None:
        """The track of an image that still shows what the last key frames show."""
        key = self.keys[last.key].features
        features = None
        measured = None
        if not self._lost:
            for T_key_cam in (last.T_key_cam @ last.moved, last.T_key_cam):
                measured = motion_by_flow(key, image, inverse(T_key_cam), levels=3)
                if self._is_followed(measured, key, image):
                    break
                measured = None
        if measured is not None and self._is_near(measured):
            return self._track(last, last.key, measured)
        features = self._detector.features(image)
        number = last.key
        if measured is None:
            if not self._lost:
                last = self._promoted(last)
            found = self._matched(features, image, last)
            if found is None:
                return None
            number, measured = found
        if self._is_near(measured) or len(features) < LINK_INLIERS:
            return self._track(last, number, measured)
        return self._new_key(features, image, last, number, measured)

    def _promoted(self, last: _Track) -> _Track:
        """The last image as a key frame: the next one shows it, though not its key frame."""
        if self._last is None or self._last[0] is not last:
            return last
        image = self._last[1]
        features = self._detector.features(image)
        far, turned = motion(np.eye(4), last.T_key_cam)
        if len(features) < LINK_INLIERS or (far < STILL[0] and turned < STILL[1]):
            return last
        self._tracks[-1] = track = self._new_key(features, image, last, last.key, last.measured)
        return track

    def _matched(self, features: Features, image: Image, last: _Track) -> tuple[int, Motion] | None:
        """The recent key frame that an image shows, by the looks of its features."""
        piece = self.keys[last.key].piece
        recent = [k for k in range(len(self.keys) - 1, -1, -1) if self.keys[k].piece == piece]
        for number in [last.key, *(k for k in recent if k != last.key)][: 1 + RECENT]:
            measured = motion_by_features(self.keys[number].features, features, image)
            if (
                measured is not None
                and measured.share > STRONG_SHARE
                and self._is_confirmed(measured, self.keys[number].features, image, FITS)
            ):
                return number, measured
        return None

    def _is_followed(self, measured: Motion | None, key: Features, image: Image) -> bool:
        return (
            measured is not None
            and measured.share >= MIN_SHARE
            and measured.inliers >= MIN_SHOWN * min(len(key), MAX_FLOW_POINTS)
            and self._is_confirmed(measured, key, image, FITS)
        )

    def _is_confirmed(self, measured: Motion, first: Features, second: Image, share: float) -> bool:
        """Whether the depth of two images shows one scene by a motion."""
        shown = depth_agreement(first, second, measured.T)
        return (
            shown.share >= share
            and shown.overlap >= MIN_OVERLAP
            and shown.share + measured.share >= MIN_EVIDENCE
        )

    def _is_near(self, measured: Motion) -> bool:
        far, turned = motion(np.eye(4), inverse(measured.T))
        return far < KEY_DISTANCE and turned < KEY_ANGLE

    def _track(self, last: _Track | None, key: int, measured: Motion) -> _Track:
        """The track of an image, with its motion since the one before."""
        if last is None or self._lost or self.keys[last.key].piece != self.keys[key].piece:
            return _Track(key, measured, np.eye(4))
        before = self.keys[last.key].pose @ last.T_key_cam
        return _Track(key, measured, inverse(before) @ self.keys[key].pose @ inverse(measured.T))

    def _found_again(self, image: Image, last: _Track | None) -> _Track | None:
        """The track of an image that was recognised, or that begins a piece; None: it is lost."""
        features = self._detector.features(image)
        if last is not None and self._lost < SOON:
            allowed = np.array([key.piece == self.keys[last.key].piece for key in self.keys])
            for number in self._memory.similar(features, allowed, 2 * SIMILAR):
                measured = self._recognised(number, features, image)
                if measured is not None:
                    return self._track(None, number, measured)
        if len(features) < MIN_FEATURES:
            return None
        piece = 1 + max((key.piece for key in self.keys), default=-1)
        self._add_key(KeyFrame(features, np.eye(4), piece, 0.0))
        self._link(len(self.keys) - 1, image, ())
        return _Track(len(self.keys) - 1, STAYED, np.eye(4))

    def _recognised(self, number: int, features: Features, image: Image) -> Motion | None:
        """The motion from a key frame that an image surely shows; None: it may be another."""
        key = self.keys[number].features
        measured = motion_by_features(key, features, image)
        if (
            measured is not None
            and measured.inliers >= STRONG_INLIERS
            and measured.share >= STRONG_SHARE
            and self._is_confirmed(measured, key, image, LINKS)
        ):
            return measured
        return None

    def _add_key(self, key: KeyFrame) -> None:
        self._memory.add(len(self.keys), key.features)
        self.keys.append(key)
        if self.max_images is not None:
            used = {track.key for track in self._tracks if track is not None}
            number = spare_image(self.keys, self.max_images, 2 * APART, used)
            if number is not None:
                self.keys[number].features = Features.none()
                self._memory.forget(number)

    def _new_key(
        self, features: Features, image: Image, last: _Track, key: int, measured: Motion
    ) -> _Track:
        track = self._track(last, key, measured)
        before = self.keys[key]
        pose = before.pose @ track.T_key_cam
        way = before.way + float(np.linalg.norm(track.T_key_cam[:3, 3]))
        number = len(self.keys)
        self._add_key(KeyFrame(features, pose, before.piece, way))
        self.edges.append(Edge(key, number, measured.T, measured.information))
        self._link(number, image, (key,))
        poses = [key.pose for key in self.keys]
        if number % ADJUST_EVERY == 0 and needs_adjustment(poses, self.edges, self._adjusted):
            self._adjust()
        return _Track(number, STAYED, track.moved)

    def _link(self, number: int, image: Image, linked: tuple[int, ...]) -> None:
        """Link a new key frame with those that show the same."""
        new = self.keys[number]
        for other in self._neighbours(number, linked):
            guess = inverse(new.pose) @ self.keys[other].pose
            key = self.keys[other].features
            if depth_agreement(key, image, guess).overlap < LINK_OVERLAP:
                continue
            found = motion_by_flow(key, image, guess, levels=1)
            if self._is_link(found, other, image):
                assert found is not None
                self._add_edge(other, number, found)
                linked = (*linked, other)
        if any(number - other > APART for other in linked):
            return
        allowed = np.array(
            [
                key.piece != new.piece or (number - other > APART and self._is_in_reach(key, new))
                for other, key in enumerate(self.keys)
            ]
        )
        allowed[[number, *linked]] = False
        for other in self._memory.similar(new.features, allowed, SIMILAR):
            recognised = self._recognised(other, new.features, image)
            if recognised is None:
                continue
            if self.keys[other].piece != new.piece:
                self._join(other, number, recognised)
            elif self._is_plausible_loop(other, number, recognised):
                self._add_edge(other, number, recognised)

    def _is_link(self, found: Motion | None, other: int, image: Image) -> bool:
        return (
            found is not None
            and found.inliers >= LINK_INLIERS
            and found.share >= STRONG_SHARE
            and self._is_confirmed(found, self.keys[other].features, image, LINKS)
        )

    def _add_edge(self, first: int, second: int, measured: Motion) -> None:
        self.edges.append(Edge(first, second, measured.T, measured.information))
        self.loops += abs(first - second) > APART

    def _is_in_reach(self, a: KeyFrame, b: KeyFrame) -> bool:
        """Whether drift lets two key frames of a piece show the same."""
        far = math.dist(a.pose[:3, 3], b.pose[:3, 3])
        return far < REACH + DRIFT[0] + DRIFT[1] * abs(b.way - a.way)

    def _is_plausible_loop(self, first: int, second: int, measured: Motion) -> bool:
        """Whether drift explains the motion that a loop says: else two places look alike."""
        a, b = self.keys[first], self.keys[second]
        off, _ = motion(b.pose, a.pose @ inverse(measured.T))
        return off < DRIFT[0] + DRIFT[1] * abs(b.way - a.way)

    def _join(self, first: int, second: int, measured: Motion) -> None:
        """Join the pieces of two key frames, if another pair has said the same."""
        old, new = self.keys[first], self.keys[second]
        joint = old.pose @ inverse(measured.T) @ inverse(new.pose)  # new piece -> old piece
        if old.piece > new.piece:
            old, new, joint = new, old, inverse(joint)
        before = self._joints.setdefault((old.piece, new.piece), [])
        before.append(joint)
        apart = [motion(other, joint) for other in before[:-1]]
        if not any(far < SAME_JOINT[0] and turned < SAME_JOINT[1] for far, turned in apart):
            return
        self._add_edge(first, second, measured)
        for key in [key for key in self.keys if key.piece == new.piece]:
            key.pose, key.piece = joint @ key.pose, old.piece

    def _neighbours(self, number: int, linked: tuple[int, ...]) -> list[int]:
        """Key frames that may show what the new one shows: two recent ones, and the nearest."""
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

    def _adjust(self, *, last: bool = False) -> None:
        if len(self.edges) == self._adjusted:
            return
        self._adjusted = len(self.edges)
        steps = ITERATIONS if last else ADJUST_STEPS
        found = adjusted([key.pose for key in self.keys], self.edges, steps)
        for key, pose in zip(self.keys, found, strict=True):
            key.pose = pose


def tracked(frames: Callable[[], Iterable[Frame]]) -> Odometry:
    """Odometry of all frames; read once more where a part of the image moves with the camera."""
    odometry = Odometry()
    for frame in frames():
        odometry.add(frame)
    still = odometry.still_parts()
    if still is not None:
        odometry = Odometry(still=still)
        for frame in frames():
            odometry.add(frame)
    return odometry
