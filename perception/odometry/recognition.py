"""Recognition: where images of one world lie in another, by encoded key views of it.

Each image is compared with the kept views that look most like it. A pair counts where the features
of both fit one motion and their depth shows one scene by it. Each such match gives a pose of the
whole other world. Matches of several images with several views must agree on the pose, no second
place may be matched nearly as often, and all views of the same part of the room must show the same
depth.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from perception.camera.depth_agreement import COLUMNS, gridded_samples
from perception.camera.poses import Pose, adjoints, inverse, motion
from perception.frames import Frame
from perception.odometry.features import FeatureDetector, Features, Image
from perception.odometry.key_graph import PlaceMemory
from perception.odometry.pose_graph import PoseConstraint, adjusted
from perception.odometry.relative_motion import RelativeMotion, confirmed_motion
from perception.odometry.tracking_report import contradictions, contradicts

KEPT: Final = 300  # features of a view
MIN_FEATURES: Final = 40  # features of a view that is kept
SIMILAR: Final = 5  # kept views that an image is compared with
AGREES: Final = 0.75  # of the depth of two images that show one scene
OVERLAP: Final = 0.2  # of their depth that both show
MATCHES: Final = 3  # that agree on the pose
VIEWS: Final = 2  # of either world that take part in them
RIVAL: Final = 0.3  # of the matches, in which another place is seen, so that no pose is certain
SAME: Final = (0.3, np.deg2rad(8))  # [m], [rad] between the poses of two matches that agree
CHANGED: Final = 0.2  # share of contradicting pairs of views, as things may have moved since
MAX_TILT: Final = np.deg2rad(8)  # between the verticals of two levelled worlds


@dataclass(frozen=True, slots=True, eq=False)
class KeyView:
    """The view of a camera from one pose, for images to be compared with."""

    features: Features  # without the grey image
    pose: Pose  # camera to its world


@dataclass(frozen=True, slots=True, eq=False)
class ViewMatch:
    """A view of one world and an image of the other that show one scene."""

    view: int
    image: int
    measured: RelativeMotion  # view to image
    T: Pose  # (4, 4) the image's world in the view's, by this match


@dataclass(frozen=True, slots=True)
class Recognition:
    """Pose of a world in another one."""

    T: Pose  # (4, 4) takes it to the other
    matches: tuple[ViewMatch, ...]
    error: float  # [m] by which the matches differ (root mean square)


@dataclass(frozen=True, slots=True)
class Doubt:
    """Reason why no pose is certain."""

    reason: str


def view_of(
    frame: Frame, detector: FeatureDetector, without: NDArray[np.float32] | None = None
) -> tuple[KeyView, Image]:
    """The view of a frame with its pose, and its image, without what is in boxes (n, 4) [px]."""
    hidden = None
    if without is not None and len(without):
        hidden = np.zeros(frame.depth.shape, np.bool_)
        for left, top, right, bottom in np.clip(np.rint(without), 0, max(hidden.shape)).astype(int):
            hidden[top:bottom, left:right] = True
    image = Image.of(frame, hidden)
    f = detector.features(image)
    some = slice(0, KEPT)
    empty = np.zeros((0, 0), np.uint8)
    kept = Features(empty, f.samples, f.pixels[some], f.points[some], f.descriptors[some])
    return KeyView(kept, frame.T_map_cam), image


@dataclass(slots=True)
class Recogniser:
    """Finds images of another world among kept views."""

    views: Sequence[KeyView]
    matches: list[ViewMatch] = field(default_factory=list)
    images: list[KeyView] = field(default_factory=list)
    _memory: PlaceMemory = field(default_factory=PlaceMemory)

    def __post_init__(self) -> None:
        for number, view in enumerate(self.views):
            self._memory.add(number, view.features)

    def look(self, view: KeyView, image: Image) -> int:
        """Compare an image, a view of the other world, with the kept ones; returns its matches."""
        self.images.append(view)
        before = len(self.matches)
        allowed = np.ones(len(self.views), np.bool_)
        for number in self._memory.similar(view.features, allowed, SIMILAR):
            kept = self.views[number]
            measured = confirmed_motion(
                kept.features, view.features, image, agrees=AGREES, overlap=OVERLAP
            )
            if measured is not None:
                T = kept.pose @ inverse(measured.T) @ inverse(view.pose)
                self.matches.append(ViewMatch(number, len(self.images) - 1, measured, T))
        return len(self.matches) - before

    def result(self) -> Recognition | Doubt:
        """Pose of the images' world, or the reason why it is not certain."""
        best = self._agreeing(self.matches)
        count = f"{len(best)} of {len(self.images)} views match"
        seen = min(len({match.image for match in best}), len({match.view for match in best}))
        if len(best) < MATCHES or seen < VIEWS:
            return Doubt(f"it was not recognised there ({count}, {MATCHES} are needed)")
        rest = [match for match in self.matches if not self._same(best, match)]
        rival = self._agreeing(rest)
        if len(rival) > RIVAL * len(best):
            return Doubt(
                f"it looks like two places there ({len(best)} views match one, {len(rival)} "
                "another)"
            )
        T = self._joint(best)
        up = float(np.arccos(np.clip(T[2, 2], -1, 1)))
        if up > MAX_TILT:
            return Doubt(f"it matches there only if it is tilted by {np.degrees(up):.0f} degrees")
        placed = [replace(view, pose=T @ view.pose) for view in self.images]
        compared, against = contradictions(
            [(kept.features, kept.pose, view.features, view.pose)
             for kept in self.views for view in placed]
        )  # fmt: skip
        if contradicts(compared, against, CHANGED):
            return Doubt(
                f"it looks like a place there, but its depth contradicts {against} of {compared} "
                "pairs of views"
            )
        off = [motion(T @ self.images[m.image].pose, m.T @ self.images[m.image].pose) for m in best]
        return Recognition(T, tuple(best), float(np.sqrt(np.mean([far**2 for far, _ in off]))))

    def _agreeing(self, matches: Sequence[ViewMatch]) -> list[ViewMatch]:
        """The largest group of matches that agree on the pose."""
        groups = [[other for other in matches if self._same([one], other)] for one in matches]
        return max(groups, key=len, default=[])

    def _same(self, group: Sequence[ViewMatch], match: ViewMatch) -> bool:
        """Whether a match agrees with one of a group on the pose of the image's camera."""
        at = self.images[match.image].pose
        apart = (motion(other.T @ at, match.T @ at) for other in group)
        return any(far < SAME[0] and turned < SAME[1] for far, turned in apart)

    def _joint(self, matches: Sequence[ViewMatch]) -> Pose:
        """The motion that fits the matches best, by their information."""
        edges = []
        for match in matches:
            # a small motion after the measured one is one before the whole, seen from the view
            A = np.linalg.inv(
                adjoints((self.views[match.view].pose @ inverse(match.measured.T))[None])[0]
            )
            edges.append(PoseConstraint(1, 0, match.T, A.T @ match.measured.information @ A))
        first = max(matches, key=lambda match: match.measured.inliers).T
        T: Pose = adjusted([np.eye(4), first], edges)[1]
        return T


