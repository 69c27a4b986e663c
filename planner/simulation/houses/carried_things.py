"""Carried things: objects that somebody moves while the robot looks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class Carry:
    """A thing that somebody carries while the robot looks.

    Before `start` it stands at the path's first point, after the last moment at the last one; in
    the house it is described where it ends.
    """

    index: int  # into House.objects
    path: NDArray[np.float64]  # (n, 3) [m] of the point it stands on
    start: float  # [s]
    speed: float = 0.7  # [m/s]

    @property
    def end(self) -> float:
        """[s] when it is put down."""
        return self.start + float(self._lengths()[-1]) / self.speed

    def offset(self, stamp: float) -> NDArray[np.float64]:
        """(3,) [m] from where it ends to where it is at `stamp` [s]."""
        along = (stamp - self.start) * self.speed
        lengths = self._lengths()
        at = [np.interp(along, lengths, self.path[:, axis]) for axis in range(3)]
        return np.asarray(np.array(at) - self.path[-1], np.float64)

    def _lengths(self) -> NDArray[np.float64]:
        """(n,) [m] of the path up to each point."""
        steps = np.linalg.norm(np.diff(self.path, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])
