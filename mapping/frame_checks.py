"""Frame checks: refuses frames and detections that cannot be right, before the map changes."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from kg.model.errors import FrameError
from mapping.pose_convention import PoseConventionCheck
from perception.camera.depth_agreement import COLUMNS
from perception.camera.poses import checked_pose
from perception.frames import Detections, Frame, SceneScores

#: [m] no depth camera of rooms has a larger median depth; depth in millimetres has
MAX_MEDIAN_DEPTH: Final = 50.0
DARK: Final = 3  # frames without any depth that a stream may not begin with


class FrameChecks:
    """Checks of the frames of one stream.

    A camera may be dark while it starts, and covered later: a frame without any depth is refused
    only where the stream has shown none yet, from the third such frame on.

    Args:
        check_poses: whether depth is also compared with the poses (`mapping.pose_convention`).
    """

    def __init__(self, *, check_poses: bool = True) -> None:
        self._convention = PoseConventionCheck() if check_poses else None
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
        if self._convention is not None:
            self._convention.check(frame)

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


def check_detections(detections: Detections, scores: SceneScores | None) -> None:
    """Raise FrameError where they are of another type, or boxes or scores are not finite."""
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
    if scores is not None and not isinstance(scores, SceneScores):
        raise FrameError(
            f"scores must be SceneScores, got {type(scores).__name__}; "
            'SceneScores({"kitchen": 0.9}) would work'
        )


def _check_numbers(frame: Frame) -> None:
    """Refuse stamp, intrinsics and pose where they are none."""
    if not math.isfinite(frame.stamp):
        raise FrameError(
            f"frame {frame.id}: the stamp must be finite, got {frame.stamp}; seconds since 1970, "
            "as of time.time(), would work"
        )
    K = frame.K
    if not np.isfinite(K).all() or min(K[0, 0], K[1, 1]) <= 0:
        raise FrameError(
            f"frame {frame.id}: K must be finite with focal lengths above 0, got {K.tolist()}; "
            "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels would work"
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
