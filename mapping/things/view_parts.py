"""Parts of views: pieces of surface that stand out of what is around them in several views.

Two points of a depth image are in different pieces where one lies in front of the plane that
touches the other: at steps of depth and in concave edges (Tateno, Tombari, Navab, IROS 2015). Of
touching pieces, those that share most of their outline are joined first, and each union is a part
as well, up to the size of a thing. Which of them is a thing, other views decide.
"""

from __future__ import annotations

import heapq
from collections import defaultdict
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from perception.binary_masks import connected_components
from perception.depth_image import DepthImage, Planes, dot

MAX_LENGTH: Final = 1.0  # [m] longest side of a thing, at most
_MIN_LENGTH: Final = 0.06  # [m] of a part that a view shows
_REACH: Final = 3  # pixels from one to the two points that are compared, beside it
_DIAGONAL: Final = 2  # the same in x and y for points that lie obliquely
_MIN_PIXELS: Final = 20  # pixels of a part
_MAX_DISTANCE: Final = 3.5  # [m] from the camera to a part
_CARRYING: Final = 0.15  # [m^2] of a level piece, which is no part of a thing
_UP: Final = 0.8  # upward component of the normal of what carries things
_STEP: Final = 3.0  # times the noise, a step of depth
_OUTLINE: Final = 8  # pixels beside a part, at least
_STANDS_OUT: Final = 0.5  # share of its outline that lies behind a part, or carries it
_BOTTOM: Final = 0.25  # share of its height from below ...
_LOW: Final = 0.03  # [m] ... or this, in which the outline may touch what carries a part ...
_LEVEL: Final = 0.05  # [m] ... whose height differs by so much at most ...
_NEAR: Final = 0.15  # [m] ... and which is so near
_KEPT: Final = 200  # points of a part
_MEASURED: Final = 1500  # of its pixels, at most, that tell how long it is
_OUTSIDE: Final = 0.01  # share of a part's points that lie outside of it, on either side
_AXES: Final = np.array(
    [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.5**0.5, 0.5**0.5, 0), (0.5**0.5, -(0.5**0.5), 0)],
    np.float32,
)

