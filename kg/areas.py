"""Areas of the map's horizontal plane: rectangles, and polygons with their bounding rectangle.

An outline is a ring of corners (x, y) [m], and further rings for holes; none repeats its first
corner at its end. A point is inside where a ray from it crosses an odd number of sides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, pairwise
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

Ring = tuple[tuple[float, float], ...]
Outline = tuple[Ring, ...]  # () stands for the rectangle itself

MOST_CORNERS: Final = 2000  # of an outline
FARTHEST: Final = 1e6  # [m] from the origin to a corner
_LEAST_AREA: Final = 1e-12  # [m^2]


@dataclass(frozen=True, slots=True)
class Rectangle:
    """Axis-aligned rectangle of the map's horizontal plane [m]; its sides belong to it.

    Not validated here: who reads one from outside checks it (`kg.facts`, `mapping.places.layout`).
    """

    xmin: float
    xmax: float
    ymin: float
    ymax: float

    @property
    def size(self) -> tuple[float, float]:
        """Width along x and depth along y [m]."""
        return self.xmax - self.xmin, self.ymax - self.ymin

    @property
    def area(self) -> float:
        """Area [m^2]."""
        return (self.xmax - self.xmin) * (self.ymax - self.ymin)

    @property
    def centre(self) -> tuple[float, float]:
        """Midpoint (x, y) [m]."""
        return (self.xmin + self.xmax) / 2, (self.ymin + self.ymax) / 2

    def contains(self, x: float, y: float) -> bool:
        """Point-in-rectangle test of (x, y) [m]."""
        return self.xmin <= x <= self.xmax and self.ymin <= y <= self.ymax

    def contains_each(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Point-in-rectangle test of many points, `x` and `y` [m] of one shape or broadcast."""
        inside = (x >= self.xmin) & (x <= self.xmax) & (y >= self.ymin) & (y <= self.ymax)
        return np.asarray(inside)

    def union(self, other: Rectangle) -> Rectangle:
        """Bounding rectangle of both."""
        return Rectangle(
            min(self.xmin, other.xmin),
            max(self.xmax, other.xmax),
            min(self.ymin, other.ymin),
            max(self.ymax, other.ymax),
        )


