"""Outlines of the rooms of a grid: traced along the cells' sides, then simplified."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.areas import Area, Ring, area_of, signed_area
from mapping.occupancy.connected_components import connected_components

_LEAST_HOLE: Final = 0.5  # [m^2] smaller ones are part of the room

_Corner = tuple[int, int]


def room_areas(
    rooms: NDArray[np.int32],
    origin: NDArray[np.float64],
    cell: float,
    *,
    reach: float,
    noise: float,
) -> tuple[Area, ...]:
    """The area [m] of each of `rooms` (nx, ny), numbered from 0, -1 for none.

    Rooms reach up to `reach` [m] beyond their cells, or to where the next one does: the walls
    between them, and what stands along these. Outlines deviate by up to `noise` [m] from the cells.
    """
    steps = round(reach / cell)
    grown = np.pad(rooms, steps, constant_values=-1)
    for _ in range(steps):
        grown = _grown(grown)
    corner = origin - steps * cell
    return tuple(_area(grown == k, corner, cell, noise) for k in range(int(rooms.max()) + 1))


def _grown(rooms: NDArray[np.int32]) -> NDArray[np.int32]:
    """Each cell of no room given to the room of a neighbour, the lowest number of several."""
    none = np.iinfo(np.int32).max
    beside = np.pad(np.where(rooms < 0, none, rooms), 1, constant_values=none)
    for axis in (0, 1):  # over squares of three by three, so that corners stay corners
        along = np.moveaxis(beside, axis, 0)
        along = np.minimum.reduce([along[:-2], along[1:-1], along[2:]])
        beside = np.moveaxis(along, 0, axis)
    return np.where((rooms < 0) & (beside != none), beside, rooms).astype(np.int32)


def _area(mask: NDArray[np.bool_], corner: NDArray[np.float64], cell: float, noise: float) -> Area:
    parts = connected_components(mask)
    mask = parts == np.argmax(np.bincount(parts[mask]))
    traced = sorted(_rings(mask), key=lambda ring: -abs(signed_area(ring)))
    holes = [r for r in traced[1:] if abs(signed_area(r)) * cell**2 >= _LEAST_HOLE]
    for tolerance in (noise, noise / 3, 0.0):
        outline = [
            [tuple(np.round(corner + np.array(at) * cell, 2).tolist()) for at in ring]
            for ring in (_simplified(ring, tolerance / cell) for ring in (traced[0], *holes))
        ]
        try:
            return area_of(outline)
        except ValueError:  # it crosses itself, or a hole has vanished
            continue
    at = np.argwhere(mask)
    (x0, y0), (x1, y1) = corner + at.min(axis=0) * cell, corner + (at.max(axis=0) + 1) * cell
    return Area(float(x0), float(x1), float(y0), float(y1))


def _rings(mask: NDArray[np.bool_]) -> list[Ring]:
    """Rings of corners [cells] around the cells of `mask`, which lies to their left."""
    padded = np.pad(mask, 1)
    following: dict[_Corner, list[_Corner]] = {}
    # the side of a cell that each neighbour is missing at, walked with the cell to the left
    for dx, dy, start, end in (
        (0, -1, (0, 0), (1, 0)),
        (1, 0, (1, 0), (1, 1)),
        (0, 1, (1, 1), (0, 1)),
        (-1, 0, (0, 1), (0, 0)),
    ):
        beside = padded[1 + dx : padded.shape[0] - 1 + dx, 1 + dy : padded.shape[1] - 1 + dy]
        for x, y in np.argwhere(mask & ~beside).tolist():
            following.setdefault((x + start[0], y + start[1]), []).append((x + end[0], y + end[1]))
    rings = []
    while following:
        at = first = next(iter(following))
        ring, heading = [at], (0, 0)
        while True:
            choices = following[at]
            # where two rings touch, the one that turns left stays with its own cell
            left = (at[0] - heading[1], at[1] + heading[0])
            after = left if left in choices else choices[0]
            choices.remove(after)
            if not choices:
                del following[at]
            heading = (after[0] - at[0], after[1] - at[1])
            at = after
            if at == first:
                break
            ring.append(at)
        rings.append(tuple((float(x), float(y)) for x, y in ring))
    return rings


def _simplified(ring: Ring, tolerance: float) -> Ring:
    """The ring without corners that lie within `tolerance` of the line past them.

    Douglas and Peucker (Cartographica 10, 1973), on the two halves of the ring.
    """
    points = np.array(ring)
    first = int(np.argmin(points.sum(axis=1)))
    points = np.roll(points, -first, axis=0)
    far = int(np.argmax(np.linalg.norm(points - points[0], axis=1)))
    kept = np.zeros(len(points) + 1, np.bool_)
    closed = np.concatenate([points, points[:1]])
    spans = [(0, far), (far, len(points))]
    kept[[0, far]] = True
    while spans:
        a, b = spans.pop()
        if b - a < 2:
            continue
        along = closed[b] - closed[a]
        off = closed[a + 1 : b] - closed[a]
        length = float(np.linalg.norm(along))
        away = np.abs(along[0] * off[:, 1] - along[1] * off[:, 0]) / max(length, 1e-9)
        worst = int(np.argmax(away))
        if away[worst] > tolerance + 1e-9:
            kept[a + 1 + worst] = True
            spans += [(a, a + 1 + worst), (a + 1 + worst, b)]
    return tuple((float(x), float(y)) for x, y in points[kept[:-1]])
