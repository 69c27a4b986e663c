"""Check of a recording's depth against its poses and its colour, before anything is mapped.

Pairs of frames that a short motion separates must agree on the surfaces they show
(`perception.camera.depth_agreement`). Where they disagree, but would agree with another unit of
depth or another convention of poses, the recording is read wrongly, and the error names the other
unit or convention.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Final, TypeGuard

import numpy as np

from kg.model.errors import RecordingError
from perception.camera.depth_agreement import DepthSamples, depth_samples, lone_text
from perception.camera.depth_edges import (
    ONE_SCENE,
    EdgeOffset,
    colour_fit,
    edge_offset,
)
from perception.camera.poses import CONVENTIONS, Pose
from perception.frames import Frame
from perception.sources.depth_readings import (
    GOOD,
    MIN_PAIRS,
    Readings,
    another_reading,
    another_scale,
    judged_pairs,
    lone_frames,
    pairs_by,
    share_without,
)
from perception.sources.known_mistakes import (
    another_body,
    another_cause,
    disparity_for_depth,
    two_causes,
)

EDGE_FRAMES: Final = 24  # whose edges are compared
MAX_DEPTH: Final = 100.0  # [m] median of an image's depth
NEAREST, FARTHEST = 0.45, 7.0  # [m] usual medians of an image's depth
USUAL: Final = 2.0  # [m] the same of rooms
UNITS: Final = {"centimetres": 100, "millimetres": 1000, "tenths of millimetres": 10000}
EDGES_APART: Final = 6.0  # [px of 640] between the edges of depth and of colour

_log = logging.getLogger(__name__)
FrameAt = Callable[[int], Frame]


@dataclass(frozen=True, slots=True)
class DepthFindings:
    """Findings of a sample of a recording's depth."""

    share: float | None  # of points that two frames share and agree on; None: too few points
    registration: EdgeOffset | None  # of depth's edges against colour's; None: too few edges
    error: str | None  # names another depth scale or pose convention that explains the depth
    warnings: tuple[str, ...]


def check_depth(findings: DepthFindings) -> None:
    """Raise RecordingError where depth and poses disagree, and log the warnings."""
    if findings.error is not None:
        raise RecordingError(findings.error)
    for warning in findings.warnings:
        _log.warning("%s", warning)


def depth_findings(
    name: str,
    poses: Sequence[Pose],
    convention: str,
    depth_scale: float,
    frame_at: FrameAt,
    others: Mapping[str, Pose] | None = None,
) -> DepthFindings:
    """Compare `poses` (n of (4, 4), camera -> world by `convention`) with the frames' depth.

    `depth_scale` [units a metre] is the one that depth was read with; `frame_at` reads a frame.
    `others` has poses (4, 4) of the camera in frames that the poses may be of, by the option that
    selects the frame. The error names another depth scale, frame or convention of poses that
    explains the depth; a warning tells of depth that is not registered to colour.
    """
    read = dict[int, Frame]()
    readings: Readings = CONVENTIONS | {
        option: partial(_times, T) for option, T in (others or {}).items()
    }

    def frame(index: int) -> Frame:
        if index not in read:
            read[index] = frame_at(index)
        return read[index]

    def samples_at(index: int) -> DepthSamples:
        return depth_samples(frame(index).depth, frame(index).K)

    @cache
    def briefly(index: int) -> DepthSamples:  # without keeping the frame
        one = read[index] if index in read else frame_at(index)
        return depth_samples(one.depth, one.K)

    middle = float(np.nanmedian(frame(0).depth)) if np.isfinite(frame(0).depth).any() else 0.0
    if middle > MAX_DEPTH:
        return DepthFindings(None, None, _too_far(name, middle, depth_scale), ())
    pairs = pairs_by(poses, convention, samples_at)
    judged = judged_pairs(pairs, convention)
    share = share_without(judged)
    if share is None and len(pairs) >= 2 * MIN_PAIRS:
        share = 0.0  # frames beside each other show nothing in common
    error = None
    lone = lone_frames(poses, convention, judged, briefly)
    share = max(share, share_without(judged, lone) or 0.0) if share is not None else None
    if share is None or share < GOOD:
        inverse = "camera-to-world" if convention == "world-to-camera" else "world-to-camera"
        both = [*pairs, *pairs_by(poses, inverse, samples_at)]
        error = another_reading(name, both, convention, readings)
    if error is None and share is not None and share < GOOD:
        error = another_scale(name, pairs, convention, depth_scale, share)
        error = error or another_cause(name, pairs, convention, share)
        focal = float(frame(0).K[0, 0])
        error = error or disparity_for_depth(name, pairs, convention, focal, share)
        error = error or another_body(name, poses, briefly, share)
        error = error or two_causes(name, poses, convention, depth_scale, briefly, share)
        error = error or (
            f"{name}: depth does not fit the poses: {int(100 * share)} % of the points that two "
            f"frames share agree, {100 * GOOD:.0f} % and more is sound; intrinsics, poses or their "
            "stamps are wrong, perhaps two of them, or much of the scene moves; --poses FILE gives "
            "other poses, --poses estimate finds some in the images, which works where depth and "
            "intrinsics are right, --no-check maps it as it is"
        )
    shown = [read[index] for index in sorted(read)] or [frame(0)]
    offset, told = _colour_findings(name, shown)
    if share is None and error is None and not NEAREST < middle < FARTHEST:
        scale = f"{middle:.2g} m by {depth_scale:g} units a metre; --depth-scale gives another"
        told += (f"{name}: too few frames to compare depth with poses; its median is {scale}",)
    return DepthFindings(share, offset, error, told + _lone(name, lone, frame_at))


