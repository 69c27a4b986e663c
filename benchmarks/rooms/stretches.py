"""Stretches of a recording, and the part of its truth that each shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from lab.maps.complete_truth import TrueObject
from lab.maps.truth_matching import TruthMatcher
from mapping.frames.projection import to_map
from perception.frames import Frame

SINGLE: Final = "single"
SHOW_ALL: Final = ("whole", "every 4th", "backwards")  # what the recording shows
STRETCHES: Final = (*SHOW_ALL, "first half", "second half", "turning", "standing", SINGLE)
SINGLES: Final = 5  # single frames, spread over the recording
TURNING: Final = (0.2, 0.3)  # [m] from the mean position; the second where the first has few frames
FEW: Final = 8  # frames
STANDING: Final = (0.1, 12.0)  # [m] from the mean position, [degrees] between any two views
_RANGE: Final = (0.4, 5.0)  # [m] of depth in which an object is shown
_SLACK: Final = 0.35  # [m] that its middle may lie behind the surface that is measured
_BORDER: Final = 8  # [px] its middle is this far inside the image
_WINDOW: Final = 6  # [px] around its middle whose depth counts

Floats = NDArray[np.float64]


def stretches(poses: Floats) -> list[tuple[str, Sequence[int]]]:
    """Names and indices of all stretches of poses T_map_cam (n, 4, 4), several single ones."""
    n = len(poses)
    turning = longest(poses, TURNING[0])
    if len(turning) < FEW:
        turning = longest(poses, TURNING[1])
    middles = ((2 * k + 1) * n // (2 * SINGLES) for k in range(SINGLES))
    return [
        ("whole", range(n)),
        ("every 4th", range(0, n, 4)),
        ("first half", range(n // 2)),
        ("second half", range(n // 2, n)),
        ("backwards", range(n)[::-1]),
        ("turning", turning),
        ("standing", longest(poses, *STANDING)),
        *((SINGLE, [k]) for k in middles),
    ]


def longest(poses: Floats, radius: float, angle: float = 360.0) -> range:
    """The longest run of poses whose camera stays in one spot, the last of several as long.

    Positions lie within `radius` [m] of their mean, viewing directions within `angle` [degrees] of
    each other.
    """
    best = range(0)
    for first in range(len(poses)):
        last = first
        while last < len(poses) and _stays(poses[first : last + 1], radius, angle):
            last += 1
        best = max(range(first, last), best, key=len)
    return best


def _stays(poses: Floats, radius: float, angle: float) -> bool:
    """Whether the last of `poses` is in one spot with the others, which are in one."""
    positions, views = poses[:, :3, 3], poses[:, :3, 2]
    if np.linalg.norm(positions - positions.mean(axis=0), axis=1).max() >= radius:
        return False
    return angle >= 180 or bool((views @ views[-1]).min() >= np.cos(np.radians(angle)))


def matcher_of(
    frames: Sequence[Frame], truth: Sequence[TrueObject], T_map_world: Floats
) -> TruthMatcher:
    """The truth of `frames`: what fewer than two of them show counts neither way."""
    p_map = to_map(T_map_world, np.array([t.p_world for t in truth]).reshape(-1, 3))
    times = np.sum([shown(frame, p_map) for frame in frames], axis=0)
    seen = times >= min(2, len(frames))
    return TruthMatcher(
        [t if s else replace(t, ignore=True) for t, s in zip(truth, seen, strict=True)], T_map_world
    )


def shown(frame: Frame, p_map: Floats) -> NDArray[np.bool_]:
    """(n,) whether the frame shows the objects whose middles are `p_map` (n, 3) [m]."""
    p_cam = (p_map - frame.T_map_cam[:3, 3]) @ frame.T_map_cam[:3, :3]
    depth = p_cam[:, 2]
    near = (depth > _RANGE[0]) & (depth < _RANGE[1])
    pixels = (p_cam @ frame.K.T / np.where(near, depth, 1.0)[:, None])[:, :2]
    limits = np.array(frame.depth.shape[::-1]) - _BORDER
    inside = near & ((pixels >= _BORDER) & (pixels < limits)).all(axis=1)
    for i in np.nonzero(inside)[0]:
        columns, rows = (slice(at - _WINDOW, at + _WINDOW + 1) for at in pixels[i].astype(int))
        measured = frame.depth[rows, columns]
        measured = measured[measured > 0]
        if len(measured):
            inside[i] = np.percentile(measured, 75) > depth[i] - _SLACK
    return inside