Floats = NDArray[np.float64]
Labels = NDArray[np.int32]
Indices = NDArray[np.intp]  # of pixels, pieces or parts
Node = tuple[int, int, bool]  # two pieces or unions, and whether both are as large as a part


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A part that a view shows whole."""

    points: NDArray[np.float32]  # (n, 3) [m] in the map, some of them
    carried: float  # share of the lower outline that touches something level


def parts_of(image: DepthImage) -> list[Part]:
    """Parts of a view that stand out and are as large as a thing."""
    pieces = _pieces(image)
    flat = pieces.ravel()
    count = int(flat.max(initial=-1)) + 1
    if not count:
        return []
    small = flat.astype(np.int16) if count < 1 << 15 else flat  # is sorted several times as fast
    order = np.argsort(small, kind="stable")
    ends = np.searchsorted(flat[order], np.arange(count + 1))
    sizes = np.diff(ends)
    free = ~_are_background(image, order[ends[0] :], ends[:-1] - ends[0], sizes)
    nodes = _unions(sizes.tolist(), *_contacts(image, pieces, free))
    alone = np.flatnonzero(free & (sizes >= _MIN_PIXELS)).tolist()
    leaves, spans = _in_rows(nodes, sizes.tolist(), alone)
    chosen = [spans[n] for n in alone]
    chosen += [spans[len(sizes) + n] for n, (_, _, large) in enumerate(nodes) if large]
    if not chosen:
        return []
    pixels = np.concatenate([order[ends[leaf] : ends[leaf + 1]] for leaf in leaves])
    starts = np.cumsum([0, *sizes[leaves]])
    return _Stretches(image, flat, pixels, starts, np.array(chosen)).parts()


def _pieces(image: DepthImage) -> Labels:
    """(h, w) number of the piece of each pixel, -1 where depth is unknown."""
    points, normals = image.points, image.normals
    known = dot(normals, normals) > 0
    edge, farther = ~known, -image.apart
    for y, x in ((0, _REACH), (_REACH, 0), (_DIAGONAL, _DIAGONAL), (_DIAGONAL, -_DIAGONAL)):
        one, middle, other = _in_line(edge.shape, y, x)
        between = points[:, *other] - points[:, *one]
        in_front = dot(between, normals[:, *one]) > image.apart[middle]
        in_front |= dot(between, normals[:, *other]) < farther[middle]
        edge[middle] |= known[one] & known[other] & in_front
    pieces = connected_components(~edge).astype(np.int32)
    free = np.flatnonzero((pieces < 0) & (image.depth > 0))
    for _ in range(_REACH + 1):
        free = _grown(image, pieces, free)
    return pieces


def _in_line(shape: tuple[int, ...], y: int, x: int) -> tuple[tuple[slice, slice], ...]:
    """Slices of an image: pixels, those (y, x) farther, and those twice as far."""
    (h, w), wide = shape, abs(x)
    found = [(slice(k * y, h - (2 - k) * y), slice(k * wide, w - (2 - k) * wide)) for k in range(3)]
    if x < 0:
        found = [(rows, found[2 - k][1]) for k, (rows, _) in enumerate(found)]
    return tuple(found)


def _grown(image: DepthImage, pieces: Labels, free: Indices) -> Indices:
    """Add to pieces the `free` pixels beside them that are about as deep; those that are left."""
    flat, depth = pieces.ravel(), image.depth.ravel()  # unknown along the border of the image
    here, best, found = depth[free], 2 * image.apart.ravel()[free], flat[free]
    for step in (-1, 1, -pieces.shape[1], pieces.shape[1]):
        beside, apart = flat[free + step], np.abs(depth[free + step] - here)
        taken = (beside >= 0) & (apart < best)
        found, best = np.where(taken, beside, found), np.where(taken, apart, best)
    flat[free] = found
    return free[found < 0]


def _are_background(
    image: DepthImage, pixels: Indices, starts: Indices, sizes: Indices
) -> NDArray[np.bool_]:
    """Which pieces are too long for a thing, or carry things; from `starts` on of `pixels`."""
    large = sizes >= _MIN_PIXELS
    up = np.add.reduceat(image.normals[2].ravel()[pixels], starts, dtype=np.float64) / sizes
    area = np.add.reduceat(image.area.ravel()[pixels], starts, dtype=np.float64)
    found = large & (up > _UP) & (area > _CARRYING)
    along = _AXES @ image.points.reshape(3, -1)[:, pixels]
    ends = (edge.reduceat(along, starts, axis=1) for edge in (np.maximum, np.minimum))
    longest = np.subtract(*ends).max(0)
    for n in np.flatnonzero(large & ~found & (longest > MAX_LENGTH)):
        low, high = _ends(along[:, starts[n] : starts[n] + sizes[n]])
        found[n] = (high - low).max() > MAX_LENGTH
    return found


def _ends(values: Planes) -> tuple[Planes, Planes]:
    """The lowest and the highest of values (..., n), without the _OUTSIDE share of them."""
    low = int(_OUTSIDE * values.shape[-1])
    high = values.shape[-1] - 1 - low
    if low == 0:
        return values.min(-1), values.max(-1)
    ends = np.partition(values, (low, high))
    return ends[..., low], ends[..., high]


def _contacts(
    image: DepthImage, pieces: Labels, free: NDArray[np.bool_]
) -> tuple[dict[tuple[int, int], int], list[int]]:
    """Pixels in which free pieces touch, by their numbers, and the outline of each piece."""
    n, outline, found = len(free), np.zeros(len(free), np.int64), list[Indices]()
    for one, other in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        differ = np.flatnonzero(pieces[one] != pieces[other])
        a, b = pieces[one].ravel()[differ], pieces[other].ravel()[differ]
        for side in (a, b):
            outline += np.bincount(side[side >= 0], minlength=n)
        apart = np.abs(image.depth[one] - image.depth[other]).ravel()[differ]
        touch = (a >= 0) & (b >= 0) & (apart < 2 * image.apart[one].ravel()[differ])
        touch &= free[a] & free[b]
        a, b = a[touch].astype(np.intp), b[touch].astype(np.intp)
        found.append(np.minimum(a, b) * n + np.maximum(a, b))
    pairs, counts = np.unique(np.concatenate(found), return_counts=True)
    a, b = np.divmod(pairs, n)
    contacts = zip(zip(a.tolist(), b.tolist(), strict=True), counts.tolist(), strict=True)
    return dict(contacts), outline.tolist()


def _unions(
    sizes: list[int], contacts: dict[tuple[int, int], int], outline: list[int]
) -> list[Node]:
    """Unions of touching pieces, those first that share most of the shorter outline.

    They are numbered after the pieces, in the order in which they are made.
    """
    touching = defaultdict[int, dict[int, int]](dict)
    for (a, b), count in contacts.items():
        touching[a][b] = touching[b][a] = count
    size, version, nodes = [*sizes], [0] * len(sizes), list[Node]()
    number = {a: a for a in touching}

    waiting = [
        (-count / (min(outline[a], outline[b]) or 1), a, b, 0, 0)
        for (a, b), count in contacts.items()
    ]
    heapq.heapify(waiting)
    while waiting:
        _, a, b, first, second = heapq.heappop(waiting)
        if a not in number or b not in number or version[a] != first or version[b] != second:
            continue
        nodes.append((number[a], number.pop(b), size[b] >= _MIN_PIXELS))
        number[a] = len(sizes) + len(nodes) - 1
        outline[a] += outline[b] - 2 * touching[a][b]
        size[a] += size[b]
        version[a] += 1
        mine = touching[a]
        for c, count in touching.pop(b).items():
            del touching[c][b]
            if c != a:
                mine[c] = touching[c][a] = mine.get(c, 0) + count
        length, first = outline[a], version[a]
        for c, count in mine.items():
            shorter = outline[c] if outline[c] < length else length
            heapq.heappush(waiting, (-count / (shorter or 1), a, c, first, version[c]))
    return nodes


def _in_rows(
    nodes: list[Node], sizes: list[int], alone: list[int]
) -> tuple[list[int], dict[int, tuple[int, int]]]:
    """Pieces in an order in which each union is one stretch of pixels, and all these stretches.

    Of the pieces that are in no union those `alone`.
    """
    inside = {part for one, other, _ in nodes for part in (one, other)}
    every = (*range(len(sizes), len(sizes) + len(nodes)), *alone)
    waiting = [n for n in every if n not in inside]
    leaves, spans, at = list[int](), dict[int, tuple[int, int]](), 0
    while waiting:
        n = waiting.pop()
        if n < len(sizes):
            spans[n] = at, at + sizes[n]
            at += sizes[n]
            leaves.append(n)
        else:
            waiting += nodes[n - len(sizes)][1::-1]
    for n, (one, other, _) in enumerate(nodes, len(sizes)):
        spans[n] = spans[one][0], spans[other][1]
    return leaves, spans


class _Stretches:
    """Candidates for parts: from `spans[:, 0]` to `spans[:, 1]` of `pixels` of an image.

    `pieces` has the number of each pixel's piece, `starts` where in `pixels` each piece begins.
    """

    def __init__(
        self, image: DepthImage, pieces: Labels, pixels: Indices, starts: Indices, spans: Indices
    ) -> None:
        self._image, self._pieces, self._pixels = image, pieces, pixels
        self._starts, self._spans = starts, spans
        self._points = image.points.reshape(3, -1)
        self._normals = image.normals.reshape(3, -1)
        self._depth, self._apart = image.depth.ravel(), image.apart.ravel()
        (height, width), far = image.depth.shape, _REACH + 1
        margin = np.ones((height, width), np.bool_)
        margin[far : height - far, far : width - far] = False
        self._margin = margin.ravel()

    def parts(self) -> list[Part]:
        """Those that stand out, are whole and as large as a thing."""
        low, high = self._whole()
        if not len(low):
            return []
        stands_out, carried = self._beside(low, high)
        right = np.flatnonzero(stands_out >= _STANDS_OUT)
        some = [np.arange(s, e, -(-(e - s) // _KEPT)) for s, e in self._spans[right].tolist()]
        return [
            Part(np.ascontiguousarray(self._points[:, self._pixels[at]].T), float(share))
            for at, share in zip(some, carried[right], strict=True)
        ]

    def _sums(self, values: NDArray[Any]) -> Floats:
        """Sums of values (..., n) of all pixels, of each candidate."""
        sums = np.add.reduceat(values, self._starts[:-1], axis=-1, dtype=np.float64)
        sums = np.concatenate([np.zeros((*values.shape[:-1], 1)), sums], axis=-1).cumsum(-1)
        first, last = np.searchsorted(self._starts, self._spans).T
        return np.asarray(sums[..., last] - sums[..., first])

    def _whole(self) -> tuple[Floats, Floats]:
        """Keep the whole ones that are as large as a thing; returns lowest and highest z [m]."""
        cut, far = self._margin[self._pixels], self._depth[self._pixels] > _MAX_DISTANCE
        good = (self._sums(cut) == 0) & (self._sums(far) * 2 <= np.diff(self._spans)[:, 0])
        self._spans = self._spans[good]
        along = _AXES @ self._points[:, self._pixels]
        ends = [_ends(along[:, s : e : 1 + (e - s) // _MEASURED]) for s, e in self._spans.tolist()]
        low, high = np.array(ends, np.float64).reshape(-1, 2, len(_AXES)).transpose(1, 0, 2)
        length = (high - low).max(1)
        good = (length >= _MIN_LENGTH) & (length <= MAX_LENGTH)
        self._spans = self._spans[good]
        return low[good, 2], high[good, 2]

    def _outline(self) -> tuple[Indices, Indices, Indices, Indices]:
        """Pixels in outlines, those beyond them, and pairs: which of these, of which candidate."""
        far, width = _REACH + 1, self._image.depth.shape[1]
        rank = np.full(self._depth.size, -1)
        rank[self._pixels] = np.arange(len(self._pixels))
        inner = self._pixels[~self._margin[self._pixels]]
        edges = list[tuple[Indices, Indices, Indices]]()
        for step in (1, -1, width, -width):
            edge = inner[self._pieces[inner] != self._pieces[inner + step]]
            edges.append((edge, rank[edge + step], edge + far * step))
        here, beside, there = map(np.concatenate, zip(*edges, strict=True))
        order = np.argsort(rank[here], kind="stable")
        here, beside, there = here[order], beside[order], there[order]
        first, last = np.searchsorted(rank[here], self._spans).T
        of = np.repeat(np.arange(len(first)), last - first)
        pair = np.arange(len(of)) - np.repeat(np.cumsum(last - first) - last, last - first)
        low, high = self._spans[of].T
        outside = (beside[pair] < low) | (beside[pair] >= high)
        pair, of, low, high = pair[outside], of[outside], low[outside], high[outside]
        beyond = rank[there][pair]
        outside = (beyond < low) | (beyond >= high)
        return here, there, pair[outside], of[outside]

    def _beside(self, low: Floats, high: Floats) -> tuple[Floats, Floats]:
        """Shares of outlines that lie behind or carry a part, and of the lower ones."""
        here, there, pair, of = self._outline()
        n, points = len(low), self._points[:, there]
        between, apart = points - self._points[:, here], self._apart[here]
        known = self._depth[there] > 0
        off = dot(between, self._normals[:, here]) > apart
        deeper = self._depth[there] - self._depth[here] > np.float32(_STEP) * apart
        level = self._normals[2, there] > _UP
        near = level & (dot(between, between) < _NEAR**2)
        lower = self._points[2, here][pair] < (low + np.maximum(_LOW, _BOTTOM * (high - low)))[of]
        below = np.bincount(of[lower], minlength=n)
        pair, of, lower = (part[known[pair]] for part in (pair, of, lower))
        count, apart = np.bincount(of, minlength=n), apart[pair]
        middle, normal = (
            self._sums(some[:, self._pixels]) / np.diff(self._spans)[:, 0]
            for some in (self._points, self._normals)
        )
        ahead = sum(points[k][pair] * normal[k].astype(np.float32)[of] for k in range(3))
        ahead = ahead - (middle * normal).sum(0).astype(np.float32)[of]
        behind = ahead < -apart * np.sqrt((normal**2).sum(0)).astype(np.float32)[of]
        behind |= deeper[pair] | (off & level)[pair]
        z = points[2][pair]
        carrying = lower & near[pair] & (z < middle[2][of] - apart)
        carrying &= np.abs(z - low[of]) < _LEVEL + apart
        stands_out = np.bincount(of[behind], minlength=n) / np.maximum(count, 1)
        stands_out[count < _OUTLINE] = 0
        return stands_out, np.bincount(of[carrying], minlength=n) / np.maximum(below, 1)
