"""Where a place's name goes: within its rectangle, as large as fits, clear of what is drawn there.

Widths of writing are estimated from the number of letters, as the names come before the sheet.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.text import Text
from numpy.typing import NDArray

from kg.records import PlaceRecord
from planner.visualization.layout import Sheet
from planner.visualization.palette import FAINT, HALO, INK

SIZES: Final = (5.0, 9.5)  # [pt] of the name: least and usual
DETAIL_SIZE: Final = 7.0  # [pt]
LETTER: Final = 0.64  # mean width of a letter over its height
PAD: Final = 6.0  # [pt] from the edge of the place
LEADING: Final = 11.5  # [pt] from the name to the detail below


@dataclass(frozen=True, slots=True)
class PlaceName:
    """A name as it fits: its size, whether it is turned upright, and the detail that has room."""

    name: str
    size: float  # [pt]
    detail: str  # "" where there is no room for it
    turned: bool
    line: float  # [m] from the name to the detail
    box: tuple[float, float]  # [m] width and height of the writing

    def write(self, axes: Axes, corner: tuple[float, float]) -> list[Text]:
        """Write it with its upper left at `corner` [m]."""
        x, y = corner
        style: dict[str, Any] = {"va": "top", "ha": "left", "zorder": 3}
        style["rotation"] = 90 if self.turned else 0
        bold: dict[str, Any] = {"size": self.size, "weight": "bold", **style}
        texts = [_haloed(axes, (x, y), self.name, INK, bold)]
        if self.detail:
            below = (x + self.line, y) if self.turned else (x, y - self.line)
            texts.append(_haloed(axes, below, self.detail, FAINT, {"size": DETAIL_SIZE, **style}))
        return texts


def _haloed(
    axes: Axes, corner: tuple[float, float], text: str, colour: str, style: dict[str, Any]
) -> Text:
    # the halo is a text of its own, so that the writing stays writing in SVG and PDF
    axes.text(*corner, text, color="none", path_effects=HALO, **style)
    return axes.text(*corner, text, color=colour, **style)


def fit_name(sheet: Sheet, place: PlaceRecord, name: str, detail: str) -> PlaceName:
    """The name of a place, shrunk or turned where the place is too small for it."""
    width = (place.xmax - place.xmin) / sheet.metres(1)
    height = (place.ymax - place.ymin) / sheet.metres(1)
    needed = LETTER * SIZES[1] * len(name) + 2 * PAD
    turned = width < needed and height > width
    along, across = (height, width) if turned else (width, height)
    size = float(np.clip(SIZES[1] * along / needed, *SIZES))
    detailed = LETTER * DETAIL_SIZE * len(detail) + PAD <= along and across >= 2.6 * LEADING
    detail = detail if detailed else ""
    long = LETTER * max(size * len(name), DETAIL_SIZE * len(detail))
    box = sheet.metres(long), sheet.metres(size * 1.2 + (LEADING if detail else 0))
    return PlaceName(
        name, size, detail, turned, sheet.metres(LEADING), box[::-1] if turned else box
    )


def calm_spot(
    name: PlaceName, sheet: Sheet, place: PlaceRecord, busy: NDArray[np.float64]
) -> tuple[float, float]:
    """Upper left [m] for `name` where it covers the fewest of the spots `busy` (n, 2) [m]."""
    pad, (wide, tall) = sheet.metres(PAD), name.box
    pad_x = min(pad, max(place.xmax - place.xmin - wide, 0) / 2)
    pad_y = min(pad, max(place.ymax - place.ymin - tall, 0) / 2)
    xs = np.linspace(place.xmin + pad_x, max(place.xmax - wide, place.xmin + pad_x), 12)
    ys = np.linspace(place.ymax - pad_y, min(place.ymin + tall + pad_y, place.ymax - pad_y), 12)
    x, y = (axis.reshape(-1, 1) for axis in np.meshgrid(xs, ys))
    right, up = busy[:, 0] - x, busy[:, 1] - y
    apart = np.hypot(
        np.maximum(np.maximum(-right, right - wide), 0), np.maximum(np.maximum(up, -up - tall), 0)
    )
    # the corner at the upper left is where one looks for a name
    astray = 0.035 * np.add.outer(np.arange(12), np.arange(12)).ravel()
    best = int(np.argmin(np.exp(-apart / sheet.metres(9)).sum(axis=1) + astray))
    return float(x[best, 0]), float(y[best, 0])
