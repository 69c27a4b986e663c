"""Labels beside points on a sheet: none covers another, and crowded ones are left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text
from numpy.typing import NDArray

from planner.visualization.label_placement import Box, Label, place_labels
from planner.visualization.layout import Sheet
from planner.visualization.palette import HALO

_CROWD = 60  # more points than this have smaller labels
_SIZES = (7.2, 6.4)  # [pt] of few labels, of many


@dataclass(frozen=True, slots=True, eq=False)
class PointLabel:
    """What is to be written beside a point."""

    p_map: NDArray[np.float64]  # (2,) or (3,) [m]
    text: str
    colour: str


def write_labels(
    sheet: Sheet,
    labels: Sequence[PointLabel],
    *,
    texts: Sequence[Text] = (),
    marks: Sequence[NDArray[np.float64]] = (),
) -> None:
    """Write `labels` clear of the `texts` on the sheet and of large marks ((2,) or (3,) [m])."""
    if not labels:
        return
    size = _SIZES[len(labels) > _CROWD]
    pixel = sheet.figure.dpi / 72
    measure = _Measure(sheet)
    points = sheet.axes.transData.transform([label.p_map[:2] for label in labels])
    placed = place_labels(
        points,
        [measure.size(label.text, size) for label in labels],
        [*map(measure.box, texts), *_boxes_around(sheet, marks, 8 * pixel)],
        bounds=measure.drawing(),
        gap=6.5 * pixel,
    )
    for place in placed:
        _write(sheet, place, labels[place.index], size)


def _boxes_around(sheet: Sheet, marks: Sequence[NDArray[np.float64]], reach: float) -> list[Box]:
    spots = np.array([mark[:2] for mark in marks], np.float64).reshape(-1, 2)
    pixels = sheet.axes.transData.transform(spots)
    return [
        (float(x - reach), float(y - reach), float(x + reach), float(y + reach)) for x, y in pixels
    ]


def _write(sheet: Sheet, place: Label, label: PointLabel, size: float) -> None:
    box = np.array(place.box)
    x, y = sheet.axes.transData.inverted().transform((box[:2] + box[2:]) / 2)
    if place.distant:
        ends = [label.p_map[0], x], [label.p_map[1], y]
        sheet.axes.plot(*ends, color=label.colour, lw=0.5, alpha=0.5, zorder=5)
    style: dict[str, Any] = {"ha": "center", "va": "center", "size": size, "zorder": 7}
    # apart from its halo the name stays writing in SVG and PDF, not an outline
    sheet.axes.text(x, y, label.text, color="none", path_effects=HALO, **style)
    sheet.axes.text(x, y, label.text, color=label.colour, **style)


class _Measure:
    """How large writing is on paper [px]."""

    def __init__(self, sheet: Sheet) -> None:
        self._sheet = sheet
        canvas: Any = FigureCanvasAgg(sheet.figure)
        canvas.draw()
        self._renderer = canvas.get_renderer()
        self._known: dict[tuple[str, float], tuple[float, float]] = {}

    def size(self, text: str, size: float) -> tuple[float, float]:
        if (text, size) not in self._known:
            probe = self._sheet.figure.text(0, 0, text, fontsize=size)
            xmin, ymin, xmax, ymax = self.box(probe)
            probe.remove()
            self._known[text, size] = xmax - xmin + 2, ymax - ymin + 1
        return self._known[text, size]

    def box(self, text: Text) -> Box:
        xmin, ymin, xmax, ymax = text.get_window_extent(self._renderer).extents
        return float(xmin), float(ymin), float(xmax), float(ymax)

    def drawing(self) -> Box:
        xmin, ymin, xmax, ymax = self._sheet.axes.get_window_extent(self._renderer).extents
        return float(xmin), float(ymin), float(xmax), float(ymax)
