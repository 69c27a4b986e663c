"""Link of two coordinate frames: its transforms over time, and whether two publishers send them."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from perception.camera.poses import Pose, Trajectory, pose_from_quaternion
from perception.sources.ros.image_messages import NANOSECONDS

MAX_GAP: Final = 1.0  # [s] between two transforms of one link that are still interpolated
APART: Final = 0.05  # [m] between transforms of one moment by two publishers, or ...
TURNED: Final = np.radians(5.0)  # ... the angle between them, ...
TOLD: Final = 0.05  # ... of this share of all, ...
MIN_TOLD: Final = 10  # ... which are so many
TOLERANCE: Final = 0.02  # [s] before its first and after its last that a transform still holds
Table = NDArray[np.float64]


def _apart(a: Table, b: Table) -> tuple[Table, Table]:
    """Distances (n,) [m] and angles (n,) [rad] of transforms in rows (n, 8) of a link."""
    q = [rows[:, 4:] / np.linalg.norm(rows[:, 4:], axis=1, keepdims=True) for rows in (a, b)]
    cos = np.abs(np.sum(q[0] * q[1], axis=1)).clip(0, 1)
    return np.linalg.norm(a[:, 1:4] - b[:, 1:4], axis=1), 2 * np.arccos(cos)


class Link:
    """The transforms of a link: static, or over time."""

    __slots__ = ("_mixed", "_ordered", "_rows", "_run", "static")

    def __init__(self) -> None:
        self.static = False
        self._run = 0  # where the rows begin that came after stamps jumped back
        self._rows = array("d")  # stamp, x, y, z, qx, qy, qz, qw
        self._ordered: Trajectory | None = None
        self._mixed = 0.0, 0.0  # [m], [rad] between static transforms and those over time

    def __len__(self) -> int:
        return len(self._rows) // 8

    def add(self, stamp: int, numbers: Sequence[float], static: bool) -> None:
        """Add a transform of `stamp` [ns]; moving ones are passed over where it is static."""
        if static != self.static and len(self):
            apart = _apart(*np.array([[self._rows[-8:]], [(0.0, *numbers)]]))
            far, turned = self._mixed
            self._mixed = max(far, float(apart[0][0])), max(turned, float(apart[1][0]))
        if static and not self.static:
            self.static, self._run, self._rows = True, 0, array("d")
        elif self.static and not static:
            return
        self._rows.extend((stamp / NANOSECONDS, *numbers))
        self._ordered = None

    def forget(self, stamp: int, kept: int | None) -> None:
        """Forget transforms that are not needed beside a new one of `stamp` [ns]."""
        if not len(self):
            return
        if stamp / NANOSECONDS < self._rows[-8] - MAX_GAP:
            self._run = len(self._rows)
            if kept is not None:
                self.keep_last_run()
        elif kept is not None and len(self) >= 2 * kept:
            self._rows = self._rows[-8 * kept :]

    def keep_last_run(self) -> None:
        """Forget what came before stamps jumped back."""
        self._rows, self._run, self._ordered = self._rows[self._run :], 0, None

    def trajectory(self) -> Trajectory:
        """The transforms in the order of their stamps."""
        if self._ordered is None:
            table = np.frombuffer(self._rows).reshape(-1, 8)
            order = np.argsort(table[:, 0], kind="stable")
            # of several at one stamp the last
            last = np.append(np.diff(table[order, 0]) > 0, True)
            table = table[order[last]]
            q = table[:, 4:] / np.linalg.norm(table[:, 4:], axis=1, keepdims=True)
            self._ordered = Trajectory(table[:, 0], table[:, 1:4], q)
        return self._ordered

    def contradiction(self, begin: float) -> tuple[float, float]:
        """Distance [m] and angle [rad] of transforms by two publishers; 0 where there is one.

        They jump away and back, have one stamp, are static and moving, or static before `begin`.
        """
        table = np.frombuffer(self._rows).reshape(-1, 8)
        table = table[np.argsort(table[:, 0], kind="stable")]
        same = np.diff(table[:, 0]) == 0
        next_ = _apart(table[:-1], table[1:])
        if self.static:
            at_once = same | (table[1:, 0] <= begin)
            result = [
                max(mixed, float(np.max(values[at_once], initial=0.0)))
                for values, mixed in zip(next_, self._mixed, strict=True)
            ]
            return (
                result[0] if result[0] > APART else 0.0,
                result[1] if result[1] > TURNED else 0.0,
            )
        if len(self) < MIN_TOLD:
            return 0.0, 0.0
        result = []
        beyond = _apart(table[:-2], table[2:])
        for values, back, least in zip(next_, beyond, (APART, TURNED), strict=True):
            off = (values[:-1] + values[1:]) / 2
            away = (off > least) & (off > 2 * back)
            twice = values[same & (values > least)]
            few = away.mean() < TOLD and len(twice) < TOLD * len(table)
            result.append(0.0 if few else float(np.median(np.concatenate([off[away], twice]))))
        return result[0], result[1]

    def at(self, stamp: float) -> Pose | None:
        """Pose (4, 4) of the child in its parent at `stamp` [s]; None where it is not known."""
        trajectory = self.trajectory()
        if self.static:
            # each holds until the next, as of a head that turns; the last before the first
            i = int(np.searchsorted(trajectory.stamp, stamp, "right")) - 1
            return pose_from_quaternion(trajectory.t[i], trajectory.q[i], "static transform")
        return trajectory.at(stamp, TOLERANCE, MAX_GAP)

    def held(self, stamp: float, wait: float) -> Pose | None:
        """Pose at any stamp, that of the ends beyond them; None up to `wait` [s] after the last."""
        first, last = self.trajectory().stamp[[0, -1]]
        if last < stamp <= last + wait:
            return None
        return self.trajectory().at(float(np.clip(stamp, first, last)), np.inf, np.inf)
