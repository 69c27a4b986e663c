"""Carried things: objects that somebody moves during a session."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class Carry:
    """An object that somebody carries during the session.

    Until `start` it stands at the first point of the path, afterwards it moves to the last one. The
    house describes it at the last one.
    """

    index: int  # into House.objects
    path: NDArray[np.float64]  # (n, 3) [m] of the point below it
    start: float  # [s]
    speed: float = 0.7  # [m/s]

    def offset(self, stamp: float) -> NDArray[np.float64]:
        """(3,) [m] from its last position to its position at `stamp` [s]."""
        along = (stamp - self.start) * self.speed
        steps = np.linalg.norm(np.diff(self.path, axis=0), axis=1)
        lengths = np.concatenate([[0.0], np.cumsum(steps)])
        at = [np.interp(along, lengths, self.path[:, axis]) for axis in range(3)]
        return np.asarray(np.array(at) - self.path[-1], np.float64)