@dataclass(frozen=True, slots=True)
class Area(Rectangle):
    """A rectangle, or with an `outline` the polygon whose bounding rectangle the sides are."""

    outline: Outline = field(default=(), kw_only=True)

    @property
    def area(self) -> float:
        """Area [m^2], without that of holes."""
        if not self.outline:
            return Rectangle.area.__get__(self)  # type: ignore[no-any-return]
        outer, *holes = (abs(signed_area(ring)) for ring in self.outline)
        return outer - sum(holes)

    @property
    def centre(self) -> tuple[float, float]:
        """A point (x, y) [m] well inside: the middle, or of a polygon what is inside nearest it."""
        if not self.outline:
            return Rectangle.centre.__get__(self)  # type: ignore[no-any-return]
        middle = _centroid(self.outline[0])
        if self.contains(*middle):
            return middle
        x, y = (
            low + (np.arange(32) + 0.5) / 32 * (high - low)
            for low, high in ((self.xmin, self.xmax), (self.ymin, self.ymax))
        )
        inside = np.argwhere(self.contains_each(x[:, None], y[None, :]))
        if not len(inside):
            return self.outline[0][0]
        points = np.stack([x[inside[:, 0]], y[inside[:, 1]]], axis=1)
        nearest = points[int(np.argmin(np.linalg.norm(points - middle, axis=1)))]
        return float(nearest[0]), float(nearest[1])

    @property
    def rings(self) -> Outline:
        """The outline; that of a rectangle is its four corners."""
        return self.outline or (
            (
                (self.xmin, self.ymin),
                (self.xmax, self.ymin),
                (self.xmax, self.ymax),
                (self.xmin, self.ymax),
            ),
        )

    def contains(self, x: float, y: float) -> bool:
        """Point-in-polygon test of (x, y) [m]."""
        return bool(self.contains_each(np.array([x]), np.array([y]))[0])

    def contains_each(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Point-in-polygon test of many points, `x` and `y` [m] of one shape or broadcast."""
        inside = Rectangle.contains_each(self, x, y)
        if not self.outline or not inside.any():
            return inside
        x, y = np.broadcast_arrays(x, y)
        inside[inside] = _inside(self.outline, x[inside], y[inside])
        return inside

    def shifted(self, dx: float) -> Self:
        """The same area, moved by `dx` [m] along x."""
        moved = tuple(tuple((x + dx, y) for x, y in ring) for ring in self.outline)
        return replace(self, xmin=self.xmin + dx, xmax=self.xmax + dx, outline=moved)


def area_of(outline: Sequence[Sequence[tuple[float, float]]]) -> Area:
    """The area with that outline [m]: the outer ring, then those of holes.

    A ring's last corner may repeat its first. An axis-aligned rectangle is recognised. Raises
    ValueError, saying what is wrong, where the outline does not enclose one area.
    """
    rings = tuple(_open(ring) for ring in outline)
    problem = _problem(rings)
    if problem:
        raise ValueError(problem)
    corners = np.array(rings[0])
    (xmin, ymin), (xmax, ymax) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
    box = {(xmin, ymin), (xmax, ymin), (xmax, ymax), (xmin, ymax)}
    rectangular = len(rings) == 1 and len(rings[0]) == 4 and set(rings[0]) == box
    return Area(xmin, xmax, ymin, ymax, outline=() if rectangular else rings)


def _open(ring: Sequence[tuple[float, float]]) -> Ring:
    """`ring` without corners that repeat the one before them, or at the end the first."""
    corners = [(float(x), float(y)) for x, y in ring]
    kept = [b for a, b in pairwise([None, *corners]) if a != b]
    return tuple(c for c in kept[:-1] if c is not None) + tuple(
        c for c in kept[-1:] if c is not None and (len(kept) == 1 or c != kept[0])
    )


def _problem(rings: Outline) -> str | None:
    """Why `rings` are no outline, and what would work; None if they are one."""
    if not rings:
        return "an outline without corners; a ring of (x, y) would work"
    count = sum(len(ring) for ring in rings)
    if count > MOST_CORNERS:
        return f"an outline of {count} corners; up to {MOST_CORNERS} would work"
    if not np.isfinite([*chain.from_iterable(rings)]).all():
        return "an outline with a corner that is not finite; metres would work"
    corners = chain.from_iterable(chain.from_iterable(rings))
    if max(map(abs, corners), default=0.0) > FARTHEST:
        return f"an outline with a corner beyond {FARTHEST:g} m; metres of the map would work"
    for ring in rings:
        if len(ring) < 3 or abs(signed_area(ring)) < _LEAST_AREA:
            return "an outline that encloses nothing; three corners or more around it would work"
    if _crosses_itself(rings):
        return "an outline that crosses itself; corners in their order around it would work"
    return None


def signed_area(ring: Ring) -> float:
    """Area of a ring by the shoelace formula [m^2]; positive where the ring runs anticlockwise."""
    x, y = np.array(ring).T
    x, y = x - x[0], y - y[0]
    return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) / 2)


def _centroid(ring: Ring) -> tuple[float, float]:
    x, y = np.array(ring).T
    x0, y0 = x[0], y[0]
    x, y = x - x0, y - y0
    cross = x * np.roll(y, -1) - np.roll(x, -1) * y
    cx, cy = (float(np.sum((c + np.roll(c, -1)) * cross) / (3 * np.sum(cross))) for c in (x, y))
    return float(x0) + cx, float(y0) + cy


def _sides(rings: Outline) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(n, 2) starts and (n, 2) ends of all sides."""
    starts = np.concatenate([np.array(ring) for ring in rings])
    ends = np.concatenate([np.roll(np.array(ring), -1, axis=0) for ring in rings])
    return starts, ends


def _inside(rings: Outline, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Even-odd rule for points `x`, `y` (n,)."""
    odd = np.zeros(x.shape, np.bool_)
    for (x1, y1), (x2, y2) in zip(*_sides(rings), strict=True):
        if y1 != y2:
            between = (y1 > y) != (y2 > y)
            odd ^= between & (x < (x2 - x1) / (y2 - y1) * (y - y1) + x1)
    return odd


def _crosses_itself(rings: Outline) -> bool:
    """Whether two sides cross properly; rings may touch."""
    a, b = _sides(rings)
    along = b - a

    def side(p: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, n) on which side of each line each point of `p` lies: -1, 0 or 1."""
        off = p[None, :, :] - a[:, None, :]
        return np.sign(along[:, None, 0] * off[..., 1] - along[:, None, 1] * off[..., 0])

    apart = side(a) * side(b) < 0
    return bool((apart & apart.T).any())
