"""The page of a drawn map: heading, frame with axes in metres, scale bar, legend, listing.

Legend and listing stand below the drawing, or beside a tall one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, MaxNLocator
from numpy.typing import ArrayLike, NDArray

from hereabouts.display.plots.label_placement import TextMeasure, drawable
from hereabouts.display.plots.palette import FAINT, INK, OUTLINE, ROUTE
from kg.model.areas import Rectangle

DPI: Final = 160
LONGER_SIDE: Final = (10.5, 20.0)  # [inch] of a usual and of a crowded drawing
MAX_SCALE: Final = 2.2  # [inch/m]
ROOM: Final = 0.45  # [inch^2] for an object and its label
MIN_EXTENT: Final = 3.0  # [m] around a lone object
FLATTEST: Final = 0.14  # shorter side over longer side
TALL: Final = 1.25  # minimum height over width of a drawing with legend and listing beside it

_LEFT, _RIGHT, _TOP, _BOTTOM = 0.35, 0.35, 0.88, 0.45  # [inch] around the drawing
_GUTTER: Final = 0.4  # [inch] between the drawing and legend or listing beside it
_BESIDE: Final = (1.9, 3.4)  # [inch] width of a legend beside the drawing, and with a listing
_LONG: Final = 5  # maximum number of items of a listing in one column
_ROW: Final = 0.24  # [inch] of a line of the legend
_ITEM: Final = (0.26, 0.40)  # [inch] of an item of the listing, without and with its detail
_TICK: Final = 7.0  # [pt] of the numbers on the axes
_SIZE: Final = 8.5  # [pt] of legend and listing
_TITLE: Final = (15.0, 40)  # [pt] of the title, and the length above which it is smaller
_SCALE_BAR: Final = 1.6  # [inch] that the scale bar takes of the first row below the drawing
_HANDLE: Final = 0.36  # [inch] of a mark of the legend with the space around its name


@dataclass(frozen=True, slots=True)
class Extent(Rectangle):
    """Extent of the map frame that the picture shows [m]."""

    @property
    def width(self) -> float:
        """[m] along x."""
        return self.xmax - self.xmin

    @property
    def height(self) -> float:
        """[m] along y."""
        return self.ymax - self.ymin

    @classmethod
    def around(cls, points: NDArray[np.float64]) -> Extent:
        """All of `points` (n, 2) [m] with a margin; a small square without points."""
        if not len(points):
            points = np.zeros((1, 2))
        lo, hi = points.min(axis=0), points.max(axis=0)
        margin = max(0.25, 0.03 * float((hi - lo).max()))
        lo, hi = lo - margin, hi + margin
        least = max(MIN_EXTENT, FLATTEST * float((hi - lo).max()))
        lack = np.maximum(least - (hi - lo), 0) / 2
        lo, hi = lo - lack, hi + lack
        return cls(float(lo[0]), float(hi[0]), float(lo[1]), float(hi[1]))


@dataclass(frozen=True, slots=True)
class ListItem:
    """An entry of a listing: its number on the drawing, a line of text, and a fainter line."""

    number: str
    head: str
    detail: str = ""


@dataclass(frozen=True, slots=True)
class Listing:
    """Numbered items with a line of summary above."""

    title: str
    items: tuple[ListItem, ...]


@dataclass(frozen=True, slots=True)
class _Block:
    """Legend and listing as they stand together; lengths in inches."""

    width: float
    rows: list[list[Line2D]]  # of the legend
    indent: float  # of the legend
    listing: Listing | None
    columns: int  # of the listing

    @property
    def height(self) -> float:
        return _ROW * len(self.rows) + _height(self.listing, self.columns)


class Sheet:
    """A white page with an empty framed drawing of `extent`, and all texts around it."""

    def __init__(
        self,
        extent: Extent,
        spots: ArrayLike = (),
        *,
        title: str = "",
        line: str = "",
        legend: Sequence[Line2D] = (),
        listing: Listing | None = None,
    ) -> None:
        self._extent = extent
        self._scale = _scale(extent, np.asarray(spots, np.float64).reshape(-1, 2))  # [inch/m]
        self.figure = Figure(dpi=DPI)
        self.measure = TextMeasure(self.figure)
        labels = (_metres_text(round(y)) for y in (extent.ymin, extent.ymax))
        self._left = _LEFT + max(self.measure.size(label, _TICK)[0] for label in labels) / DPI
        width, height = extent.width * self._scale, extent.height * self._scale
        beside = height > TALL * width
        block = self._block_beside(legend, listing) if beside else self._block(legend, listing)
        high = max(height, block.height) if beside else height
        self._page = np.array(  # [inch]
            [
                self._left + width + _RIGHT + (block.width + _GUTTER if beside else 0.0),
                _TOP + high + _BOTTOM + (0.3 if beside else block.height + 0.1),
            ]
        )
        self.figure.set_size_inches(*self._page)
        self.axes = self._framed(width, height)
        self._write_heading(title, line)
        self._draw_scale_bar(_TOP + height + _BOTTOM + 0.12)
        x, y = (width + _GUTTER, _TOP) if beside else (0.0, _TOP + height + _BOTTOM)
        self._write_block(block, self._left + x, y)

    def _block(self, legend: Sequence[Line2D], listing: Listing | None) -> _Block:
        """The part below the drawing: rows of the legend beside the scale bar, the listing."""
        width = self._extent.width * self._scale
        columns = 2 if listing and len(listing.items) > _LONG else 1
        rows = self._flowing(legend, width - _SCALE_BAR)
        return _Block(width, rows, _SCALE_BAR, listing, columns)

    @staticmethod
    def _block_beside(legend: Sequence[Line2D], listing: Listing | None) -> _Block:
        """The part beside the drawing: the marks of the legend in a column, the listing."""
        return _Block(_BESIDE[listing is not None], [[mark] for mark in legend], 0.0, listing, 1)

    def _write_block(self, block: _Block, x: float, y: float) -> None:
        for row in block.rows:
            self._draw_legend_row(row, x + block.indent, y)
            y += _ROW
        if block.listing is not None:
            self._write_listing(block.listing, x, y + 0.2, block.width, block.columns)

    def metres(self, points: float) -> float:
        """Length in the map [m] of so many typographic points on paper."""
        return points / 72 / self._scale

    def write_note(self, text: str) -> None:
        """A faint line at the upper right corner of the drawing."""
        x = self._left + self._extent.width * self._scale
        self._write(text, x, _TOP - 0.08, size=7, colour=FAINT, ha="right")

    def _at(self, x: float, y: float) -> tuple[float, float]:
        """Point of the figure, `x` [inch] from its left and `y` [inch] from its top."""
        return x / float(self._page[0]), 1.0 - y / float(self._page[1])

    def _framed(self, width: float, height: float) -> Axes:
        left, bottom = self._at(self._left, _TOP + height)
        extent = self._extent
        axes = self.figure.add_axes((left, bottom, width / self._page[0], height / self._page[1]))
        axes.set(xlim=(extent.xmin, extent.xmax), ylim=(extent.ymin, extent.ymax), aspect="equal")
        axes.autoscale(enable=False)
        for axis, side in ((axes.xaxis, width), (axes.yaxis, height)):
            axis.set_major_locator(MaxNLocator(max(2, round(side / 1.1)), steps=[1, 2, 5, 10]))
            axis.set_major_formatter(FuncFormatter(_metres_text))
        axes.tick_params(labelsize=_TICK, color=OUTLINE, labelcolor=FAINT, length=3, width=0.8)
        axes.spines[:].set(color=OUTLINE, linewidth=0.8)
        self._write("y [m]", 0.12, _TOP - 0.08, size=7, colour=FAINT)
        self._write(
            "x [m]", self._left + width, _TOP + height + 0.36, size=7, colour=FAINT, ha="right"
        )
        return axes

    def _write(
        self, text: str, x: float, y: float, *, size: float, colour: str, **style: Any
    ) -> None:
        """Write `text` with its baseline at (`x`, `y`) [inch] from the upper left."""
        self.figure.text(*self._at(x, y), text, fontsize=size, color=colour, **style)

    def _write_heading(self, title: str, line: str) -> None:
        room = (float(self._page[0]) - 0.5) * DPI
        size = _TITLE[0] if len(title) <= _TITLE[1] else 11.5
        title = self.measure.fitted(drawable(title, 120), room, size, "bold")
        line = self.measure.fitted(line, room, 9)
        self._write(title, 0.25, 0.38, size=size, colour=INK, fontweight="bold")
        self._write(line, 0.25, 0.6, size=9, colour=FAINT)

    def _draw_scale_bar(self, y: float) -> None:
        """A round length of at most a sixth of the width, below the drawing on the left."""
        most = min(self._extent.width / 4, 1.0 / self._scale)
        steps = [m * 10.0**e for e in range(-2, 6) for m in (1, 2, 5)]
        length = max((step for step in steps if step <= most), default=steps[0])
        x, far = self._left, self._left + length * self._scale
        (a, low), (b, high) = self._at(x, y), self._at(far, y - 0.05)
        self.figure.add_artist(Line2D([a, a, b, b], [high, low, low, high], color=INK, lw=1.2))
        self._write(f"{length:g} m", far + 0.07, y, size=_SIZE, colour=INK)

    def _flowing(self, marks: Sequence[Line2D], room: float) -> list[list[Line2D]]:
        """`marks` in rows of at most `room` [inch]."""
        rows: list[list[Line2D]] = []
        used = room + 1
        for mark in marks:
            width = self.measure.size(str(mark.get_label()), _SIZE)[0] / DPI + _HANDLE
            if used + width > room:
                rows.append([])
                used = 0.0
            rows[-1].append(mark)
            used += width
        return rows

    def _draw_legend_row(self, row: Sequence[Line2D], x: float, y: float) -> None:
        for mark in row:
            spot = Line2D([], [])
            spot.update_from(mark)
            long = mark.get_linestyle() not in ("None", "none", "")
            ends = (x + 0.0, x + 0.22) if long else (x + 0.09,)
            spot.set_data(*np.array([self._at(end, y + 0.07) for end in ends]).T)
            spot.set_transform(self.figure.transFigure)
            self.figure.add_artist(spot)
            label = str(mark.get_label())
            self._write(label, x + 0.27 if long else x + 0.2, y + 0.12, size=_SIZE, colour=INK)
            x += self.measure.size(label, _SIZE)[0] / DPI + _HANDLE

    def _write_listing(
        self, listing: Listing, x: float, y: float, room: float, columns: int
    ) -> None:
        """Items in columns, from the top of the first to the bottom of the last."""
        for number, line in enumerate(self._wrapped(listing.title, room)):
            self._write(line, x, y + 0.1 + 0.17 * number, size=_SIZE, colour=INK)
        y += 0.34 + 0.17 * number
        width, top = room / columns, y
        for column in _columns(listing.items, columns):
            for item in column:
                self._write_item(item, x, y, width)
                y += _item_height(item)
            x, y = x + width, top

    def _wrapped(self, text: str, room: float) -> list[str]:
        lines = [""]
        for word in text.split():
            longer = f"{lines[-1]} {word}".strip()
            if self.measure.size(longer, _SIZE)[0] > room * DPI and lines[-1]:
                lines.append(word)
            else:
                lines[-1] = longer
        return lines

    def _write_item(self, item: ListItem, x: float, y: float, width: float) -> None:
        style: dict[str, Any] = {"ha": "center", "va": "center_baseline", "fontweight": "bold"}
        spot = Line2D([], [], marker="o", ms=11, mfc=ROUTE, mec="none")
        spot.set_data(*np.array([self._at(x + 0.09, y + 0.06)]).T)
        spot.set_transform(self.figure.transFigure)
        self.figure.add_artist(spot)
        self._write(item.number, x + 0.09, y + 0.06, size=6.5, colour="white", **style)
        room = (width - 0.45) * DPI
        head = self.measure.fitted(item.head, room, _SIZE)
        self._write(head, x + 0.24, y + 0.1, size=_SIZE, colour=INK)
        detail = self.measure.fitted(item.detail, room, 7)
        self._write(detail, x + 0.24, y + 0.24, size=7, colour=FAINT)


def _metres_text(value: float, _: object = None) -> str:
    return f"{value:,.10g}"


def _item_height(item: ListItem) -> float:
    return _ITEM[bool(item.detail)]


def _columns(items: Sequence[ListItem], columns: int) -> list[list[ListItem]]:
    """`items` in their order, cut into columns of about the same height."""
    high, share = sum(map(_item_height, items)), 0.0
    cut: list[list[ListItem]] = [[] for _ in range(columns)]
    for item in items:
        cut[min(int(columns * share / high), columns - 1)].append(item)
        share += _item_height(item)
    return cut


def _height(listing: Listing | None, columns: int) -> float:
    """[inch] that a listing needs at most."""
    if listing is None:
        return 0.0
    return 0.7 + max(sum(map(_item_height, column)) for column in _columns(listing.items, columns))


def _scale(extent: Extent, spots: NDArray[np.float64]) -> float:
    """[inch/m]; larger for crowded `spots` (n, 2) [m], so that their labels find room."""
    longer = max(extent.width, extent.height)
    usual, most = (min(side / longer, MAX_SCALE) for side in LONGER_SIDE)
    if len(spots) < 2:
        return usual
    low, high = np.percentile(spots, [10, 90], axis=0)
    width, height = np.maximum(high - low, 1.0)
    return float(np.clip(np.sqrt(ROOM * len(spots) / (width * height)), usual, most))
