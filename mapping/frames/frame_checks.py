"""Frame checks: errors for frames and detections that cannot be right, before the map changes.

Depth is also compared with the poses. The depth of two frames some motion apart agrees by
camera-to-map poses of a camera that looks along +z. Where it does not, but does with the poses
inverted or the camera's axes exchanged (`perception.camera.poses.CONVENTIONS`), the poses have
that convention. `perception.sources.depth_check` compares a recording's in the same way.
"""

from __future__ import annotations

import math
from collections import defaultdict
from typing import Final

import numpy as np

from kg.model.errors import FrameError
from kg.model.shares import percent
from perception.camera.depth_agreement import COLUMNS, Agreement, agreement, depth_samples
from perception.camera.intrinsics import pinhole_problem
from perception.camera.poses import CONVENTIONS, checked_pose, motion
from perception.frames import Detections, Frame, SceneScores
from perception.sources.depth_readings import FramePair, better_convention, median_share

#: [m] no depth camera of rooms has a larger median depth; depth in millimetres has
MAX_MEDIAN_DEPTH: Final = 50.0
DARK: Final = 3  # frames without any depth that a stream may not begin with
APART: Final = (0.15, 1.0)  # [m] between the two frames of a pair: from ... to
TURNED: Final = (np.radians(6.0), np.radians(35.0))
OVERLAP: Final = 0.3  # share of a pair's points that both frames show by the poses as given
STILL: Final = 0.8  # share by no motion at all, from which a pair tells nothing
SOUND: Final = 0.85  # share of agreeing points that clears the poses as given
EXPLAINED: Final = 0.95  # share by another convention that refuses them; right ones reach 0.98
ENOUGH: Final = 8  # pairs that clear sound poses
MAX_PAIRS: Final = 24  # pairs, after which nothing is concluded any more
GIVEN: Final = "camera-to-world"


class FrameChecks:
    """Checks of the frames of one stream.

    A camera may be dark while it starts, and covered later: a frame without any depth is refused
    only where the stream has shown none yet, from the third such frame on. Poses are compared for
    each camera apart.

    Args:
        check_poses: whether depth is also compared with the poses.
    """

    def __init__(self, *, check_poses: bool = True) -> None:
        self._check_poses = check_poses
        self._conventions = defaultdict[str, _PoseConventionCheck](_PoseConventionCheck)
        self._dark: int | None = 0  # frames so far; None: one had depth

    def check(self, frame: Frame) -> None:
        """Raise FrameError, or RecordingError for the pose, where the frame cannot be right."""
        if not isinstance(frame, Frame):
            raise FrameError(
                f"a frame must be a Frame, got {type(frame).__name__}; "
                "Frame(id, rgb, depth, K, T_map_cam, stamp) would work"
            )
        _check_numbers(frame)
        self._check_depth(frame)
        if self._check_poses:
            self._conventions[frame.camera].check(frame)

    def _check_depth(self, frame: Frame) -> None:
        depth = _median_depth(frame)
        if depth is not None and (depth > MAX_MEDIAN_DEPTH or frame.depth.dtype.kind != "f"):
            raise FrameError(
                f"frame {frame.id}: depth must be float32 metres, got {frame.depth.dtype} with a "
                f"median of {depth:g}; depth.astype(np.float32) / 1000 would work if it is in "
                "millimetres (--depth-scale of a recording)"
            )
        if depth is not None:
            self._dark = None
        elif self._dark is not None:
            self._dark += 1
            if self._dark >= DARK:
                raise FrameError(
                    f"frame {frame.id}: none of the {self._dark} frames so far has any depth: all "
                    "is nan, infinite, zero or negative; float32 metres along the optical axis, "
                    "nan where there is no return, would work"
                )


def check_detections(frame: Frame, detections: Detections, scores: SceneScores | None) -> None:
    """Raise FrameError where they are of another type, not finite, or of another image size."""
    if not isinstance(detections, Detections):
        raise FrameError(
            f"detections must be Detections, got {type(detections).__name__}; "
            "Detections(xyxy, score, label) would work: arrays (n, 4) [px] and (n,), n labels"
        )
    finite = np.isfinite(detections.xyxy).all(axis=1) & np.isfinite(detections.score)
    if not finite.all():
        n = int(np.argmin(finite))
        raise FrameError(
            f"detection {n} ({detections.label[n]}) is not finite: box "
            f"{detections.xyxy[n].tolist()}, score {detections.score[n]:g}; "
            "Detections(xyxy, score, label) of the finite ones would work"
        )
    if isinstance(frame, Frame):  # another type is refused with the frame
        _check_in_image(frame, detections)
    if scores is not None and not isinstance(scores, SceneScores):
        raise FrameError(
            f"scores must be SceneScores, got {type(scores).__name__}; "
            'SceneScores({"kitchen": 0.9}) would work'
        )


