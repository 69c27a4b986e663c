"""Known mistakes in depth and poses of others, of which one or two may explain what does not fit.

Lengths of rays for depth, mirrored images, other orders of quaternions, other units, poses of the
body that carries the camera.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np

from perception.camera.depth_agreement import DepthSamples, gridded_samples, register
from perception.camera.poses import (
    CONVENTIONS,
    Pose,
    hand_eye,
    mount_numbers,
    pose_from_quaternion,
    quaternion_from_pose,
)
from perception.no_return import ray_lengths
from perception.sources.depth_readings import (
    APART,
    BETTER,
    GOOD,
    MIN_PAIRS,
    FramePair,
    SamplesAt,
    best_scale,
    chosen_pairs,
    pairs_by,
    share_of,
    usual,
    would_fit,
)

FAR_STEP: Final = 2.0  # [m] between frames, in the middle, of poses that may be in millimetres
MAX_MOUNT: Final = 2.0  # [m] from the origin of a body to a camera on it
SAME: Final = 0.02  # by which the share of a plainer reading may be less
STEP: Final = 0.1  # [m] between two frames whose motion is measured by depth ...
SHARED: Final = 0.5  # ... which share so much of their points


def another_cause(name: str, pairs: list[FramePair], convention: str, given: float) -> str | None:
    """Message for depth or poses that fit once they are changed in a known way; None for others."""
    for cause in _causes():
        changed = [cause.undone(pair) for pair in pairs]
        best = share_of(changed, convention, 1.0) or 0.0
        if best >= max(GOOD, given + BETTER):
            return would_fit(name, given, best, cause.text, f"{cause.remedy} would work")
    return None


def disparity_for_depth(
    name: str, pairs: list[FramePair], convention: str, focal: float, given: float
) -> str | None:
    """Message for depth that is disparity, by the focal length [px]; None where it is none."""
    known = [one.depth for pair in pairs for one in (pair.a, pair.b)]
    constant = 2 * float(np.nanmedian(np.concatenate([z.ravel() for z in known]))) ** 2
    cause = _Cause("it is disparity", "", lambda image: _inverse(image, constant))
    best, scale = best_scale([cause.undone(pair) for pair in pairs], convention)
    if best < max(GOOD, given + BETTER):
        return None
    remedy = (
        f"--disparity {scale * constant / focal:.2g} would work, about, or the baseline [m] of its "
        "cameras with --depth-scale, the units a pixel"
    )
    return would_fit(name, given, best, cause.text, remedy)


def two_causes(
    name: str,
    poses: Sequence[Pose],
    convention: str,
    depth_scale: float,
    samples_at: SamplesAt,
    given: float,
) -> str | None:
    """Message for depth and poses that fit once two known mistakes are undone; None for others.

    All pairs of a mistake in poses and one in depth are tried, and those of two in either.
    """
    of_depth = [c for c in _causes() if c.of_depth is not _same]
    of_poses = [c for c in _causes() if c.of_pose is not _same]
    others = [_convention(one) for one in CONVENTIONS if one != convention]
    least, tried = max(GOOD, given + BETTER), list[tuple[float, float, tuple[_Cause, ...]]]()
    readings = [(), *((c,) for c in others), *((c,) for c in of_poses), tuple(of_poses)]
    readings += [(c, other) for c in of_poses for other in others]
    for changes in readings:
        read = [_with(changes, T, CONVENTIONS[convention]) for T in poses]
        if any(c.shortens for c in changes) and _middle_step(poses) < FAR_STEP:
            continue
        pairs = pairs_by(read, "camera-to-world", samples_at)
        for wrong in [(), *((c,) for c in of_depth), tuple(of_depth)]:
            known = (*changes, *wrong)
            undone = pairs
            for cause in wrong:
                undone = [cause.undone(pair) for pair in undone]
            if len(known) == 2:
                tried.append((share_of(undone, "camera-to-world", 1.0) or 0.0, 1.0, known))
            elif len(known) == 1 and not known[0].shortens:
                tried.append((*best_scale(undone, "camera-to-world"), known))
    best, scale, causes = max(tried, key=lambda one: one[0])
    if best < least:
        return None
    texts, remedies = [c.text for c in causes], [c.remedy for c in causes]
    if len(causes) == 1:
        texts.append(f"it is {scale:.2g} times as large")
        remedies.append(f"--depth-scale {usual(depth_scale / scale):g}")
    both = f"{' and '.join(remedies)} would work together"
    return would_fit(name, given, best, f"two things are undone: {' and '.join(texts)}", both)


def _with(changes: Sequence[_Cause], T: Pose, convention: Callable[[Pose], Pose]) -> Pose:
    """A pose as read without mistakes, camera to world."""
    for cause in changes:
        if cause.convention:
            convention = CONVENTIONS[cause.convention]
        else:
            T = cause.of_pose(T)
    return convention(T)


def _middle_step(poses: Sequence[Pose]) -> float:
    places = np.array([T[:3, 3] for T in poses])
    return (
        float(np.median(np.linalg.norm(np.diff(places, axis=0), axis=1))) if len(poses) > 1 else 0
    )


def another_body(
    name: str, poses: Sequence[Pose], samples_at: SamplesAt, given: float
) -> str | None:
    """Message for poses of a body that carries the camera; None where they are of no such body.

    Where the camera sits follows from its motions by depth alone, and other pairs confirm it.
    """
    fits = list[tuple[float, str, Pose]]()
    for plain in ("ros", "opengl", ""):
        for convention in ("camera-to-world", "world-to-camera"):
            body = [CONVENTIONS[convention](T) for T in poses]
            X = CONVENTIONS[plain](np.eye(4)) if plain else _mount(body, samples_at)
            camera = [T @ X for T in body]
            if np.linalg.norm(X[:3, 3]) > MAX_MOUNT:
                continue  # another scale of depth or poses looks alike
            pairs = pairs_by(camera, "camera-to-world", samples_at)
            fits.append((share_of(pairs, "camera-to-world", 1.0) or 0.0, convention, X))
    best = max((share for share, *_ in fits), default=0.0)
    if best < max(GOOD, given + BETTER):
        return None
    share, convention, X = next(fit for fit in fits if fit[0] >= best - SAME)
    turned = "" if convention == "camera-to-world" else f"--pose-convention {convention} with "
    remedy = f"{turned}--camera-in body={mount_numbers(X)} for a folder without it"
    remedy = f"another mount in tf, {remedy}, or --poses estimate would work"
    return would_fit(name, given, share, "these are poses of what carries it", remedy)


def _mount(body: Sequence[Pose], samples_at: SamplesAt) -> Pose:
    """Pose (4, 4) of the camera on a body, by the body's poses and the camera's depth."""
    X = np.eye(4)
    for apart in (STEP, APART, APART):  # wider pairs once the motion is known about
        motions = list[tuple[Pose, Pose]]()
        for i, j in chosen_pairs(body, "camera-to-world", apart):
            T = np.linalg.inv(body[i]) @ body[j]
            start = np.eye(4) if apart == STEP else np.linalg.inv(X) @ T @ X
            found = register(samples_at(i), samples_at(j), start)
            if found.after.share >= GOOD and found.after.overlap >= SHARED:
                motions.append((T, found.T_a_b))
        if len(motions) >= MIN_PAIRS:
            X = hand_eye(*np.array(motions).swapaxes(0, 1))
    return X


def _same(value: Any) -> Any:
    return value


@dataclass(frozen=True, slots=True)
class _Cause:
    """A known mistake in files of others: what would work, and how it is undone."""

    text: str
    remedy: str
    of_depth: Callable[[DepthSamples], DepthSamples] = _same
    of_pose: Callable[[Pose], Pose] = _same
    convention: str = ""  # by which poses are read instead
    shortens: bool = False  # whether motions become much shorter, as nothing may contradict

    def undone(self, pair: FramePair) -> FramePair:
        """The pair without the mistake."""
        a, b = (self.of_pose(T) for T in pair.poses)
        return FramePair(self.of_depth(pair.a), self.of_depth(pair.b), (a, b))


def _convention(name: str) -> _Cause:
    option = f"--pose-convention {name}"
    return _Cause(f"poses are by the convention {name}", option, convention=name)


def _inverse(image: DepthSamples, constant: float) -> DepthSamples:
    return gridded_samples((constant / image.depth).astype(np.float32), image.K)


def _along_axis(image: DepthSamples) -> DepthSamples:
    K = image.K
    camera = (float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2]))
    return gridded_samples(image.depth / ray_lengths(image.depth.shape, camera), K)


def _mirrored(image: DepthSamples) -> DepthSamples:
    K = image.K.copy()
    K[0, 2] = image.depth.shape[1] - 1 - K[0, 2]
    return gridded_samples(np.ascontiguousarray(image.depth[:, ::-1]), K)


def _w_first(T: Pose) -> Pose:
    x, y, z, w = quaternion_from_pose(T)
    return pose_from_quaternion(T[:3, 3], np.array([y, z, w, x]), "pose")


def _w_last(T: Pose) -> Pose:
    x, y, z, w = quaternion_from_pose(T)
    return pose_from_quaternion(T[:3, 3], np.array([w, x, y, z]), "pose")


def _shorter(T: Pose, factor: float = 1000) -> Pose:
    scaled = T.copy()
    scaled[:3, 3] /= factor
    return scaled


def _other_hand(T: Pose) -> Pose:
    S = np.diag([1.0, -1.0, 1.0, 1.0])
    return np.asarray(S @ T @ S)


def _causes() -> tuple[_Cause, ...]:
    return (
        _Cause("depth is the length of the ray",
               "depth along the optical axis, the length over sqrt(1 + ((u - cx) / fx)^2 + "
               "((v - cy) / fy)^2),", _along_axis),
        _Cause("colour and depth are mirrored", "both flipped left to right", _mirrored),
        _Cause("quaternions are w x y z", "x y z w", of_pose=_w_first),
        _Cause("quaternions are x y z w", "a first line with the names of the columns, or a name "
               "that does not end with .csv,", of_pose=_w_last),
        _Cause("poses are in millimetres", "metres", of_pose=_shorter, shortens=True),
        _Cause("poses are in centimetres", "metres", of_pose=partial(_shorter, factor=100),
               shortens=True),
        _Cause("poses are left-handed with y up, as Unity's", "S T S with S = diag(1, -1, 1, 1)",
               of_pose=_other_hand),
    )  # fmt: skip
