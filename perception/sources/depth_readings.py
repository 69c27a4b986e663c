"""Other readings of a recording's depth and poses, of which one may fit where its own does not.

Another unit of depth, another convention of poses, poses of another frame or of the body that
carries the camera, or one of a few known mistakes.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np

from perception.camera.depth_agreement import (
    LONE,
    Agreement,
    DepthSamples,
    agreement,
    gridded_samples,
    register,
)
from perception.camera.poses import (
    CONVENTIONS,
    Pose,
    hand_eye,
    motion,
    mount_numbers,
    pose_from_quaternion,
    quaternion_from_pose,
)
from perception.no_return import ray_lengths

ANCHORS: Final = 240  # frames that pairs are looked for from, spread evenly
PAIRS: Final = 12  # of frames, by each of two readings of the poses
APART: Final = 0.3  # [m] between the two frames of a pair ...
TURNED: Final = np.radians(25.0)  # ... that are not turned more against each other
STEP: Final = 0.1  # [m] between two frames whose motion is measured by depth ...
RUN: Final = 8  # frames beside each other that may contradict those before and after them
SHARED: Final = 0.5  # ... which share so much of their points
SAME: Final = 0.02  # by which the share of a plainer reading may be less
REACH: Final = 60  # frames between the two, at most
MIN_STILL: Final = 20  # frames of a camera that hardly moves, to conclude anything
MIN_PAIRS: Final = 5  # pairs that show enough of one scene, to conclude anything
OVERLAP: Final = 0.15  # share of a pair's points that both frames show
GOOD: Final = 0.85  # share of points that agree; sound recordings have 0.95
POOR: Final = 0.8  # another reading may be the right one
BETTER: Final = 0.15  # by how much another reading must agree better
SCALES: Final = 2.0 ** np.arange(-5, 5.01, 0.25)  # factors of depth that are tried
USUAL_SCALES: Final = (1.0, 10.0, 100.0, 256.0, 1000.0, 2000.0, 4000.0, 5000.0, 6553.5, 10000.0)
FAR_STEP: Final = 2.0  # [m] between frames, in the middle, of poses that may be in millimetres
MAX_MOUNT: Final = 2.0  # [m] from the origin of a body to a camera on it
SNAP: Final = 1.2  # factor within which a depth scale is taken for a usual one

Readings = Mapping[str, Callable[[Pose], Pose]]  # poses as read -> camera to world, by name
SamplesAt = Callable[[int], DepthSamples]  # index of a frame -> its depth


@dataclass(frozen=True, slots=True)
class FramePair:
    """Two frames that may show one scene."""

    a: DepthSamples
    b: DepthSamples
    poses: tuple[Pose, Pose]  # camera -> world, as read
    numbers: tuple[int, int] = (0, 0)  # of the frames

    def share(self, convention: str, scale: float, readings: Readings = CONVENTIONS) -> Agreement:
        """Agreement by another reading of the poses and depth `scale` times as large."""
        T_a, T_b = (readings[convention](T) for T in self.poses)
        T = np.linalg.inv(T_a) @ T_b
        T[:3, 3] /= scale
        return agreement(self.a, self.b, T)


def pairs_by(poses: Sequence[Pose], convention: str, samples_at: SamplesAt) -> list[FramePair]:
    """Pairs of frames as of `chosen_pairs`; `samples_at` gives the depth of a frame."""
    chosen = chosen_pairs(poses, convention)
    return [
        FramePair(samples_at(i), samples_at(j), (poses[i], poses[j]), (i, j)) for i, j in chosen
    ]


Judged = tuple[FramePair, Agreement]


def judged_pairs(pairs: Sequence[FramePair], convention: str) -> list[Judged]:
    """Pairs with their agreement as they are read."""
    return [(pair, pair.share(convention, 1.0)) for pair in pairs]


def chosen_pairs(
    poses: Sequence[Pose], convention: str, apart: float = APART
) -> list[tuple[int, int]]:
    """Pairs of frames some motion apart by a convention of poses, spread over the recording.

    Of a camera that hardly moves, frames far apart in time.
    """
    T = [CONVENTIONS[convention](pose) for pose in poses]
    found = []
    for i in np.unique(np.linspace(0, max(len(T) - 2, 0), ANCHORS).astype(int)):
        for j in range(i + 1, min(i + REACH, len(T))):
            if np.linalg.norm(T[j][:3, 3] - T[i][:3, 3]) < apart:
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


def lone_frames(
    poses: Sequence[Pose],
    convention: str,
    judged: Sequence[Judged],
    samples_at: SamplesAt,
) -> set[int]:
    """Frames of poor pairs in runs that contradict the frames before and after, which agree."""
    poor = [pair for pair, found in judged if _fit(found) < LONE]
    if len(poor) > len(judged) / 2:
        return set()  # no minority

    def found(i: int, j: int) -> Agreement:
        pair = FramePair(samples_at(i), samples_at(j), (poses[i], poses[j]))
        return pair.share(convention, 1.0)

    def end(n: int, step: int) -> int | None:
        """The first frame beyond `n` that its neighbour towards `n` contradicts."""
        for one in range(n + step, n + step * (RUN + 1), step):
            if not 0 <= one < len(poses):
                return None
            if _fit(found(*sorted((one, one - step)))) < LONE:
                return one
        return None

    def is_lone(n: int) -> bool:
        first, last = end(n, -1), end(n, 1)
        if first is None or last is None or last - first > RUN + 1:
            return False
        return (around := found(first, last)).share >= GOOD and around.overlap >= OVERLAP

    return {n for n in sorted({number for pair in poor for number in pair.numbers}) if is_lone(n)}


def share_without(judged: Sequence[Judged], lone: Collection[int] = ()) -> float | None:
    """`median_share` of the pairs without the `lone` frames."""
    return median_share([found for pair, found in judged if not {*pair.numbers} & {*lone}])


def _fit(found: Agreement) -> float:
    """Share of agreeing points of a pair; 1 where it shows too little of one scene."""
    return found.share if found.overlap >= OVERLAP else 1.0


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


def another_reading(
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


def another_scale(
    name: str, pairs: list[FramePair], convention: str, depth_scale: float, given: float
) -> str | None:
    """Message for depth that fits by another scale; None where none fits."""
    best, scale = _best_scale(pairs, convention)
    if best < max(GOOD, given + BETTER):
        return None
    remedy = f"--depth-scale {_usual(depth_scale / scale):g} would work instead of {depth_scale:g}"
    remedy += f", or poses {1 / scale:.2g} times as long where that is no unit of depth"
    return _would_fit(name, given, best, f"it is {scale:.2g} times as large", remedy)


def another_cause(name: str, pairs: list[FramePair], convention: str, given: float) -> str | None:
    """Message for depth or poses that fit once they are changed in a known way; None for others."""
    for cause in _causes():
        changed = [cause.undone(pair) for pair in pairs]
        best = share_of(changed, convention, 1.0) or 0.0
        if best >= max(GOOD, given + BETTER):
            return _would_fit(name, given, best, cause.text, f"{cause.remedy} would work")
    return None


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
                tried.append((*_best_scale(undone, "camera-to-world"), known))
    best, scale, causes = max(tried, key=lambda one: one[0])
    if best < least:
        return None
    texts, remedies = [c.text for c in causes], [c.remedy for c in causes]
    if len(causes) == 1:
        texts.append(f"it is {scale:.2g} times as large")
        remedies.append(f"--depth-scale {_usual(depth_scale / scale):g}")
    both = f"{' and '.join(remedies)} would work together"
    return _would_fit(name, given, best, f"two things are undone: {' and '.join(texts)}", both)


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
    return _would_fit(name, given, share, "these are poses of what carries it", remedy)


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


def _would_fit(name: str, given: float, best: float, cause: str, remedy: str) -> str:
    return (
        f"{name}: depth does not fit the poses ({100 * given:.0f} % of the points that two frames "
        f"share agree), but does ({100 * best:.0f} %) if {cause}; {remedy}, --no-check maps it as "
        "it is"
    )


def share_of(pairs: list[FramePair], convention: str, scale: float) -> float | None:
    """Median share of agreeing points of pairs by a reading; None where too few show one scene."""
    return median_share([pair.share(convention, scale) for pair in pairs])


def median_share(found: Sequence[Agreement]) -> float | None:
    """Median share of agreeing points; None where too few pairs show one scene."""
    shares = [one.share for one in found if one.overlap >= OVERLAP]
    return float(np.median(shares)) if len(shares) >= MIN_PAIRS else None


def _best_scale(pairs: list[FramePair], convention: str) -> tuple[float, float]:
    """Share and factor of depth that fits best; share 0 where the largest factors fit as well.

    Those take the motion for nothing, which fits a scene that moves with the camera.
    """
    shares = np.array([share_of(pairs, convention, s) or 0.0 for s in SCALES])
    if shares.max() - shares[-1] < BETTER / 4:
        return 0.0, 1.0
    near = shares >= shares.max() - 0.02
    return float(shares.max()), float(np.exp(np.log(SCALES[near]).mean()))


def _usual(scale: float) -> float:
    """The usual depth scale nearby, or two digits of this one."""
    nearest = min(USUAL_SCALES, key=lambda usual: abs(np.log(usual / scale)))
    return nearest if abs(np.log(nearest / scale)) < np.log(SNAP) else float(f"{scale:.2g}")
