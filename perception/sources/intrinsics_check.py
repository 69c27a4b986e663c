"""Check of a recording's intrinsics: whether its own views fit by others only."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from perception.camera.poses import Pose, motion
from perception.frames import Frame
from perception.odometry.features import FeatureDetector, Features, Image
from perception.odometry.self_calibration import MatchedPair, matched_pair, self_calibrated

PAIRS: Final = 16
ANCHORS: Final = 120  # views that a second one is looked for from
REACH: Final = 60  # frames between the two, at most ...
NEXT: Final = 6  # ... and key frames
TURNED: Final = (np.radians(12.0), np.radians(45.0))  # between the two
APART: Final = 1.0  # [m] at most
MIN_PAIRS: Final = 6  # to conclude anything
WARNED: Final = 0.08  # by which focal length (logarithm) or centre (in focal lengths) are off
WRONG: Final = 0.12  # certainly: for a refusal
SURE: Final = 5.0  # standard deviations

_log = logging.getLogger(__name__)
Floats = NDArray[np.float64]


def check_intrinsics(name: str, poses: Sequence[Pose], frame_at: Callable[[int], Frame]) -> None:
    """Check the intrinsics of frames with `poses` (n of (4, 4), camera -> world).

    Raises RecordingError where the frames fit by others only, warns where they fit by others
    better. Says nothing where few frames with a turn between them show the same corners.
    """
    _tell(name, *intrinsics_off(poses, frame_at), frame_at(0).K)


def intrinsics_off(poses: Sequence[Pose], frame_at: Callable[[int], Frame]) -> tuple[float, Floats]:
    """By how much the intrinsics of frames are off [focal lengths], and those (3, 3) that fit."""
    detector, views = FeatureDetector(), dict[int, Features]()
    K = frame_at(0).K

    def view(index: int) -> Features:
        if index not in views:
            views[index] = detector.features(Image.of(frame_at(index)))
        return views[index]

    found = [matched_pair(view(i), view(j), K) for i, j in turned_pairs(poses)]
    return _off([pair for pair in found if pair is not None], K)


def check_views(name: str, views: Sequence[Features], K: Floats) -> None:
    """As `check_intrinsics`, of views in their order whose poses are not known."""
    found = list[MatchedPair]()
    for i in np.unique(np.linspace(0, max(len(views) - 2, 0), PAIRS).astype(int)).tolist():
        for second in views[i + 1 : i + 1 + NEXT]:
            pair = matched_pair(views[i], second, K)
            if pair is None:
                break
            if motion(np.eye(4), pair.T)[1] >= TURNED[0]:
                found.append(pair)
                break
    _tell(name, *_off(found, K), K)


def turned_pairs(poses: Sequence[Pose]) -> list[tuple[int, int]]:
    """Pairs of views that a turn separates, spread over the recording."""
    found = []
    for i in np.unique(np.linspace(0, max(len(poses) - 2, 0), ANCHORS).astype(int)).tolist():
        for j in range(i + 1, min(i + REACH, len(poses))):
            far, turn = motion(poses[i], poses[j])
            if far > APART or turn > TURNED[1]:
                break
            if turn >= TURNED[0]:
                found.append((i, j))
                break
    return found[:: max(1, -(-len(found) // PAIRS))]


def _tell(name: str, off: float, fitting: Floats, K: Floats) -> None:
    if off < WARNED:
        return
    said = (
        f"{name}: its views fit each other by other intrinsics: about {_numbers(fitting)} where "
        f"{_numbers(K)} is given; --intrinsics FILE with those of its colour images would work"
    )
    if off >= WRONG:
        raise RecordingError(f"{said}, --no-check maps it as it is")
    _log.warning("%s", said)


def _off(pairs: Sequence[MatchedPair], K: Floats) -> tuple[float, Floats]:
    """By how much the intrinsics are off, as two halves of the pairs agree; and those that fit."""
    if len(pairs) < MIN_PAIRS:
        return 0.0, K
    fits = [self_calibrated(some, K) for some in (pairs, pairs[::2], pairs[1::2])]
    known = [fit for fit in fits if fit is not None]
    if len(known) < len(fits):
        return 0.0, K
    values = np.array([[fit.focal, fit.right, fit.down] for fit in known])
    same = (np.sign(values) == np.sign(values[0])).all(axis=0)
    sure = np.abs(values[0]) > SURE * known[0].deviation
    off = np.where(same & sure, np.abs(values).min(axis=0), 0.0)
    return float(off.max()), known[0].adjusted(K)


def _numbers(K: Floats) -> str:
    return f"fx {K[0, 0]:.0f}, cx {K[0, 2]:.0f}, cy {K[1, 2]:.0f}"
