"""Distances between cells of a floor, for the tests of what makes floors."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.freespace.geodesic import distance_fields
from planner.freespace.grid import FreeSpace


def metres_between(space: FreeSpace, cells: ArrayLike) -> NDArray[np.float64]:
    """Geodesic distances (n, n) [m] between n cells; infinite where no path leads."""
    at = np.asarray(cells, np.intp).reshape(-1)
    fields = distance_fields(space, at).reshape(len(at), -1)
    return fields[:, at].astype(np.float64)
