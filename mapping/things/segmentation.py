"""Segmentation of the surface: its large flat parts, and the things that stand out from them.

A flat part is a connected piece of a slab two voxels thick, level or along the walls, large enough
for a table top, a cupboard's front or a wall. The rest falls into connected parts, and those
too large for a thing into parts of one colour.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.oriented_boxes import along
from mapping.things.colour_parts import colour_parts
from perception.binary_masks import broad_parts, connected_components
from perception.colours import lab_colours

_LEVEL: Final = 0.2  # [m^2] of a level part that carries things, ...
_UPRIGHT: Final = 0.15  # [m^2] ... and of an upright one
_WINDOW: Final = 7  # voxels, the side of a square; a flat part fills ...
_FILLED: Final = 0.6  # ... this share
_THICK: Final = 7  # voxels in line across a flat part, at most
_APART: Final = 4  # voxels between two flat parts, one behind the other, ...
_BESIDE_ANOTHER: Final = 0.5  # ... and the share of the smaller that does, at most
_SKIN: Final = 1  # voxels beside a flat part that belong to it
_MIN_VOXELS: Final = 10  # of a thing
_LONGEST: Final = 1.0  # [m] a side of a thing, at most
_DENSE: Final = 7  # of 18 voxels around one, where parts that are too large hold together
_GAP: Final = 4  # voxels between a thing and what carries it, with the skin of that
_CARRYING: Final = 4  # voxels of a level part below a thing, at least
_BEHIND: Final = 0.3  # share of the back of a thing at which the wall is seen
_THIN: Final = 3  # voxels, the thickness up to which a part may be a piece of a flat part ...
_BESIDE: Final = 10  # ... so many voxels beside it
_SQUARE: Final = 16  # voxels, the side of a square of the index

Floats = NDArray[np.float64]
Cells = NDArray[np.int64]  # (n, 3)


@dataclass(frozen=True, slots=True, eq=False)
class Segments:
    """Voxels by the part they belong to, along axes turned by `yaw`."""

    cells: Cells
    part: NDArray[np.int64]  # (n,) number of the thing, -1 for flat parts and single voxels
    flat: NDArray[np.bool_]  # (n, 3) whether a voxel is in a flat part across x, y or z


def segments(points: Floats, colours: NDArray[np.uint8], size: float, yaw: float) -> Segments:
    """Flat parts and things among voxels with side `size` [m].

    `points` (n, 3) [m] are their centres, `colours` (n, 3) their red, green and blue.
    """
    cells, turned = _cells(points, size), _cells(along(points, yaw), size)
    least = np.array([_UPRIGHT, _UPRIGHT, _LEVEL]) / size**2
    upright = [in_flat_parts(turned, axis, float(least[axis])) for axis in (0, 1)]
    flat = np.stack([*upright, in_flat_parts(cells, 2, float(least[2]))], 1)
    part = np.full(len(cells), -1, np.int64)
    free = np.flatnonzero(~flat.any(1))
    part[free] = connected_parts(cells[free], _SIDES)
    large = _Large(turned, _LONGEST / size)
    _split_where_thin(part, cells, large)
    _split_by_colour(part, cells, lab_colours(colours), large)
    across, number = [VoxelIndex(turned[flat[:, axis]]) for axis in range(3)], 0
    for mine in members(part):
        kept = len(mine) >= _MIN_VOXELS and _is_thing(turned[mine], across)
        part[mine] = number if kept else -1
        number += kept
    return Segments(turned, part, flat)


def _cells(points: Floats, size: float) -> Cells:
    cells: Cells = np.floor(points / size).astype(np.int64)
    cells -= cells.min(0, initial=0)
    return cells


class VoxelIndex:
    """Voxels sorted by squares seen from above, so that those in a box are counted at once."""

    def __init__(self, cells: Cells) -> None:
        squares = cells[:, :2] // _SQUARE
        self._rows = int(squares[:, 1].max(initial=0)) + 1
        keys = squares[:, 0] * self._rows + squares[:, 1]
        order = np.argsort(keys, kind="stable")
        self._keys, self._cells = keys[order], cells[order]

    def count(self, low: NDArray[np.int64], high: NDArray[np.int64]) -> int:
        """Voxels from `low` (3,) to `high` (3,), both included."""
        (left, front), (right, back) = low[:2] // _SQUARE, high[:2] // _SQUARE
        first, last = np.clip((front, back), 0, self._rows - 1)
        columns = np.arange(left, right + 1) * self._rows
        starts = np.searchsorted(self._keys, columns + first)
        ends = np.searchsorted(self._keys, columns + last, "right")
        near = (self._cells[start:end] for start, end in zip(starts, ends, strict=True))
        return sum(int(((some >= low) & (some <= high)).all(1).sum()) for some in near)


def _is_thing(mine: Cells, across: Sequence[VoxelIndex]) -> bool:
    """Whether a part stands on something or hangs, and is no piece of a flat part.

    `across` are the voxels of flat parts across x, y and z.
    """
    if _is_flake(mine, across):
        return False
    thick = bool((np.ptp(mine, axis=0) + 1 >= _THIN).all())
    return _stands(mine, across[2]) or (thick and _hangs(mine, across))


def members(part: NDArray[np.int64]) -> list[NDArray[np.intp]]:
    """Indices of the voxels of each part."""
    order = np.argsort(part, kind="stable")
    order = order[np.searchsorted(part[order], 0) :]
    return np.split(order, np.flatnonzero(np.diff(part[order])) + 1) if len(order) else []


@dataclass(frozen=True, slots=True, eq=False)
class _Large:
    """Parts that are longer than a thing along an axis."""

    turned: Cells
    longest: float  # voxels

    def of(self, part: NDArray[np.int64]) -> list[NDArray[np.intp]]:
        """Indices of the voxels of each of them."""
        return [
            mine
            for mine in members(part)
            if (np.ptp(self.turned[mine], axis=0) >= self.longest).any()
        ]


def _split_where_thin(part: NDArray[np.int64], cells: Cells, large: _Large) -> None:
    """Split large parts where only edges or a few voxels join them."""
    for mine in large.of(part):
        own, number = cells[mine], int(part.max()) + 1
        within = _neighbours(own) >= _DENSE
        part[mine] = -1
        part[mine[within]] = number + connected_parts(own[within], _SIDES)


def _split_by_colour(
    part: NDArray[np.int64], cells: Cells, lab: NDArray[np.float32], large: _Large
) -> None:
    """Split parts that are still large between neighbours of different colours."""
    for mine in large.of(part):
        number = int(part.max()) + 1
        part[mine] = number + colour_parts(lab[mine], *touching(cells[mine], _TOUCHING))


def _neighbours(cells: Cells) -> NDArray[np.int64]:
    """(n,) how many of the 18 voxels around each one are there."""
    one, other = touching(cells, _TOUCHING)
    return np.bincount(np.concatenate([one, other]), minlength=len(cells))


def _stands(mine: Cells, level: VoxelIndex) -> bool:
    """Whether a level part lies below the underside of a thing."""
    low, high = mine.min(0), mine.max(0)
    return level.count(low - (1, 1, _GAP), np.array([*(high[:2] + 1), low[2]])) >= _CARRYING


def _hangs(mine: Cells, across: Sequence[VoxelIndex]) -> bool:
    """Whether an upright part lies behind much of a thing."""
    low, high = mine.min(0), mine.max(0)
    for axis in (0, 1):
        reach = np.where(np.arange(3) == axis, _GAP, 0)
        back = np.delete(high - low, axis) + 1
        if across[axis].count(low - reach, high + reach) >= _BEHIND * back.prod():
            return True
    return False


def _is_flake(mine: Cells, across: Sequence[VoxelIndex]) -> bool:
    """Whether voxels are a thin piece of a flat part that goes on beside them."""
    low, high = mine.min(0), mine.max(0)
    for axis in range(3):
        if high[axis] - low[axis] < _THIN:
            reach = np.where(np.arange(3) == axis, 1, _BESIDE)
            if across[axis].count(low - reach, high + reach) >= len(mine):
                return True
    return False


def in_flat_parts(cells: Cells, axis: int, least: float) -> NDArray[np.bool_]:
    """(n,) which voxels are in a slab across `axis` with a piece of at least `least` voxels.

    Of pieces that lie behind each other, the largest counts.
    """
    thin = run_lengths(cells, axis) <= _THICK
    u, v = (cells[:, other] for other in range(3) if other != axis)
    shape, layers = (int(u.max(initial=0)) + 1, int(v.max(initial=0)) + 1), cells[:, axis]
    order = np.argsort(layers, kind="stable")
    starts = np.searchsorted(layers[order], np.arange(layers.max(initial=0) + 3))
    pieces = list[tuple[int, int, Cells]]()  # voxels, layer and cells (m, 2)
    for layer in range(len(starts) - 2):
        slab = order[starts[layer] : starts[layer + 2]]  # two layers, since noise spreads a plane
        slab = slab[thin[slab]]
        if len(slab) < least:
            continue
        mask = np.zeros(shape, np.bool_)
        mask[u[slab], v[slab]] = True
        mask = broad_parts(mask, _WINDOW, _FILLED)
        if mask.sum() < least:
            continue
        parts = connected_components(mask)
        sizes = np.bincount(parts[mask])
        where = np.argwhere(mask)
        of = parts[mask]
        voxels = np.bincount(parts[u[slab], v[slab]] + 1, minlength=len(sizes) + 1)[1:]
        pieces += [(int(voxels[k]), layer, where[of == k]) for k in np.flatnonzero(sizes >= least)]
    held, beside = np.zeros(len(cells), np.bool_), np.zeros(len(cells), np.bool_)
    last = len(starts) - 1
    for _, layer, where in sorted(pieces, key=lambda piece: (-piece[0], piece[1])):
        mask = np.zeros(shape, np.bool_)
        mask[where[:, 0], where[:, 1]] = True
        own = order[starts[layer] : starts[layer + 2]]
        own = own[mask[u[own], v[own]] & thin[own]]
        if beside[own].mean() > _BESIDE_ANOTHER:
            continue
        for marked, more in ((held, _SKIN), (beside, _APART)):
            near = order[starts[max(layer - more, 0)] : starts[min(layer + 2 + more, last)]]
            marked[near[mask[u[near], v[near]] & thin[near]]] = True
    return held


def run_lengths(cells: Cells, axis: int) -> NDArray[np.int64]:
    """(n,) how many voxels in line along `axis`, without a gap, each one is among."""
    order = np.lexsort((cells[:, axis], *(cells[:, k] for k in range(3) if k != axis)))
    apart = (np.diff(cells[order], axis=0) != np.eye(3, dtype=np.int64)[axis]).any(1)
    run = np.concatenate([[0], np.cumsum(apart)]) if len(cells) else np.empty(0, np.int64)
    lengths = np.empty(len(cells), np.int64)
    lengths[order] = np.bincount(run)[run]
    return lengths


def touching(cells: Cells, steps: Cells) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Indices (m,) and (m,) of voxels that lie one of `steps` apart, each pair once."""
    spans = cells.max(0, initial=0) + 3
    keys = ((cells[:, 0] + 1) * spans[1] + cells[:, 1] + 1) * spans[2] + cells[:, 2] + 1
    order = np.argsort(keys)
    ordered, pairs = keys[order], [np.empty((2, 0), np.intp)]
    for x, y, z in steps:
        wanted = keys + (x * spans[1] + y) * spans[2] + z
        at = np.minimum(np.searchsorted(ordered, wanted), len(keys) - 1)
        found = np.flatnonzero(ordered[at] == wanted) if len(keys) else at
        pairs.append(np.stack([found, order[at[found]]]))
    one, other = np.concatenate(pairs, 1)
    return one, other


def connected_parts(cells: Cells, steps: Cells) -> NDArray[np.int64]:
    """(n,) numbers, from 0, of the parts of voxels that are joined by `steps`."""
    one, other = touching(cells, steps)
    label = np.arange(len(cells))  # of each voxel, the first of its part so far
    while len(one):
        np.minimum.at(label, np.maximum(one, other), np.minimum(one, other))
        while (label != (first := label[label])).any():
            label = first
        one, other = label[one], label[other]
        apart = one != other
        one, other = one[apart], other[apart]
    return np.unique(label, return_inverse=True)[1].astype(np.int64)


#: steps to half of the voxels that share a side or an edge with one, and a side
_TOUCHING: Final = np.array(
    [
        (x, y, z)
        for x in (-1, 0, 1)
        for y in (-1, 0, 1)
        for z in (-1, 0, 1)
        if (x, y, z) > (0, 0, 0) and abs(x) + abs(y) + abs(z) < 3
    ]
)
_SIDES: Final = np.eye(3, dtype=np.int64)
