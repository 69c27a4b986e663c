"""Other readings of a recording's depth and poses, of which one may fit where its own does not.

Another unit of depth, another convention of poses, or poses of another frame.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from perception.camera.depth_agreement import (
    LONE,
    Agreement,
    DepthSamples,
    agreement,
)
from perception.camera.poses import (
    CONVENTIONS,
    Pose,
    motion,
)

ANCHORS: Final = 240  # frames that pairs are looked for from, spread evenly
PAIRS: Final = 12  # of frames, by each of two readings of the poses
APART: Final = 0.3  # [m] between the two frames of a pair ...
TURNED: Final = np.radians(25.0)  # ... that are not turned more against each other
RUN: Final = 8  # frames beside each other that may contradict those before and after them
REACH: Final = 60  # frames between the two, at most
MIN_STILL: Final = 20  # frames of a camera that hardly moves, to conclude anything
MIN_PAIRS: Final = 5  # pairs that show enough of one scene, to conclude anything
OVERLAP: Final = 0.15  # share of a pair's points that both frames show
GOOD: Final = 0.85  # share of points that agree; sound recordings have 0.95
POOR: Final = 0.8  # another reading may be the right one
BETTER: Final = 0.15  # by how much another reading must agree better
SCALES: Final = 2.0 ** np.arange(-5, 5.01, 0.25)  # factors of depth that are tried
USUAL_SCALES: Final = (1.0, 10.0, 100.0, 256.0, 1000.0, 2000.0, 4000.0, 5000.0, 6553.5, 10000.0)
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
    return would_fit(name, given, best, f"these are poses {poses}", f"{option} would work")


def another_scale(
    name: str, pairs: list[FramePair], convention: str, depth_scale: float, given: float
) -> str | None:
    """Message for depth that fits by another scale; None where none fits."""
    best, scale = best_scale(pairs, convention)
    if best < max(GOOD, given + BETTER):
        return None
    remedy = f"--depth-scale {usual(depth_scale / scale):g} would work instead of {depth_scale:g}"
    remedy += f", or poses {1 / scale:.2g} times as long where that is no unit of depth"
    return would_fit(name, given, best, f"it is {scale:.2g} times as large", remedy)


def would_fit(name: str, given: float, best: float, cause: str, remedy: str) -> str:
    """The message for depth that fits once a cause is undone."""
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


def best_scale(pairs: list[FramePair], convention: str) -> tuple[float, float]:
    """Share and factor of depth that fits best; share 0 where the largest factors fit as well.

    Those take the motion for nothing, which fits a scene that moves with the camera.
    """
    shares = np.array([share_of(pairs, convention, s) or 0.0 for s in SCALES])
    if shares.max() - shares[-1] < BETTER / 4:
        return 0.0, 1.0
    near = shares >= shares.max() - 0.02
    return float(shares.max()), float(np.exp(np.log(SCALES[near]).mean()))


def usual(scale: float) -> float:
    """The usual depth scale nearby, or two digits of this one."""
    nearest = min(USUAL_SCALES, key=lambda usual: abs(np.log(usual / scale)))
    return nearest if abs(np.log(nearest / scale)) < np.log(SNAP) else float(f"{scale:.2g}")
