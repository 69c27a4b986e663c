"""Labels beside points on a sheet: none covers another, and crowded ones are left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.text import Text
from numpy.typing import NDArray

from hereabouts.display.plots.label_placement import Box, Covers, Label, place_labels
from hereabouts.display.plots.layout import Sheet
from hereabouts.display.plots.place_labels import haloed

_CROWD = 60  # more points than this have smaller labels
_THRONG = 300  # more than this have theirs close by, or none
_SIZES = (7.2, 6.4)  # [pt] of few labels, of many


@dataclass(frozen=True, slots=True, eq=False)
class PointLabel:
    """The text beside a point."""

    p_map: NDArray[np.float64]  # (2,) or (3,) [m]
    text: str
    colour: str


def write_labels(
    sheet: Sheet,
    labels: Sequence[PointLabel],
    *,
    texts: Sequence[Text] = (),
    marks: Sequence[NDArray[np.float64]] = (),
    covers: Covers | None = None,
) -> int:
    """Write `labels` clear of `texts` on the sheet, of large `marks` ((2,) or (3,) [m]) and walls.

    `covers` tells what lies over walls. Returns how many labels found no room.
    """
    if not labels:
        return 0
    size = _SIZES[len(labels) > _CROWD]
    pixel = sheet.figure.dpi / 72
    measure = sheet.measure
    points = sheet.axes.transData.transform([label.p_map[:2] for label in labels])
    placed = place_labels(
        points,
        [np.add(measure.size(label.text, size), (2, 1)) for label in labels],
        [*map(measure.box, texts), *_boxes_around(sheet, marks, 8 * pixel)],
        bounds=_drawing(sheet),
        gap=6.5 * pixel,
        rings=5 if len(labels) <= _THRONG else 2,
        covers=covers,
    )
    for place in placed:
        _write(sheet, place, labels[place.index], size)
    return len(labels) - len(placed)


def _drawing(sheet: Sheet) -> Box:
    xmin, ymin, xmax, ymax = sheet.axes.get_window_extent().extents
    return float(xmin), float(ymin), float(xmax), float(ymax)


def _boxes_around(sheet: Sheet, marks: Sequence[NDArray[np.float64]], reach: float) -> list[Box]:
    spots = np.array([mark[:2] for mark in marks], np.float64).reshape(-1, 2)
    pixels = sheet.axes.transData.transform(spots)
    return [
        (float(x - reach), float(y - reach), float(x + reach), float(y + reach)) for x, y in pixels
    ]


def _write(sheet: Sheet, place: Label, label: PointLabel, size: float) -> None:
    axes, box = sheet.axes, np.array(place.box)
    (low, high), to_map = box.reshape(2, 2), axes.transData.inverted()
    if place.distant:
        point = axes.transData.transform(label.p_map[:2])
        ends = np.array([label.p_map[:2], to_map.transform(np.clip(point, low, high))])
        axes.plot(*ends.T, color=label.colour, lw=0.5, alpha=0.5, zorder=5)
    style: dict[str, Any] = {"ha": "center", "va": "center", "size": size, "zorder": 7}
    haloed(axes, to_map.transform((low + high) / 2), label.text, label.colour, **style)
