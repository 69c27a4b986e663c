"""The sheet of a drawn map: axes in metres with heading, legend, and the stops of a search.

matplotlib places legend and texts outside the axes, and cuts the page to what is drawn.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, MaxNLocator
from numpy.typing import ArrayLike, NDArray

from hereabouts.display.plots.label_placement import TextMeasure, drawable
from hereabouts.display.plots.palette import FAINT, INK, OUTLINE
from kg.model.areas import Rectangle

DPI: Final = 160
LONGER_SIDE: Final = (10.5, 20.0)  # [inch] of a usual and of a crowded drawing
MAX_SCALE: Final = 2.2  # [inch/m]
ROOM: Final = 0.45  # [inch^2] for an object and its label
MIN_EXTENT: Final = 3.0  # [m] around a lone object
FLATTEST: Final = 0.14  # shorter side over longer side

_HEADING: Final = 8.0  # [inch] that a title may have above a narrow drawing
_TITLE: Final = (15.0, 40)  # [pt] of the title, and the length above which it is smaller
_SIZE: Final = 8.5  # [pt] of legend and listing
_BELOW: Final = 0.5  # [inch] between the drawing and the legend
_HANDLE: Final = 0.45  # [inch] of a mark of the legend with the space around its name
_LINE: Final = 62  # letters of a line of the listing


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


class Sheet:
    """White axes of `extent`, with a scale that fits `spots` (n, 2) [m], and the texts around."""

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
        self._scale = _scale(extent, np.asarray(spots, np.float64).reshape(-1, 2))  # [inch/m]
        self._sides = extent.width * self._scale, extent.height * self._scale  # [inch]
        self.figure = Figure(figsize=self._sides, dpi=DPI)
        self.measure = TextMeasure(self.figure)
        self.axes = self.figure.add_axes((0, 0, 1, 1))
        self._frame(extent)
        self._write_heading(title, line)
        self._write_legend(legend)
        if listing is not None:
            self._write((1, 1), (20, 0), _text_of(listing), size=_SIZE, va="top", linespacing=1.4)

    def metres(self, points: float) -> float:
        """Length in the map [m] of so many typographic points on paper."""
        return points / 72 / self._scale

    def write_note(self, text: str) -> None:
        """A faint line at the upper right corner of the drawing."""
        self._write((1, 1), (0, 4), text, size=7, color=FAINT, ha="right")

    def _frame(self, extent: Extent) -> None:
        axes = self.axes
        axes.set(xlim=(extent.xmin, extent.xmax), ylim=(extent.ymin, extent.ymax), aspect="equal")
        axes.autoscale(enable=False)
        for axis, side in zip((axes.xaxis, axes.yaxis), self._sides, strict=True):
            axis.set_major_locator(MaxNLocator(max(2, round(side / 1.1)), steps=[1, 2, 5, 10]))
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.10g}"))
        axes.tick_params(labelsize=7, color=OUTLINE, labelcolor=FAINT, length=3, width=0.8)
        axes.spines[:].set(color=OUTLINE, linewidth=0.8)
        axes.set_xlabel("x [m]", loc="right", fontsize=7, color=FAINT)
        axes.set_ylabel("y [m]", loc="top", fontsize=7, color=FAINT)

    def _write(
        self, at: tuple[float, float], offset: tuple[float, float], text: str, **style: Any
    ) -> None:
        """Write `text` at an `offset` [pt] from a point of the axes, in shares of their sides."""
        style = {"color": INK, "xycoords": "axes fraction", "textcoords": "offset points"} | style
        self.axes.annotate(text, at, offset, annotation_clip=False, **style)

    def _write_heading(self, title: str, line: str) -> None:
        room = max(self._sides[0], _HEADING) * DPI
        size = _TITLE[0] if len(title) <= _TITLE[1] else 11.5
        title = self.measure.fitted(drawable(title, 120), room, size, "bold")
        self._write((0, 1), (0, 32), title, size=size, fontweight="bold")
        self._write((0, 1), (0, 16), self.measure.fitted(line, room, 9), size=9, color=FAINT)

    def _write_legend(self, marks: Sequence[Line2D]) -> None:
        if not marks:
            return
        widest = max(self.measure.size(str(mark.get_label()), _SIZE)[0] for mark in marks) / DPI
        self.axes.legend(
            handles=marks,
            loc="upper left",
            bbox_to_anchor=(0, -_BELOW / self._sides[1]),
            ncols=min(len(marks), max(1, int(self._sides[0] / (widest + _HANDLE)))),
            fontsize=_SIZE,
            labelcolor=INK,
            frameon=False,
            borderpad=0,
            borderaxespad=0,
            handlelength=1.6,
            handletextpad=0.5,
            columnspacing=1.2,
        )


def _text_of(listing: Listing) -> str:
    """The summary, and each item with its number, in lines of `_LINE` letters."""
    lines = [*textwrap.wrap(listing.title, _LINE), ""]
    for item in listing.items:
        indent = " " * 4
        lines += textwrap.wrap(f"{item.number}  {item.head}", _LINE, subsequent_indent=indent)
        lines += textwrap.wrap(item.detail, _LINE, initial_indent=indent, subsequent_indent=indent)
    return "\n".join(lines)


def _scale(extent: Extent, spots: NDArray[np.float64]) -> float:
    """[inch/m]; larger for crowded `spots` (n, 2) [m], so that their labels find room."""
    longer = max(extent.width, extent.height)
    usual, most = (min(side / longer, MAX_SCALE) for side in LONGER_SIDE)
    if len(spots) < 2:
        return usual
    low, high = np.percentile(spots, [10, 90], axis=0)
    width, height = np.maximum(high - low, 1.0)
    return float(np.clip(np.sqrt(ROOM * len(spots) / (width * height)), usual, most))
