"""Placement of labels: cleaned, cut to a width, and laid without overlap on rings around points.

All boxes are (xmin, ymin, xmax, ymax) in the same unit, pixels for a picture.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from numpy.typing import ArrayLike, NDArray

from planner.execution.protocol import cleaned

Boxes = NDArray[np.float64]
Box = tuple[float, float, float, float]
#: boxes (k, 4) -> whether each covers something that must stay free, (k,) bool
Covers = Callable[[Boxes], NDArray[np.bool_]]

_SQUARE: Final = 64.0  # [px] side of the squares that index taken boxes
#: Directions to try, the better readable first: right, left, above, below, then the corners.
_DIRECTIONS = np.array(
    [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1)], np.float64
)


@dataclass(frozen=True, slots=True)
class Label:
    """One label where it fits."""

    index: int  # of the point it belongs to
    box: Box
    distant: bool  # whether the label needs a line to its point


def place_labels(
    points: ArrayLike,
    sizes: ArrayLike,
    obstacles: ArrayLike = (),
    *,
    bounds: Box,
    gap: float = 6.0,
    rings: int = 5,
    covers: Covers | None = None,
) -> tuple[Label, ...]:
    """Boxes for labels of `sizes` (n, 2) near `points` (n, 2); labels without room are left out.

    No box overlaps another box or one of `obstacles` (m, 4), leaves `bounds`, or is rejected by
    `covers`; points within half a `gap` of a box count as overlapped. Points with many
    neighbours are served first, and among equals in their order.
    """
    xy = np.asarray(points, np.float64).reshape(-1, 2)
    wh = np.asarray(sizes, np.float64).reshape(-1, 2)
    dots = np.hstack([xy - gap / 2, xy + gap / 2])
    taken = _Taken()
    for box in np.vstack([np.asarray(obstacles, np.float64).reshape(-1, 4), dots]):
        taken.add(box)
    placed = []
    for index in _crowded_first(xy, float(np.median(wh[:, 0])) if len(wh) else 0.0):
        for ring in range(rings):
            boxes = _around(xy[index], wh[index], gap * (1 + 1.5 * ring))
            free = _inside(boxes, bounds) & (~covers(boxes) if covers else True)
            box = next((box for box in boxes[free] if not taken.overlaps(box)), None)
            if box is not None:
                taken.add(box)
                a, b, c, d = (float(v) for v in box)
                placed.append(Label(int(index), (a, b, c, d), ring > 0))
                break
    return tuple(sorted(placed, key=lambda label: label.index))


class _Taken:
    """Boxes that nothing may overlap, indexed by the grid squares that they touch."""

    def __init__(self) -> None:
        self._squares: dict[tuple[int, int], list[Box]] = defaultdict(list)

    def add(self, box: Boxes) -> None:
        """Take a box (4,)."""
        for square in self._touched(box):
            self._squares[square].append((box[0], box[1], box[2], box[3]))

    def overlaps(self, box: Boxes) -> bool:
        """Whether a box (4,) overlaps one that is taken."""
        a, b, c, d = box.tolist()
        return any(
            xmin < c and a < xmax and ymin < d and b < ymax
            for square in self._touched(box)
            for xmin, ymin, xmax, ymax in self._squares.get(square, ())
        )

    @staticmethod
    def _touched(box: Boxes) -> Iterator[tuple[int, int]]:
        a, b, c, d = (int(edge // _SQUARE) for edge in box.tolist())
        return product(range(a, c + 1), range(b, d + 1))


def overlapping(boxes: Boxes, taken: Boxes) -> NDArray[np.bool_]:
    """(k,) whether each of `boxes` (k, 4) overlaps one of `taken` (m, 4)."""
    low, high = boxes[:, None, :2], boxes[:, None, 2:]
    apart = np.any((taken[:, :2] >= high) | (taken[:, 2:] <= low), axis=2)
    return np.asarray(~np.all(apart, axis=1), np.bool_)


class WallsBelow:
    """Tests which boxes on the page [px] lie over walls.

    A summed-area table (Crow 1984) makes the cost of a box independent of its size.
    """

    def __init__(
        self, walls: NDArray[np.bool_], corner: NDArray[np.float64], cell: float, axes: Axes
    ) -> None:
        """`walls` (nx, ny) are cells of the side `cell` [m] from `corner` (2,) [m] on."""
        self._corner, self._cell = corner, cell
        self._to_map = axes.transData.inverted()
        counted = walls.cumsum(axis=0, dtype=np.int32).cumsum(axis=1)
        self._sums = np.pad(counted, ((1, 0), (1, 0)))  # [i, j]: of cells below i and j

    def __call__(self, boxes: Boxes) -> NDArray[np.bool_]:
        """(k,) whether a cell of a wall lies below each of `boxes` (k, 4) [px]."""
        low = self._cells(boxes[:, :2], np.floor)
        high = self._cells(boxes[:, 2:], np.ceil)
        (i0, j0), (i1, j1) = low.T, high.T
        sums = self._sums
        return np.asarray(sums[i1, j1] - sums[i0, j1] - sums[i1, j0] + sums[i0, j0] > 0)

    def _cells(self, corners: Boxes, rounding: np.ufunc) -> NDArray[np.intp]:
        cells = rounding((self._to_map.transform(corners) - self._corner) / self._cell)
        return np.asarray(np.clip(cells, 0, np.array(self._sums.shape) - 1), np.intp)


def wall_cells(
    walls: NDArray[np.float64], corners: NDArray[np.float64], cell: float
) -> NDArray[np.bool_]:
    """The cells between two `corners` (2, 2) [m] that `walls` (w, 2, 2) [m] cross."""
    found = np.zeros(np.ceil((corners[1] - corners[0]) / cell).astype(int) + 1, np.bool_)
    for start, end in walls:
        count = int(np.ceil(np.linalg.norm(end - start) / cell)) + 1
        at = np.rint((np.linspace(start, end, count) - corners[0]) / cell).astype(int)
        i, j = at[((at >= 0) & (at < found.shape)).all(axis=1)].T
        found[i, j] = True
    return found


def _crowded_first(xy: Boxes, reach: float) -> NDArray[np.intp]:
    """Order of points by the number of others in the 3 x 3 squares of side `reach` around each."""
    squares = np.floor(xy / max(reach, 1e-9)).astype(np.int64)
    counts = Counter(map(tuple, squares.tolist()))
    around = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)]
    neighbours = [sum(counts[x + i, y + j] for i, j in around) for x, y in squares.tolist()]
    return np.argsort(-np.array(neighbours, np.int64), kind="stable")


def _around(point: Boxes, size: Boxes, gap: float) -> Boxes:
    """(k, 4) boxes that touch a ring of radius `gap` about `point`, in order of preference."""
    slanted = np.where(np.abs(_DIRECTIONS).sum(axis=1, keepdims=True) > 1, 0.75, 1.0)
    centre = point + _DIRECTIONS * (size / 2) + _DIRECTIONS * gap * slanted
    return np.hstack([centre - size / 2, centre + size / 2])


def _inside(boxes: Boxes, bounds: Box) -> NDArray[np.bool_]:
    low, high = np.array(bounds[:2]), np.array(bounds[2:])
    return np.asarray(((boxes[:, :2] >= low) & (boxes[:, 2:] <= high)).all(axis=1))


MAX_LETTERS: Final = 40  # letters of a label
_CUT: Final = "…"


def drawable(text: object, max_letters: int = MAX_LETTERS) -> str:
    """Text from any source as one line of at most `max_letters` letters."""
    line = cleaned(text)
    return line if len(line) <= max_letters else line[: max_letters - 1].rstrip() + _CUT


class TextMeasure:
    """Measures the size of text on a figure [px]."""

    def __init__(self, figure: Figure) -> None:
        self._figure = figure
        canvas: Any = FigureCanvasAgg(figure)
        self._renderer = canvas.get_renderer()
        self._known: dict[tuple[str, float, str], tuple[float, float]] = {}

    def size(self, text: str, size: float, weight: str = "normal") -> tuple[float, float]:
        """Width and height of `text` in letters of `size` [pt]."""
        key = text, size, weight
        if key not in self._known:
            probe = Text(0, 0, text, fontsize=size, fontweight=weight)
            probe.set_figure(self._figure)
            xmin, ymin, xmax, ymax = self.box(probe)
            self._known[key] = xmax - xmin, ymax - ymin
        return self._known[key]

    def box(self, text: Text) -> Box:
        """The bounding box of a text."""
        xmin, ymin, xmax, ymax = text.get_window_extent(self._renderer).extents
        return float(xmin), float(ymin), float(xmax), float(ymax)

    def fitted(self, text: str, width: float, size: float, weight: str = "normal") -> str:
        """`text`, cut to a width of `width` [px]."""
        kept = len(text)
        while kept > 1 and self.size(self._cut(text, kept), size, weight)[0] > width:
            wide = self.size(self._cut(text, kept), size, weight)[0]
            kept = min(kept - 1, max(1, int(kept * width / wide)))
        return self._cut(text, kept)

    @staticmethod
    def _cut(text: str, kept: int) -> str:
        return text if kept >= len(text) else text[:kept].rstrip() + _CUT
