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
from functools import partial
from typing import Any, Final, TypeGuard

import numpy as np
from numpy.typing import NDArray

from kg.model.errors import RecordingError
from perception.camera.depth_agreement import (
    Agreement,
    DepthSamples,
    agreement,
    depth_samples,
    gridded_samples,
)
from perception.camera.depth_edges import (
    ONE_SCENE,
    ColourJudge,
    EdgeOffset,
    colour_fit,
    edge_offset,
)
from perception.camera.poses import (
    CONVENTIONS,
    Pose,
    motion,
    pose_from_quaternion,
    quaternion_from_pose,
)
from perception.frames import Frame
from perception.no_return import ray_lengths

Floats = NDArray[np.float64]

ANCHORS: Final = 240  # frames that pairs are looked for from, spread evenly
PAIRS: Final = 12  # of frames, by each of two readings of the poses
APART: Final = 0.3  # [m] between the two frames of a pair ...
TURNED: Final = np.radians(25.0)  # ... that are not turned more against each other
REACH: Final = 60  # frames between the two, at most
EDGE_FRAMES: Final = 24  # whose edges are compared
MIN_STILL: Final = 20  # frames of a camera that hardly moves, to conclude anything
MIN_PAIRS: Final = 5  # pairs that show enough of one scene, to conclude anything
OVERLAP: Final = 0.15  # share of a pair's points that both frames show
MAX_DEPTH: Final = 100.0  # [m] median of an image's depth
GOOD: Final = 0.85  # share of points that agree; sound recordings have 0.95
POOR: Final = 0.8  # another reading may be the right one
BETTER: Final = 0.15  # by how much another reading must agree better
SCALES: Final = 2.0 ** np.arange(-5, 5.01, 0.25)  # factors of depth that are tried
USUAL_SCALES: Final = (1.0, 10.0, 100.0, 256.0, 1000.0, 2000.0, 4000.0, 5000.0, 6553.5, 10000.0)
SNAP: Final = 1.2  # factor within which a depth scale is taken for a usual one
EDGES_APART: Final = 6.0  # [px of 640] between the edges of depth and of colour

_log = logging.getLogger(__name__)
FrameAt = Callable[[int], Frame]
Readings = Mapping[str, Callable[[Pose], Pose]]  # poses as read -> camera to world, by name


@dataclass(frozen=True, slots=True)
class FramePair:
    """Two frames that may show one scene."""

    a: DepthSamples
    b: DepthSamples
    poses: tuple[Pose, Pose]  # camera -> world, as read

    def share(self, convention: str, scale: float, readings: Readings = CONVENTIONS) -> Agreement:
        """Agreement by another reading of the poses and depth `scale` times as large."""
        T_a, T_b = (readings[convention](T) for T in self.poses)
        T = np.linalg.inv(T_a) @ T_b
        T[:3, 3] /= scale
        return agreement(self.a, self.b, T)


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

    def pairs_by(reading: str) -> list[FramePair]:
        return [
            FramePair(
                depth_samples(frame(i).depth, frame(i).K),
                depth_samples(frame(j).depth, frame(j).K),
                (poses[i], poses[j]),
            )
            for i, j in _chosen_pairs(poses, reading)
        ]

    middle = float(np.nanmedian(frame(0).depth)) if np.isfinite(frame(0).depth).any() else 0.0
    if middle > MAX_DEPTH:
        return DepthFindings(None, None, _too_far(name, middle, depth_scale), ())
    pairs = pairs_by(convention)
    share = _median_share(pairs, convention, 1.0)
    if share is None and len(pairs) >= 2 * MIN_PAIRS:
        share = 0.0  # frames beside each other show nothing in common
    error = None
    if share is None or share < GOOD:
        inverse = "camera-to-world" if convention == "world-to-camera" else "world-to-camera"
        error = _another_reading(name, [*pairs, *pairs_by(inverse)], convention, readings)
    if error is None and share is not None and share < GOOD:
        error = _another_scale(name, pairs, convention, depth_scale, share)
        error = error or _another_cause(name, pairs, convention, share)
        error = error or (
            f"{name}: depth does not fit the poses: {share:.0%} of the points that two frames "
            f"share agree, {GOOD:.0%} and more is sound; intrinsics, poses or their stamps are "
            "wrong, or much of the scene moves; --poses FILE gives other poses, --poses estimate "
            "finds some in the images, --no-check maps it as it is"
        )
    shown = [read[index] for index in sorted(read)] or [frame(0)]
    offset, told = _colour_findings(name, shown)
    return DepthFindings(share, offset, error, told)


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
    judge = ColourJudge(apart=1)
    for one in shown:
        judge.add(one.id, one.rgb, one.depth)
    return offset, (f"{name}: {judge.told}",) if judge.told else ()


