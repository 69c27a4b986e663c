"""Names on a sheet, none over another: of places inside them, of points beside them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.text import Text
from numpy.typing import NDArray

from hereabouts.display.plots.label_placement import (
    Box,
    Boxes,
    Covers,
    Label,
    TextMeasure,
    overlapping,
    place_labels,
)
from hereabouts.display.plots.layout import Sheet
from hereabouts.display.plots.palette import FAINT, HALO, INK
from kg.model.areas import Area

SIZES: Final = (9.5, 8.0, 6.8, 5.8)  # [pt] of a name, by preference
DETAIL: Final = 7.0  # [pt]
_LEADING: Final = 1.3  # distance of lines over the size of their letters
_TRIED: Final = 14  # positions along each side
_ASTRAY: Final = 0.04  # cost of each position away from the upper left
_NEAR: Final = 9.0  # [pt] scale of the cost of a near mark
_HIDDEN: Final = 3.0  # cost of each mark that a name covers
_MANY: Final = 24  # more names than this are smaller
_INSIDE: Final = np.array([(x, y) for x in (0.0, 0.5, 1.0) for y in (0.0, 0.5, 1.0)])


@dataclass(frozen=True, slots=True)
class NamedPlace:
    """A place with the lines of text that are written into it."""

    area: Area  # [m]
    name: str
    detail: str


@dataclass(frozen=True, slots=True)
class _Lines:
    """One way to write a name."""

    lines: tuple[tuple[str, float, bool], ...]  # text, size [pt], whether it is the name
    turned: bool

    def box(self, measure: TextMeasure, pixel: float) -> NDArray[np.float64]:
        """(2,) [px] width and height on the page."""
        wide = max(
            measure.size(text, size, "bold" if name else "normal")[0]
            for text, size, name in self.lines
        )
        high = sum(size * _LEADING for _, size, _ in self.lines) * pixel
        return np.array([high, wide] if self.turned else [wide, high])


def write_place_names(
    sheet: Sheet, places: Sequence[NamedPlace], spots: NDArray[np.float64], covers: Covers | None
) -> tuple[list[Text], int]:
    """Write the names clear of `spots` (n, 2) [m]; the texts, and the number of names left out."""
    writer = _NameWriter(sheet, spots, covers)
    sizes = SIZES if len(places) <= _MANY else SIZES[1:]
    left_out = sum(not writer.write(place, sizes) for place in places)
    return writer.texts, left_out


class _NameWriter:
    """Writes one name after the other, none over another."""

    def __init__(self, sheet: Sheet, spots: NDArray[np.float64], covers: Covers | None) -> None:
        self.texts: list[Text] = []
        self._sheet, self._covers = sheet, covers
        self._pixel = sheet.figure.dpi / 72
        self._spots = sheet.axes.transData.transform(spots.reshape(-1, 2))
        self._taken = np.empty((0, 4))

    def write(self, place: NamedPlace, sizes: Sequence[float]) -> bool:
        """Write the name of `place` if there is room; whether there was."""
        for way in _ways(place, sizes):
            size = way.box(self._sheet.measure, self._pixel)
            boxes = self._free(self._candidates(place.area, size), place.area)
            if len(boxes):
                box = boxes[int(np.argmin(self._cost(boxes)))]
                self._taken = np.vstack([self._taken, box])
                self._put(way, box)
                return True
        return False

    def _candidates(self, area: Area, size: NDArray[np.float64]) -> Boxes:
        """(k, 4) [px] boxes of `size` in the bounding rectangle, those at the upper left first."""
        pad = 3.5 * self._pixel
        corners = [(area.xmin, area.ymin), (area.xmax, area.ymax)]
        low, high = self._sheet.axes.transData.transform(corners)
        low, high = low + pad, high - pad - size
        if (high < low).any():
            return np.empty((0, 4))
        xs = np.linspace(low[0], high[0], _TRIED)
        ys = np.linspace(high[1], low[1], _TRIED)
        at = np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)
        return np.hstack([at, at + size])

    def _free(self, boxes: Boxes, area: Area) -> Boxes:
        if not len(boxes):
            return boxes
        points = boxes[:, None, :2] + _INSIDE * (boxes[:, None, 2:] - boxes[:, None, :2])
        at = self._sheet.axes.transData.inverted().transform(points.reshape(-1, 2))
        free = area.contains_each(at[:, 0], at[:, 1]).reshape(len(boxes), -1).all(axis=1)
        if self._covers is not None:
            free &= ~self._covers(boxes)
        free &= ~overlapping(boxes, self._taken)
        return boxes[free]

    def _cost(self, boxes: Boxes) -> NDArray[np.float64]:
        """(k,) cost of each box: nearness to spots, and distance from the upper left."""
        x, y = self._spots[:, 0], self._spots[:, 1]
        right = np.maximum(np.maximum(boxes[:, :1] - x, x - boxes[:, 2:3]), 0)
        up = np.maximum(np.maximum(boxes[:, 1:2] - y, y - boxes[:, 3:]), 0)
        apart = np.hypot(right, up)
        near = np.exp(-apart / (_NEAR * self._pixel)).sum(axis=1) + _HIDDEN * (apart == 0).sum(
            axis=1
        )
        left, top = boxes[:, 0].min(), boxes[:, 3].max()
        steps = np.ptp(boxes[:, 0]) / _TRIED or 1.0, np.ptp(boxes[:, 3]) / _TRIED or 1.0
        astray = (boxes[:, 0] - left) / steps[0] + (top - boxes[:, 3]) / steps[1]
        return np.asarray(near + _ASTRAY * astray)

    def _put(self, way: _Lines, box: NDArray[np.float64]) -> None:
        """Write the lines from the upper left of the box on, or turned from its lower left."""
        x, y = float(box[0]), float(box[1] if way.turned else box[3])
        for text, size, name in way.lines:
            step = size * _LEADING * self._pixel
            at = (x + step / 2, y) if way.turned else (x, y - step / 2)
            style: dict[str, Any] = {"size": size, "weight": "bold" if name else "normal"}
            if way.turned:
                style |= {"rotation": 90, "ha": "center", "va": "bottom"}
            else:
                style |= {"ha": "left", "va": "center"}
            spot = self._sheet.axes.transData.inverted().transform(at)
            colour = INK if name else FAINT
            self.texts.append(haloed(self._sheet.axes, spot, text, colour, zorder=5, **style))
            x, y = (x + step, y) if way.turned else (x, y - step)


def _ways(place: NamedPlace, sizes: Sequence[float]) -> Iterator[_Lines]:
    """Ways to write a name, the best readable first."""
    words = place.name.split()
    broken = tuple(words) if len(words) > 1 else ()
    for turned in (False, True):
        yield _Lines(((place.name, sizes[0], True), (place.detail, DETAIL, False)), turned)
    for size in sizes:
        yield _Lines(((place.name, size, True),), turned=False)
        if broken:
            yield _Lines(tuple((word, size, True) for word in broken), turned=False)
        yield _Lines(((place.name, size, True),), turned=True)


def haloed(axes: Axes, spot: NDArray[np.float64], text: str, colour: str, **style: Any) -> Text:
    """Text at `spot` (2,) [m] with a light edge.

    The edge is a text of its own, so that the writing stays writing in SVG and PDF.
    """
    x, y = float(spot[0]), float(spot[1])
    axes.text(x, y, text, color="none", path_effects=HALO, **style)
    return axes.text(x, y, text, color=colour, **style)


_CROWD = 60  # more points than this have smaller labels
_THRONG = 300  # more than this have theirs close by, or none
_POINT_SIZES = (7.2, 6.4)  # [pt] of few labels, of many


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
    size = _POINT_SIZES[len(labels) > _CROWD]
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
        _write_label(sheet, place, labels[place.index], size)
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


def _write_label(sheet: Sheet, place: Label, label: PointLabel, size: float) -> None:
    axes, box = sheet.axes, np.array(place.box)
    (low, high), to_map = box.reshape(2, 2), axes.transData.inverted()
    if place.distant:
        point = axes.transData.transform(label.p_map[:2])
        ends = np.array([label.p_map[:2], to_map.transform(np.clip(point, low, high))])
        axes.plot(*ends.T, color=label.colour, lw=0.5, alpha=0.5, zorder=5)
    style: dict[str, Any] = {"ha": "center", "va": "center", "size": size, "zorder": 7}
    haloed(axes, to_map.transform((low + high) / 2), label.text, label.colour, **style)
