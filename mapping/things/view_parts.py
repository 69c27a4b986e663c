"""Parts of views: pieces of surface that stand out of what is around them in several views.

Two points of a depth image are in different pieces where one lies in front of the plane that
touches the other: at steps of depth and in concave edges (Tateno, Tombari, Navab, IROS 2015). Of
touching pieces, those that share most of their outline are joined first, and each union is a part
as well, up to the size of a thing. Which of them is a thing, other views decide.
"""

from __future__ import annotations

import heapq
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.model.areas import along
from perception.binary_masks import connected_components
from perception.depth_image import DepthImage

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
_OUTSIDE: Final = 0.01  # share of a part's points that lie outside of it, on either side
_AXES: Final = np.array(
    [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.5**0.5, 0.5**0.5, 0), (0.5**0.5, -(0.5**0.5), 0)]
).T

Floats = NDArray[np.float64]
Labels = NDArray[np.int64]
Members = NDArray[np.intp]  # of pixels, in rows


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A part that a view shows whole."""

    points: NDArray[np.float32]  # (n, 3) [m] in the map, some of them
    carried: float  # share of the lower outline that touches something level


def parts_of(image: DepthImage) -> list[Part]:
    """Parts of a view that stand out and are as large as a thing."""
    pieces = _pieces(image)
    outlines = _Outlines(image)
    flat = pieces.ravel()
    order = np.argsort(flat, kind="stable")
    ends = np.searchsorted(flat[order], np.arange(flat.max(initial=-1) + 2))
    members = [order[start:end] for start, end in pairwise(ends)]
    free = np.array([not _is_background(image, mine) for mine in members], np.bool_)
    candidates = [mine for mine, is_free in zip(members, free, strict=True) if is_free]
    candidates += _unions(members, *_contacts(image, pieces, free))
    found = (outlines.part(mine) for mine in candidates if len(mine) >= _MIN_PIXELS)
    return [part for part in found if part is not None]


def _pieces(image: DepthImage) -> Labels:
    """(h, w) number of the piece of each pixel, -1 where depth is unknown."""
    points, normals = image.points, image.normals
    known = (normals != 0).any(-1)
    edge = ~known
    for y, x in ((0, _REACH), (_REACH, 0), (_DIAGONAL, _DIAGONAL), (_DIAGONAL, -_DIAGONAL)):
        one, middle, other = _in_line(edge.shape, y, x)
        between = points[other] - points[one]
        off = (between * normals[one]).sum(-1), -(between * normals[other]).sum(-1)
        in_front = np.maximum(*off) > image.apart[middle]
        edge[middle] |= known[one] & known[other] & in_front
    pieces = connected_components(~edge)
    for _ in range(_REACH + 1):
        pieces = _grown(image, pieces)
    return pieces


def _in_line(shape: tuple[int, ...], y: int, x: int) -> tuple[tuple[slice, slice], ...]:
    """Slices of an image: pixels, those (y, x) farther, and those twice as far."""
    (h, w), wide = shape, abs(x)
    found = [(slice(k * y, h - (2 - k) * y), slice(k * wide, w - (2 - k) * wide)) for k in range(3)]
    if x < 0:
        found = [(rows, found[2 - k][1]) for k, (rows, _) in enumerate(found)]
    return tuple(found)


def _grown(image: DepthImage, pieces: Labels) -> Labels:
    """Pieces with the pixels beside them that have none and are about as deep."""
    result, best = pieces.copy(), 2 * image.apart
    for y, x in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        beside, depth = np.roll(pieces, (y, x), (0, 1)), np.roll(image.depth, (y, x), (0, 1))
        apart = np.abs(depth - image.depth)
        taken = (pieces < 0) & (beside >= 0) & (image.depth > 0) & (apart < best)
        result[taken], best[taken] = beside[taken], apart[taken]
    return result


def _is_background(image: DepthImage, mine: Members) -> bool:
    """Whether a piece is too long for a thing, or carries things."""
    if len(mine) < _MIN_PIXELS:
        return False
    length = _length(image.points.reshape(-1, 3)[mine])
    level = image.normals.reshape(-1, 3)[mine, 2].mean() > _UP
    return length > MAX_LENGTH or bool(level and image.area.ravel()[mine].sum() > _CARRYING)


def _length(points: Floats) -> float:
    """Longest side [m] of the box around points (n, 3), along x, y and z or between x and y."""
    low, high = _ends(points @ _AXES)
    return float((high - low).max())


def _ends(values: Floats) -> Floats:
    """The lowest and the highest of values (n, ...), without the _OUTSIDE share of them."""
    low = int(_OUTSIDE * len(values))
    ends = (low, len(values) - 1 - low)
    return np.partition(values, ends, axis=0)[list(ends)]


def _contacts(
    image: DepthImage, pieces: Labels, free: NDArray[np.bool_]
) -> tuple[dict[tuple[int, int], int], list[int]]:
    """Pixels in which free pieces touch, by their numbers, and the outline of each piece."""
    found, outline = defaultdict[tuple[int, int], int](int), np.zeros(len(free), np.int64)
    for one, other in (
        (np.s_[:, :-1], np.s_[:, 1:]),
        (np.s_[:-1], np.s_[1:]),
    ):
        a, b = pieces[one].ravel(), pieces[other].ravel()
        apart = np.abs(image.depth[one] - image.depth[other]).ravel()
        differ = a != b
        for side in (a, b):
            outline += np.bincount(side[differ & (side >= 0)], minlength=len(free))
        touch = differ & (a >= 0) & (b >= 0) & (apart < 2 * image.apart[one].ravel())
        pairs = np.sort(np.stack([a[touch], b[touch]], 1), axis=1)
        pairs = pairs[free[pairs].all(1)]
        for (low, high), count in zip(*_counted(pairs), strict=True):
            found[int(low), int(high)] += int(count)
    return dict(found), outline.tolist()


def _counted(pairs: Labels) -> tuple[Labels, NDArray[np.intp]]:
    different, counts = np.unique(pairs, axis=0, return_counts=True)
    return different, counts


def _unions(
    members: list[Members], contacts: dict[tuple[int, int], int], outline: list[int]
) -> Iterator[Members]:
    """Unions of touching pieces, those first that share most of the shorter outline."""
    touching = defaultdict[int, dict[int, int]](dict)
    for (a, b), count in contacts.items():
        touching[a][b] = touching[b][a] = count
    parts, version = dict(enumerate(members)), [0] * len(members)

    def entry(a: int, b: int) -> tuple[float, int, int, int, int]:
        share = touching[a][b] / max(min(outline[a], outline[b]), 1)
        return -share, a, b, version[a], version[b]

    waiting = [entry(a, b) for a, b in contacts]
    heapq.heapify(waiting)
    while waiting:
        _, a, b, first, second = heapq.heappop(waiting)
        if a not in parts or b not in parts or (version[a], version[b]) != (first, second):
            continue
        large = len(parts[b]) >= _MIN_PIXELS
        parts[a] = np.concatenate([parts[a], parts.pop(b)])
        outline[a] += outline[b] - 2 * touching[a][b]
        version[a] += 1
        for c, count in touching.pop(b).items():
            del touching[c][b]
            if c != a:
                touching[a][c] = touching[c][a] = touching[a].get(c, 0) + count
        if large:
            yield parts[a]
        for c in touching[a]:
            heapq.heappush(waiting, entry(a, c))


class _Outlines:
    """Outlines of the parts of an image, and what lies beside them."""

    def __init__(self, image: DepthImage) -> None:
        self._image, self._size = image, image.depth.shape
        self._points = image.points.reshape(-1, 3)
        self._normals = image.normals.reshape(-1, 3)
        self._depth, self._apart = image.depth.ravel(), image.apart.ravel()
        self._inside = np.zeros(image.depth.size, np.bool_)

    def part(self, mine: Members) -> Part | None:
        """The part of these pixels, if it stands out, is whole and as large as a thing."""
        (height, width), far = self._size, _REACH + 1
        rows, columns = np.divmod(mine, width)
        if min(rows.min(), columns.min()) < far or rows.max() >= height - far:
            return None
        if columns.max() >= width - far or np.median(self._depth[mine]) > _MAX_DISTANCE:
            return None
        points = self._points[mine]
        if not _MIN_LENGTH <= _length(points) <= MAX_LENGTH:
            return None
        low, high = _ends(points[:, 2])
        self._inside[mine] = True
        stands_out, carried = self._beside(mine, low, high)
        self._inside[mine] = False
        if stands_out < _STANDS_OUT:
            return None
        return Part(points[:: -(-len(mine) // _KEPT)].astype(np.float32), carried)

    def _beside(self, mine: Members, low: float, high: float) -> tuple[float, float]:
        """Shares of the outline that lies behind or carries the part, and of the lower one."""
        width, far = self._size[1], _REACH + 1
        pairs = [
            (edge, edge + far * step)
            for step in (1, -1, width, -width)
            for edge in (mine[~self._inside[mine + step]],)
        ]
        here, there = (np.concatenate(some) for some in zip(*pairs, strict=True))
        out = ~self._inside[there]
        here, there = here[out], there[out]
        lower = self._points[here, 2] < low + max(_LOW, _BOTTOM * (high - low))
        below, known = int(lower.sum()), self._depth[there] > 0
        here, there, lower = here[known], there[known], lower[known]
        if len(here) < _OUTLINE:
            return 0.0, 0.0
        between, apart = self._points[there] - self._points[here], self._apart[here]
        off = (between * self._normals[here]).sum(1)
        deeper = self._depth[there] - self._depth[here]
        normal, middle = self._normals[mine].mean(0), self._points[mine].mean(0)
        front = (self._points[there] - middle) @ normal
        behind = (front < -apart * np.linalg.norm(normal)) | (deeper > _STEP * apart)
        level = self._normals[there, 2] > _UP
        carries = ~behind & (off > apart) & level
        level &= lower & (self._points[there, 2] < middle[2] - apart)
        level &= np.abs(self._points[there, 2] - low) < _LEVEL + apart
        level &= (between**2).sum(1) < _NEAR**2
        return float((behind | carries).mean()), float(level.sum() / max(below, 1))


_SAME: Final = 0.4  # overlap of boxes of one part in two views
_VIEWS: Final = 2  # that show a thing, at least
_CARRIED: Final = 0.1  # share of the lower outline that touches something level, on average
_OTHER: Final = 0.3  # share of the smaller box that two things have in common, at most
_AROUND: Final = 0.0125  # [m] around the points of a part; a thin one has a box, too


@dataclass(frozen=True, slots=True, eq=False)
class SeenPart:
    """A part and the view that shows it."""

    part: Part
    view: int
    stamp: float  # [s]


@dataclass(frozen=True, slots=True, eq=False)
class AgreedPart:
    """A part that views agree on, along axes turned as the walls."""

    low: Floats  # (3,) [m] corners of its box
    high: Floats
    seen: tuple[SeenPart, ...]  # once in each view


class _Boxes:
    """Boxes of parts in order of their middles along x, and how they overlap."""

    def __init__(self, seen: Sequence[SeenPart], yaw: float) -> None:
        ends = [_longest_ends(one.part.points, yaw) for one in seen]
        low, high = np.array(ends).reshape(-1, 2, 3).transpose(1, 0, 2)
        self.order = np.argsort(low[:, 0] + high[:, 0], kind="stable")
        self.low, self.high = low[self.order], high[self.order]
        self.view = np.array([one.view for one in seen], np.int64)[self.order]
        self.middle = (self.low[:, 0] + self.high[:, 0]) / 2
        self.volume = (self.high - self.low).prod(1)
        self.longest = (self.high - self.low).max(1)

    def shared(self, one: int) -> tuple[NDArray[np.intp], Floats]:
        """The boxes near one, and the volumes [m^3] that they have in common with it."""
        reach = np.array([-1, 1]) * (MAX_LENGTH + 2 * _AROUND)
        near = np.arange(*np.searchsorted(self.middle, self.middle[one] + reach))
        sides = np.minimum(self.high[near], self.high[one])
        sides = sides - np.maximum(self.low[near], self.low[one])
        return near, np.maximum(sides, 0).prod(1)

    def alike(self, one: int) -> tuple[NDArray[np.intp], Floats]:
        """The boxes that may be the same part as one, most alike first, and the overlaps."""
        near, shared = self.shared(one)
        overlap = shared / (self.volume[near] + self.volume[one] - shared)
        order = np.argsort(-overlap, kind="stable")
        order = order[overlap[order] >= _SAME]
        return near[order], overlap[order]


def _longest_ends(points: NDArray[np.float32], yaw: float) -> Floats:
    low, high = np.percentile(along(points.astype(np.float64), yaw), (1, 99), axis=0)
    return np.stack([low - _AROUND, high + _AROUND])


def agreed_parts(seen: Sequence[SeenPart], yaw: float) -> list[AgreedPart]:
    """Parts that most views agree on, first those of more views and of more size.

    Two that overlap are never both in the result. `yaw` [rad] turns their boxes.
    """
    if not seen:
        return []
    boxes = _Boxes(seen, yaw)
    alike, alive = [boxes.alike(one) for one in range(len(seen))], np.ones(len(seen), np.bool_)

    def agreeing(one: int) -> tuple[float, NDArray[np.intp]]:
        others, overlap = alike[one]
        kept = alive[others]
        others, overlap = others[kept], overlap[kept]
        first = np.unique(boxes.view[others], return_index=True)[1]
        return -float(overlap[first].sum() * boxes.longest[one] ** 0.5), others[first]

    waiting, found = [(agreeing(one)[0], one) for one in range(len(seen))], list[AgreedPart]()
    heapq.heapify(waiting)
    while waiting:
        before, one = heapq.heappop(waiting)
        if not alive[one]:
            continue
        worth, others = agreeing(one)
        if worth > before + 1e-9:
            heapq.heappush(waiting, (worth, one))
            continue
        members = tuple(seen[boxes.order[other]] for other in others)
        carried = np.mean([member.part.carried for member in members])
        if len(members) < _VIEWS or carried < _CARRIED:
            alive[one] = False
            continue
        low, high = np.median(boxes.low[others], axis=0), np.median(boxes.high[others], axis=0)
        found.append(AgreedPart(low, high, members))
        near, shared = boxes.shared(one)
        alive[near[shared > _OTHER * np.minimum(boxes.volume[near], boxes.volume[one])]] = False
        alive[one] = False
    return found