def _check_in_image(frame: Frame, detections: Detections) -> None:
    """Raise FrameError for a box whose centre lies outside the image, which no detector makes."""
    height, width = frame.depth.shape
    centre = (detections.xyxy[:, :2] + detections.xyxy[:, 2:]) / 2
    outside = ((centre < -0.5) | (centre > (width, height))).any(axis=1)  # edges count
    if outside.any():
        n = int(np.argmax(outside))
        raise FrameError(
            f"frame {frame.id}: box {n} ({detections.label[n]}) {detections.xyxy[n].tolist()} lies "
            f"outside the image of {width} x {height} px; boxes of an image of another size, "
            f"times ({width} / its width, {height} / its height) each, would work"
        )


def _check_numbers(frame: Frame) -> None:
    """Raise FrameError for an impossible stamp, intrinsics or pose."""
    if not math.isfinite(frame.stamp):
        raise FrameError(
            f"frame {frame.id}: the stamp must be finite, got {frame.stamp}; seconds since 1970, "
            "as of time.time(), would work"
        )
    K = frame.K
    height, width = frame.depth.shape
    problem = pinhole_problem(K[0, 0], K[1, 1], K[0, 2], K[1, 2], width, height)
    if problem or not np.isfinite(K).all():
        raise FrameError(
            f"frame {frame.id}: {problem or 'K must be finite'}, got {K.tolist()}; "
            "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels would work"
        )
    if abs(K[2, :2]).max() > 1e-6 or abs(K[2, 2] - 1) > 1e-6:
        form = "K.T" if abs(K[:2, 2]).max() <= 1e-6 and abs(K[2, 2] - 1) <= 1e-6 else "K / K[2, 2]"
        raise FrameError(
            f"frame {frame.id}: the last row of K must be 0, 0, 1, got {K[2].tolist()}; {form} "
            "would work where it gives [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]"
        )
    checked_pose(frame.T_map_cam, f"frame {frame.id}: T_map_cam")


def _median_depth(frame: Frame) -> float | None:
    """Median [m] of the depth that there is, of a sample of the pixels; None without any."""
    step = max(1, frame.depth.shape[1] // COLUMNS)
    for sampled in (frame.depth[step // 2 :: step, step // 2 :: step], frame.depth):
        returns = sampled[(sampled > 0) & np.isfinite(sampled)]
        if returns.size:
            return float(np.median(returns))
    return None


class _PoseConventionCheck:
    """Compares frames of a stream that some motion separates, until its convention is known."""

    def __init__(self) -> None:
        self._anchor: Frame | None = None
        self._pairs = 0  # that were compared
        self._found = {name: list[Agreement]() for name in CONVENTIONS}
        self._done = False
        self._problem: str | None = None

    def check(self, frame: Frame) -> None:
        """Check one more frame.

        Raises FrameError once another convention explains the depth, and for each frame after it.
        """
        if not self._done and (pair := self._pair_with(frame)) is not None:
            self._conclude(pair, frame.id)
        if self._problem is not None:
            raise FrameError(self._problem)

    def _pair_with(self, frame: Frame) -> FramePair | None:
        """The frame and the one it is compared with; None: too little motion, or too much."""
        a, b = self._anchor or frame, frame
        distance, turn = motion(a.T_map_cam, b.T_map_cam)
        if a is not b and distance < APART[0] and turn < TURNED[0]:
            return None
        self._anchor = frame
        if a is b or distance > APART[1] or turn > TURNED[1]:
            return None
        samples = (depth_samples(a.depth, a.K), depth_samples(b.depth, b.K))
        return FramePair(*samples, (a.T_map_cam, b.T_map_cam))

    def _conclude(self, pair: FramePair, frame_id: str) -> None:
        self._pairs += 1
        still = agreement(pair.a, pair.b, np.eye(4))  # high: the scene moves with the camera
        if still.share < STILL and pair.share(GIVEN, 1.0).overlap >= OVERLAP:
            for name, found in self._found.items():
                found.append(pair.share(name, 1.0))
        share = median_share(self._found[GIVEN])
        better = better_convention(self._found, GIVEN, EXPLAINED)
        if share is not None and better is not None:
            given, best, name = better
            self._problem = (
                f"frame {frame_id}: depth does not fit T_map_cam as camera-to-map poses "
                f"({percent(given)} of the points that two frames share agree), but does "
                f"({percent(best)}) "
                f'if they are {name} poses: CONVENTIONS["{name}"](T_map_cam) of '
                "perception.camera.poses would work, in a new map; check_poses=False (--no-check) "
                "takes them as they are"
            )
        sound = len(self._found[GIVEN]) >= ENOUGH and share is not None and share >= SOUND
        if self._problem is not None or sound or self._pairs >= MAX_PAIRS:
            self._done, self._anchor = True, None
