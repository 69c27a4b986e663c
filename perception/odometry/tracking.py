"""Poses of a camera from its own RGB-D images: key frames, tracking, loops, pieces.

Each image is followed from the last key frame; where it shows too little of it, it becomes a key
frame itself. Key frames that show the same are linked, which closes loops, and the pose graph is
adjusted. Depth has to confirm each motion. An image that cannot be followed is compared with the
last key frames by better features, and looked for among all key frames; where it is not found, it
begins a new piece, which is joined to the others once two of its key frames are recognised alike.
At the end, pieces are compared by better features, too. Images without a piece, and pieces that
were never recognised, have no pose.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from perception.camera.poses import Pose, inverse, motion
from perception.frames import Frame
from perception.odometry.features import (
    FeatureDetector,
    Features,
    FrozenImages,
    Image,
    StillParts,
    shrunk,
)
from perception.odometry.key_graph import APART, RECENT, KeyFrame, KeyGraph, WideLinks
from perception.odometry.relative_motion import (
    MAX_FLOW_POINTS,
    RelativeMotion,
    depth_agreement,
    motion_by_features,
    motion_by_flow,
)
from perception.odometry.tracking_report import TrackingReport, tracking_report

KEY_DISTANCE: Final = 0.15  # [m] from a key frame to the next
KEY_ANGLE: Final = np.deg2rad(10)
MIN_SHOWN: Final = 0.35  # of the features of a key frame that an image has to show
MIN_SHARE: Final = 0.3  # of the features in view that have to agree on the motion
MIN_EVIDENCE: Final = 1.28  # of that share and the share of depth that agrees, together
MIN_FEATURES: Final = 80  # of a key frame that begins a piece
LINK_INLIERS: Final = 40
ADJUST_EVERY: Final = 10  # key frames
FITS: Final = 0.6  # share of depth that agrees, of an image and the key frame it is followed from
LINKS: Final = 0.75  # of two key frames that are linked
MIN_OVERLAP: Final = 0.2  # of the depth of two key frames that show the same
LINK_OVERLAP: Final = 0.35  # by where both are taken to be, for a link to be tried
STRONG_INLIERS: Final = 60
STILL: Final = (0.03, np.deg2rad(2))  # [m], [rad] from a key frame, which is none of its own
STAYED: Final = RelativeMotion(np.eye(4), np.eye(6), 0, 1.0)
MAX_TRACKS: Final = 20  # of the last images, where memory is bounded
SOON: Final = 15  # lost images after which a strong recognition still is enough
MAX_WIDE: Final = 600  # key frames whose pieces are compared by better features at the end


@dataclass(frozen=True, slots=True)
class _Track:
    key: int  # number of the key frame
    measured: RelativeMotion  # key frame to image
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
    graph: KeyGraph = field(default_factory=KeyGraph)
    frozen: FrozenImages = field(default_factory=FrozenImages)
    _tracks: list[_Track | None] = field(default_factory=list)
    _detector: FeatureDetector = field(default_factory=FeatureDetector)
    _last: tuple[_Track, Image, int] | None = None  # with the number of the image
    _image: Image | None = None
    _parts: StillParts = field(default_factory=StillParts)
    _lost: int = 0  # images since the last one with a pose
    _added: int = 0  # images
    _plain: int = 0  # lost images with too few features
    _wide: WideLinks = field(default_factory=WideLinks)

    def add(self, frame: Frame) -> bool:
        """Track an image; returns whether it is followed. The pose in `frame` is not read."""
        self._added += 1
        if self.frozen.add(frame):
            self._tracks.append(None)
            return False
        frame = shrunk(frame)
        image = Image.of(frame, self.still)
        self._parts.add(frame.depth)
        self._image = image
        last = next((track for track in reversed(self._tracks) if track is not None), None)
        track = None if last is None else self._followed(image, last)
        if track is None:
            track = self._found_again(image, last)
        self._lost = 0 if track is not None else self._lost + 1
        self._last = None if track is None else (track, image, self._added - 1)
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

    def poses(self) -> list[Pose | None]:
        """The pose (camera to world) of each image added so far; None where it was lost."""
        self.graph.adjust(last=True)
        main = self.main_piece()
        return [
            None
            if track is None or self.graph.keys[track.key].piece != main
            else self.graph.keys[track.key].pose @ track.T_key_cam
            for track in self._tracks
        ]

    def main_piece(self) -> int:
        """The piece with the most images."""
        counts = np.bincount([self.graph.keys[t.key].piece for t in self._tracks if t] or [0])
        return int(counts.argmax())

    def report(self) -> TrackingReport:
        """Counts, and the errors to be expected."""
        tracks = [None if track is None else track.key for track in self._tracks]
        graph = self.graph
        main = self.main_piece()
        return tracking_report(graph.keys, graph.edges, graph.loops, tracks, main, self._plain)

    def _followed(self, image: Image, last: _Track) -> _Track | None:
        """The track of an image that still shows what the last key frames show."""
        key = self.graph.keys[last.key].features
        features = None
        measured = None
        if not self._lost:
            for T_key_cam in (last.T_key_cam @ last.moved, last.T_key_cam):
                measured = motion_by_flow(key, image, inverse(T_key_cam), levels=3)
                shown = MIN_SHOWN * min(len(key), MAX_FLOW_POINTS)
                if self._is_confirmed(measured, key, image, FITS, inliers=shown):
                    break
                measured = None
        if measured is not None and self._is_near(measured):
            return self._track(last, last.key, measured)
        if measured is None and not self._lost:
            last = self._promoted(last)  # the features of the last image may be at hand
        features = self._detector.features(image)
        number = last.key
        if measured is None:
            found = self._matched(features, image, last) or self._far(image, last)
            if found is None:
                return None
            number, measured = found
        if self._is_near(measured) or len(features) < LINK_INLIERS:
            return self._track(last, number, measured)
        return self._new_key(features, image, last, number, measured, self._added - 1)

    def _promoted(self, last: _Track) -> _Track:
        """The last image as a key frame: the next one shows it, though not its key frame."""
        if self._last is None or self._last[0] is not last:
            return last
        _, image, frame = self._last
        features = self._detector.features(image)
        far, turned = motion(np.eye(4), last.T_key_cam)
        if len(features) < LINK_INLIERS or (far < STILL[0] and turned < STILL[1]):
            return last
        track = self._new_key(features, image, last, last.key, last.measured, frame)
        self._tracks[frame - (self._added - 1)] = track
        return track

    def _matched(
        self, features: Features, image: Image, last: _Track
    ) -> tuple[int, RelativeMotion] | None:
        """The recent key frame that an image shows, by the looks of its features."""
        for number in self.graph.recent(last.key):
            key = self.graph.keys[number].features
            measured = motion_by_features(key, features, image)
            if self._is_confirmed(measured, key, image, FITS):
                assert measured is not None
                return number, measured
        return None

    def _far(self, image: Image, last: _Track) -> tuple[int, RelativeMotion] | None:
        """The recent key frame that an image shows from farther away, soon after it was lost."""
        if self._lost > RECENT:
            return None
        tried = (
            (number, self._wide.motion(number, image)) for number in self.graph.recent(last.key)
        )
        return next(((number, found) for number, found in tried if found is not None), None)

    def _is_confirmed(
        self,
        measured: RelativeMotion | None,
        first: Features,
        second: Image,
        share: float,
        *,
        inliers: float = 0,
    ) -> bool:
        """Whether features, and the depth of two images by their motion, show one scene.

        So many `inliers`, MIN_SHARE of the matches and a `share` of the depth have to agree.
        """
        if measured is None or measured.share < MIN_SHARE or measured.inliers < inliers:
            return False
        shown = depth_agreement(first, second, measured.T)
        return (
            shown.share >= share
            and shown.overlap >= MIN_OVERLAP
            and shown.share + measured.share >= MIN_EVIDENCE
        )

    def _is_near(self, measured: RelativeMotion) -> bool:
        far, turned = motion(np.eye(4), inverse(measured.T))
        return far < KEY_DISTANCE and turned < KEY_ANGLE

    def _track(self, last: _Track | None, key: int, measured: RelativeMotion) -> _Track:
        """The track of an image, with its motion since the one before."""
        if (
            last is None
            or self._lost
            or self.graph.keys[last.key].piece != self.graph.keys[key].piece
        ):
            return _Track(key, measured, np.eye(4))
        before = self.graph.keys[last.key].pose @ last.T_key_cam
        return _Track(
            key, measured, inverse(before) @ self.graph.keys[key].pose @ inverse(measured.T)
        )

    def _found_again(self, image: Image, last: _Track | None) -> _Track | None:
        """The track of an image that was recognised, or that begins a piece; None: it is lost."""
        features = self._detector.features(image)
        if last is not None and self._lost < SOON:
            for number in self.graph.alike_in_piece(features, self.graph.keys[last.key].piece):
                measured = self._recognised(number, features, image)
                if measured is not None:
                    return self._track(None, number, measured)
        if len(features) < MIN_FEATURES:
            self._plain += 1
            return None
        piece = 1 + max((key.piece for key in self.graph.keys), default=-1)
        key = KeyFrame(features, np.eye(4), piece, 0.0, self._added - 1)
        number = self._add_key(key, image)
        self._link(number, image, ())
        return _Track(number, STAYED, np.eye(4))

    def _recognised(self, number: int, features: Features, image: Image) -> RelativeMotion | None:
        """The motion from a key frame that an image surely shows; None: it may be another."""
        key = self.graph.keys[number].features
        measured = motion_by_features(key, features, image)
        sure = self._is_confirmed(measured, key, image, LINKS, inliers=STRONG_INLIERS)
        return measured if sure else None

    def _add_key(self, key: KeyFrame, image: Image) -> int:
        number = self.graph.add(key)
        self._wide.keep_recent(number, image)
        if self.max_images is not None:
            used = {track.key for track in self._tracks if track is not None}
            self.graph.spare(self.max_images, used)
        return number

    def _new_key(
        self,
        features: Features,
        image: Image,
        last: _Track,
        key: int,
        measured: RelativeMotion,
        frame: int,
    ) -> _Track:
        track = self._track(last, key, measured)
        before = self.graph.keys[key]
        pose = before.pose @ track.T_key_cam
        way = before.way + float(np.linalg.norm(track.T_key_cam[:3, 3]))
        number = self._add_key(KeyFrame(features, pose, before.piece, way, frame), image)
        self.graph.link(key, number, measured)
        self._link(number, image, (key,))
        if number % ADJUST_EVERY == 0:
            self.graph.adjust()
        return _Track(number, STAYED, track.moved)

    def _link(self, number: int, image: Image, linked: tuple[int, ...]) -> None:
        """Link a new key frame with those that show the same."""
        new = self.graph.keys[number]
        for other in self.graph.neighbours(number, linked):
            guess = inverse(new.pose) @ self.graph.keys[other].pose
            key = self.graph.keys[other].features
            if depth_agreement(key, image, guess).overlap < LINK_OVERLAP:
                continue
            found = motion_by_flow(key, image, guess, levels=1)
            if self._is_confirmed(found, key, image, LINKS, inliers=LINK_INLIERS):
                assert found is not None
                self.graph.link(other, number, found)
                linked = (*linked, other)
        if any(number - other > APART for other in linked):
            return
        for other in self.graph.alike_far_away(number, linked):
            recognised = self._recognised(other, new.features, image)
            if recognised is None:
                continue
            if self.graph.keys[other].piece != new.piece:
                self.graph.join(other, number, recognised)
            elif self.graph.keys[other].makes_loop(new, recognised.T):
                self.graph.link(other, number, recognised)

    def join_pieces(self, frames: Iterable[Frame]) -> None:
        """Join pieces by better features; `frames` are all images once more.

        Pieces stay apart where the depth of many views contradicts the joined ones.
        """
        before = self.graph.copy()
        self._join_pieces(frames)
        self.graph.adjust(last=True)
        if self.report().contradicts_itself:
            self.graph = before

    def _join_pieces(self, frames: Iterable[Frame]) -> None:
        keys = self.graph.keys
        step = 1 + len(keys) // MAX_WIDE
        chosen = {key.frame: number for number, key in enumerate(keys) if number % step == 0}
        wide = WideLinks()
        for at, frame in enumerate(frames):
            number = chosen.get(at)
            if number is None:
                continue
            image = Image.of(shrunk(frame), self.still)
            for other in self.graph.elsewhere(number):
                found = wide.motion(other, image)
                if found is not None and keys[other].piece != keys[number].piece:
                    self.graph.join(other, number, found, sure=number - other <= RECENT * step)
            wide.keep(number, image)


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
    if len({key.piece for key in odometry.graph.keys}) > 1:
        odometry.join_pieces(frames())
    return odometry