def _colour_findings(
    name: str, shown: Sequence[Frame]
) -> tuple[EdgeOffset | None, tuple[str, ...]]:
    """The offset of depth's edges against colour's, and a warning of frames that do not fit."""
    # the first few, of all parts of the recording, may be enough
    spread = [one for start in range(3) for one in shown[start::3]]
    images = [(f.rgb, f.depth) for f in spread[:EDGE_FRAMES]]
    offset = edge_offset(images)
    if offset is not None and offset.pixels > EDGES_APART:
        return offset, (_unregistered(name, offset),)
    if shows_two_scenes(fit := colour_fit(images)):
        return offset, (two_scenes(name, fit),)
    return offset, ()


def _lone(name: str, lone: set[int], frame_at: FrameAt) -> tuple[str, ...]:
    """A warning of frames that contradict their neighbours; none without any."""
    ids = [frame_at(number).id for number in sorted(lone)[:4]]
    text = lone_text("depth", f"{len(lone)} of the compared frames", ids)
    return (f"{name}: {text}",) if lone else ()


def _too_far(name: str, middle: float, depth_scale: float) -> str:
    unit, factor = min(UNITS.items(), key=lambda one: abs(np.log(middle / one[1] / USUAL)))
    return (
        f"{name}: depth has a median of {middle:.0f} m, as {unit} have that are taken for metres; "
        f"--depth-scale {depth_scale * factor:.12g} would work, --no-check maps it as it is"
    )


def _times(T_frame_cam: Pose, T_world_frame: Pose) -> Pose:
    T: Pose = T_world_frame @ T_frame_cam
    return T


def shows_two_scenes(fit: float | None) -> TypeGuard[float]:
    """Whether a `colour_fit` means that colour and depth show different scenes."""
    return fit is not None and fit < ONE_SCENE


def two_scenes(name: str, fit: float) -> str:
    """Message for colour that does not show what depth shows."""
    return (
        f"{name}: colour does not show the scene that depth shows: edges of depth are {fit:.1f} "
        "times as strong in their own colour image as in others, 2 is usual; colour is mirrored, "
        "late, of another camera or very noisy, the lens is dirty, or depth is wrong"
    )


def _unregistered(name: str, offset: EdgeOffset) -> str:
    return (
        f"{name}: depth seems not registered to colour: their edges lie {offset.pixels:.0f} pixels "
        f"apart (depth {offset.scale:.2f} times as large, shifted by {offset.right:+.0f}, "
        f"{offset.down:+.0f}); register it, or give the intrinsics of its own camera"
    )
