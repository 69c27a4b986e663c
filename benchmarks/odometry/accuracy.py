"""Accuracy of estimated poses against true ones."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from perception.camera.poses import Pose, motion
from perception.frames import Frame
from perception.odometry.tracking import tracked
from perception.odometry.tracking_report import TrackingReport
from perception.sources.depth_check import shows_two_scenes
from perception.sources.estimated_poses import MIN_FRAMES, colour_fit_of

WRONG: Final = 0.15  # [m] of a pose that is wrong, where the report expects less


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Accuracy of a run."""

    report: TrackingReport
    ate: float  # [m] root mean square of positions, after the best rigid alignment
    worst: float  # [m]
    relative: float  # [m] median error of the motion over a metre of way
    colour_fit: float | None
    milliseconds: float  # of a core, a frame

    @property
    def silently_wrong(self) -> bool:
        """Whether a wrong pose would be mapped, and nothing says so."""
        return not self.told and self.worst > max(WRONG, self.report.error)

    @property
    def told(self) -> bool:
        """Whether a line tells that something is wrong, or the recording is refused."""
        return self.refused or shows_two_scenes(self.colour_fit)

    @property
    def refused(self) -> bool:
        """Whether nothing would be mapped."""
        report = self.report
        return (
            report.tracked < MIN_FRAMES
            or report.contradicts_itself
            or (report.mostly_lost and shows_two_scenes(self.colour_fit))
        )

    def row(self) -> str:
        """One line of a table."""
        r = self.report
        wrong = "told" if self.told else "WRONG" if self.silently_wrong else "right"
        state = "refused" if self.refused else wrong
        return (
            f"{r.tracked:4d}/{r.frames:4d} {r.way:6.1f} m  ATE {self.ate:.3f}  worst "
            f"{self.worst:.3f}  a metre {self.relative:.3f}  expected {r.error:.2f}  "
            f"contradicting {r.contradicting}/{r.compared}  {self.milliseconds:4.0f} ms  {state}"
        )


def accuracy(frames: Sequence[Frame]) -> Accuracy:
    """Track frames and compare their poses with the true ones, `T_map_cam`."""
    before = time.process_time()
    odometry = tracked(lambda: frames)
    poses, report = odometry.poses(), odometry.report()
    seconds = time.process_time() - before
    found = [(p, f.T_map_cam) for p, f in zip(poses, frames, strict=True) if p is not None]
    errors = _errors(found) if len(found) > 2 else np.zeros(1)
    return Accuracy(
        report,
        float(np.sqrt((errors**2).mean())),
        float(errors.max()),
        _relative(found),
        colour_fit_of(frames.__getitem__, len(frames)),
        1000 * seconds / max(len(frames), 1),
    )


def aligned(found: Sequence[tuple[Pose, Pose]]) -> Pose:
    """The rigid motion (4, 4) that takes estimated positions nearest to true ones (Umeyama)."""
    p = np.array([T[:3, 3] for T, _ in found])
    q = np.array([T[:3, 3] for _, T in found])
    U, _, Vt = np.linalg.svd((q - q.mean(0)).T @ (p - p.mean(0)))
    T = np.eye(4)
    T[:3, :3] = U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt
    T[:3, 3] = q.mean(0) - T[:3, :3] @ p.mean(0)
    return T


def _errors(found: Sequence[tuple[Pose, Pose]]) -> NDArray[np.float64]:
    """Distances [m] of positions after the best rigid alignment."""
    T = aligned(found)
    p = np.array([P[:3, 3] for P, _ in found])
    return np.linalg.norm(p @ T[:3, :3].T + T[:3, 3] - [Q[:3, 3] for _, Q in found], axis=1)


def _relative(found: Sequence[tuple[Pose, Pose]]) -> float:
    """Median error [m] of the motion between poses a metre of way apart."""
    way = np.cumsum([0, *(motion(a, b)[0] for (_, a), (_, b) in pairwise(found))])
    errors = []
    for i, at in enumerate(way):
        j = int(np.searchsorted(way, at + 1.0))
        if j < len(way):
            (p, a), (q, b) = found[i], found[j]
            errors.append(motion(np.linalg.inv(a) @ b, np.linalg.inv(p) @ q)[0])
    return float(np.median(errors)) if errors else 0.0