def _too_far(name: str, middle: float, depth_scale: float) -> str:
    return (
        f"{name}: depth has a median of {middle:.0f} m, as millimetres have that are taken for "
        f"metres; --depth-scale {depth_scale * 1000:g} would work, --no-check maps it as it is"
    )


def _times(T_frame_cam: Pose, T_world_frame: Pose) -> Pose:
    T: Pose = T_world_frame @ T_frame_cam
    return T


def _chosen_pairs(poses: Sequence[Pose], convention: str) -> list[tuple[int, int]]:
    """Pairs of frames some motion apart by a convention of poses, spread over the recording.

    Of a camera that hardly moves, frames far apart in time.
    """
    T = [CONVENTIONS[convention](pose) for pose in poses]
    found = []
    for i in np.unique(np.linspace(0, max(len(T) - 2, 0), ANCHORS).astype(int)):
        for j in range(i + 1, min(i + REACH, len(T))):
            if np.linalg.norm(T[j][:3, 3] - T[i][:3, 3]) < APART:
                continue
            turn = np.arccos(np.clip((np.sum(T[i][:3, :3] * T[j][:3, :3]) - 1) / 2, -1, 1))
            if turn <= TURNED:
                found.append((int(i), j))
            break
    if len(found) < MIN_PAIRS and len(T) >= MIN_STILL:
        later = len(T) // 2
        found += [
            (int(i), int(i) + later)
            for i in np.linspace(0, len(T) - later - 1, PAIRS).astype(int)
            if _is_near(T[i], T[i + later])
        ]
    return found[:: max(1, -(-len(found) // PAIRS))]


def _is_near(a: Pose, b: Pose) -> bool:
    distance, turn = motion(a, b)
    return bool(distance < APART and turn <= TURNED)


def better_convention(
    found: Mapping[str, Sequence[Agreement]],
    convention: str,
    good: float = GOOD,
    poor: float = POOR,
    better: float = BETTER,
) -> tuple[float, float, str] | None:
    """Whether another convention explains depth that the given one does not.

    `found` has, by convention, how pairs of frames agree. Returns the share of agreeing points by
    the given one (0: no pair shows one scene by it, though it may by others), the share by the
    best, which is at least `good`, and its name; None where none is better.
    """
    given = median_share(found[convention]) or 0.0
    best, other = max((median_share(found[one]) or 0.0, one) for one in found)
    return (given, best, other) if given < poor and best >= max(good, given + better) else None


def _another_reading(
    name: str, pairs: list[FramePair], convention: str, readings: Readings
) -> str | None:
    """Message for poses that fit by another convention, or of another frame; None where none."""
    found = {one: [pair.share(one, 1.0, readings) for pair in pairs] for one in readings}
    better = better_convention(found, convention, poor=GOOD, better=BETTER / 3)
    if better is None:
        return None
    given, best, other = better
    option = other if other.startswith("--") else f"--pose-convention {other}"
    poses = "of another frame" if option is other else f"by the convention {other}"
    return _would_fit(name, given, best, f"these are poses {poses}", f"{option} would work")


def _another_scale(
    name: str, pairs: list[FramePair], convention: str, depth_scale: float, given: float
) -> str | None:
    """Message for depth that fits by another scale; None where none fits."""
    best, scale = _best_scale(pairs, convention)
    if best < max(GOOD, given + BETTER):
        return None
    remedy = f"--depth-scale {_usual(depth_scale / scale):g} would work instead of {depth_scale:g}"
    return _would_fit(name, given, best, f"it is {scale:.2g} times as large", remedy)


def _another_cause(name: str, pairs: list[FramePair], convention: str, given: float) -> str | None:
    """Message for depth or poses that fit once they are changed in a known way; None for others."""
    for cause, remedy, of_depth, of_pose in _causes():
        changed = [
            FramePair(of_depth(p.a), of_depth(p.b), (of_pose(p.poses[0]), of_pose(p.poses[1])))
            for p in pairs
        ]
        best = _median_share(changed, convention, 1.0) or 0.0
        if best >= max(GOOD, given + BETTER):
            return _would_fit(name, given, best, cause, f"{remedy} would work")
    return None


_Cause = tuple[str, str, Callable[[DepthSamples], DepthSamples], Callable[[Pose], Pose]]


def _causes() -> tuple[_Cause, ...]:
    """Known mistakes in files of others: the cause, what would work, and how it is undone."""

    def same(value: Any) -> Any:
        return value

    def along_axis(image: DepthSamples) -> DepthSamples:
        K = image.K
        camera = (float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2]))
        return gridded_samples(image.depth / ray_lengths(image.depth.shape, camera), K)

    def mirrored(image: DepthSamples) -> DepthSamples:
        K = image.K.copy()
        K[0, 2] = image.depth.shape[1] - 1 - K[0, 2]
        return gridded_samples(np.ascontiguousarray(image.depth[:, ::-1]), K)

    def w_first(T: Pose) -> Pose:
        x, y, z, w = quaternion_from_pose(T)
        return pose_from_quaternion(T[:3, 3], np.array([y, z, w, x]), "pose")

    def shorter(T: Pose) -> Pose:
        scaled = T.copy()
        scaled[:3, 3] /= 1000
        return scaled

    return (
        ("depth is the length of the ray",
         "depth along the optical axis, the length over sqrt(1 + ((u - cx) / fx)^2 + "
         "((v - cy) / fy)^2),", along_axis, same),
        ("colour and depth are mirrored", "both flipped left to right", mirrored, same),
        ("quaternions are w x y z", "x y z w", same, w_first),
        ("poses are in millimetres", "metres", same, shorter),
    )  # fmt: skip


def _would_fit(name: str, given: float, best: float, cause: str, remedy: str) -> str:
    return (
        f"{name}: depth does not fit the poses ({given:.0%} of the points that two frames share "
        f"agree), but does ({best:.0%}) if {cause}; {remedy}, --no-check maps it as it is"
    )


def _median_share(pairs: list[FramePair], convention: str, scale: float) -> float | None:
    return median_share([pair.share(convention, scale) for pair in pairs])


def median_share(found: Sequence[Agreement]) -> float | None:
    """Median share of agreeing points; None where too few pairs show one scene."""
    shares = [one.share for one in found if one.overlap >= OVERLAP]
    return float(np.median(shares)) if len(shares) >= MIN_PAIRS else None


def _best_scale(pairs: list[FramePair], convention: str) -> tuple[float, float]:
    """Share and factor of depth that fits best; share 0 where the largest factors fit as well.

    Those take the motion for nothing, which fits a scene that moves with the camera.
    """
    shares = np.array([_median_share(pairs, convention, s) or 0.0 for s in SCALES])
    if shares.max() - shares[-1] < BETTER / 4:
        return 0.0, 1.0
    near = shares >= shares.max() - 0.02
    return float(shares.max()), float(np.exp(np.log(SCALES[near]).mean()))


def _usual(scale: float) -> float:
    """The usual depth scale nearby, or two digits of this one."""
    nearest = min(USUAL_SCALES, key=lambda usual: abs(np.log(usual / scale)))
    return nearest if abs(np.log(nearest / scale)) < np.log(SNAP) else float(f"{scale:.2g}")


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
