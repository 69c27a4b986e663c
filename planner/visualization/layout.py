"""The sheet a map is drawn on: what of the map frame it shows, and the scale bar below."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import ArrayLike, NDArray

from kg.areas import Rectangle
from planner.visualization.palette import INK

DPI: Final = 160
LONGER_SIDE: Final = (10.5, 20.0)  # [inch] of the drawing: usually, and where it is crowded
ROOM: Final = 0.45  # [inch^2] an object and its label would like to have
LEAST_WIDTH: Final = 6.5  # [inch] so that title and legend have room
LEAST_EXTENT: Final = 3.0  # [m] around a lone object
FLATTEST: Final = 0.42  # shorter side over longer side
_MARGIN: Final = 0.3  # [inch] of the page
_SCALE_TEXT: Final = 0.6  # [inch] of the scale bar's length in metres
_MARK: Final = 1.0  # [inch] of a mark of the legend with its name


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
        """All of `points` (n, 2) [m] with a margin; a small square where there are none."""
        if not len(points):
            points = np.zeros((1, 2))
        lo, hi = points.min(axis=0), points.max(axis=0)
        margin = max(0.25, 0.03 * float((hi - lo).max()))
        lo, hi = lo - margin, hi + margin
        least = max(LEAST_EXTENT, FLATTEST * float((hi - lo).max()))
        lack = np.maximum(least - (hi - lo), 0) / 2
        lo, hi = lo - lack, hi + lack
        return cls(float(lo[0]), float(hi[0]), float(lo[1]), float(hi[1]))


class Sheet:
    """A white sheet whose drawing area has the proportions of an extent."""

    def __init__(self, extent: Extent, spots: ArrayLike = ()) -> None:
        scale = _scale(extent, np.asarray(spots, np.float64).reshape(-1, 2))
        width, height = extent.width * scale, extent.height * scale
        page = max(width, LEAST_WIDTH) + 0.6, height + 1.45
        self.figure = Figure(figsize=page, dpi=DPI)
        self.axes = self.figure.add_axes(
            ((page[0] - width) / 2 / page[0], 0.65 / page[1], width / page[0], height / page[1])
        )
        self.axes.set_xlim(extent.xmin, extent.xmax)
        self.axes.set_ylim(extent.ymin, extent.ymax)
        self.axes.set_aspect("equal")
        self.axes.set_axis_off()
        self._extent = extent
        self._scale = scale  # [inch/m]

    def metres(self, points: float) -> float:
        """Length in the map [m] of so many typographic points on paper."""
        return points / 72 / self._scale

    def write_heading(self, title: str, line: str, faint: str) -> None:
        """Title and one line of detail above the drawing."""
        page = self.figure.get_size_inches()
        left, top = 0.3 / float(page[0]), self.axes.get_position().y1
        figure = self.figure
        figure.text(left, top + 0.34 / page[1], title, fontsize=15, fontweight="bold", color=INK)
        figure.text(left, top + 0.13 / page[1], line, fontsize=9, color=faint)

    def draw_scale_bar(self) -> None:
        """A round length of at most a sixth of the width, below the drawing on the left."""
        steps = (0.5, 1, 2, 5, 10, 20, 50, 100)
        length = max((s for s in steps if s <= self._extent.width / 6), default=0.5)
        x, y, tick = self._extent.xmin, self._extent.ymin - self.metres(11), self.metres(3.5)
        _line(self.axes, [x, x, x + length, x + length], [y + tick, y, y, y + tick])
        self.axes.text(
            x + length + self.metres(5), y, f"{length:g} m", fontsize=8.5, color=INK, va="center"
        )

    def draw_legend(self, marks: Sequence[Line2D]) -> None:
        """Marks with their names, below the drawing on the right, clear of the scale bar."""
        if not marks:
            return
        page, width = float(self.figure.get_size_inches()[0]), self._extent.width * self._scale
        beside = (page - width) / 2 - _MARGIN  # [inch] of paper right of a narrow drawing
        room = width * 5 / 6 + beside - _SCALE_TEXT
        self.axes.legend(
            handles=list(marks),
            loc="upper right",
            bbox_to_anchor=(1.0 + beside / width, -0.012),
            frameon=False,
            ncols=min(len(marks), max(int(room / _MARK), 2), 7),
            fontsize=8.5,
            handletextpad=0.4,
            columnspacing=1.4,
            labelcolor=INK,
            borderaxespad=0.0,
        )


def _scale(extent: Extent, spots: NDArray[np.float64]) -> float:
    """[inch/m]; larger where `spots` (n, 2) [m] crowd, so that their labels find room."""
    usual, most = (side / max(extent.width, extent.height) for side in LONGER_SIDE)
    if len(spots) < 2:
        return usual
    low, high = np.percentile(spots, [10, 90], axis=0)
    width, height = np.maximum(high - low, 1.0)
    return float(np.clip(np.sqrt(ROOM * len(spots) / (width * height)), usual, most))


def _line(axes: Axes, x: list[float], y: list[float]) -> None:
    axes.plot(x, y, color=INK, lw=1.2, clip_on=False, solid_joinstyle="miter")