_STEPS: Final = 1000  # of a metre, in which points and depth are kept
_HEAD: Final = np.dtype([("points", "<u2"), ("shape", "<u2", 2), ("K", "<f4", (3, 3))])
_POINT: Final = np.dtype([("xyz", "<i2", 3), ("descriptor", "u1", 32)])
_MAX_DEPTH: Final = 32.0  # [m] of depth and points that are kept
_MAX_SIDE: Final = 4 * COLUMNS  # of the grid of depth


def encoded(view: KeyView) -> bytes:
    """A view without its pose."""
    f = view.features
    near = np.flatnonzero((np.abs(f.points) < _MAX_DEPTH).all(axis=1))[:KEPT]
    points = np.zeros(len(near), _POINT)
    points["xyz"] = np.rint(f.points[near] * _STEPS)
    points["descriptor"] = f.descriptors[near]
    depth = np.where(f.samples.depth < _MAX_DEPTH, f.samples.depth, 0.0)  # nan: 0
    head = np.zeros((), _HEAD)
    head["points"], head["shape"], head["K"] = len(near), depth.shape, f.samples.K
    grid = np.rint(depth * _STEPS).astype("<u2").tobytes()
    return head.tobytes() + points.tobytes() + zlib.compress(grid)


def decoded(data: bytes, pose: Pose) -> KeyView:
    """The view of `encoded` with its pose; raises ValueError for anything else."""
    head = np.frombuffer(data, _HEAD, 1)[0]
    count, (height, width) = int(head["points"]), map(int, head["shape"])
    K = head["K"].astype(np.float64)
    if count > KEPT or not (0 < height <= _MAX_SIDE and 0 < width <= _MAX_SIDE):
        raise ValueError(f"a view has up to {KEPT} points and a grid of {_MAX_SIDE} a side")
    if not (np.isfinite(K).all() and K[0, 0] > 0 and K[1, 1] > 0):
        raise ValueError("a view has a focal length")
    points = np.frombuffer(data, _POINT, count, _HEAD.itemsize)
    start, size = _HEAD.itemsize + points.nbytes, 2 * height * width
    try:
        grid = zlib.decompressobj().decompress(data[start:], size + 1)
    except zlib.error as error:
        raise ValueError(f"its depth is damaged: {error}") from error
    if len(grid) != size:
        raise ValueError("its depth is damaged")
    depth = np.frombuffer(grid, "<u2").reshape(height, width).astype(np.float32) / _STEPS
    features = Features(
        grey=np.zeros((0, 0), np.uint8),
        samples=gridded_samples(np.where(depth > 0, depth, np.float32(np.nan)), K),
        pixels=np.zeros((count, 2)),
        points=points["xyz"] / float(_STEPS),
        descriptors=np.ascontiguousarray(points["descriptor"]),
    )
    return KeyView(features, pose)
