"""Reliability diagram: predicted existence against the share of objects that is true."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from hereabouts.display.plots.layout import DPI
from hereabouts.display.plots.palette import FAINT, INK, OUTLINE
from hereabouts.display.plots.picture_file import checked_ending, picture_style, save_picture
from lab.networks.calibration import BINS, Calibration

_SIZE: Final = (6.4, 7.2)  # [inch] without the legend
_ROW: Final = 0.22  # [inch] of the legend
_COLOURS: Final = ("#0b7285", "#d9480f", "#5f3dc4", "#2b8a3e", "#a61e4d", "#1864ab")
_DOT: Final = (4.0, 16.0)  # [pt] diameter for one object, and the largest


def plot_reliability(
    calibrations: Sequence[tuple[str, Calibration]], path: Path | str, *, title: str
) -> Path:
    """Draw named calibrations to `path` and return it; PNG, SVG or PDF by its ending.

    Above, each bin's share of true objects over its mean existence, the larger the dot the more
    objects; below, how many objects each bin has. Raises PictureError for another ending or a path
    that cannot be written.
    """
    path = checked_ending(path)
    with picture_style():
        rows = _ROW * len(calibrations)  # of the legend
        width, height = _SIZE[0], _SIZE[1] + rows
        figure = Figure(figsize=(width, height), dpi=DPI)
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(4, 1))
        top = 1 - (0.85 + rows) / height
        figure.subplots_adjust(0.12, 0.6 / height, 0.96, top, hspace=0.08)
        figure.text(0.12, 1 - 0.42 / height, title, fontsize=14, fontweight="bold", color=INK)
        line = "existence as predicted, and as it turned out; on the dashed line they agree"
        figure.text(0.12, 1 - 0.65 / height, line, fontsize=9, color=FAINT)
        _draw_frame(above, below)
        for number, (name, found) in enumerate(calibrations):
            _draw(above, below, name, found, (number, len(calibrations)))
        style: dict[str, Any] = {"frameon": False, "fontsize": 9, "labelcolor": INK}
        above.legend(loc="lower left", bbox_to_anchor=(-0.02, 1.0), **style)
        save_picture(figure, path)
    return path


def _draw_frame(above: Axes, below: Axes) -> None:
    above.plot([0, 1], [0, 1], color=OUTLINE, lw=1.2, ls=(0, (4, 3)), zorder=1)
    above.set(xlim=(0, 1), ylim=(0, 1))
    above.set_ylabel("share of true objects", color=INK)
    below.set_xlabel("predicted existence", color=INK)
    below.set_ylabel("objects", color=INK)
    below.yaxis.set_major_locator(MaxNLocator(3, integer=True))
    for axes in (above, below):
        axes.set_xticks(np.linspace(0, 1, BINS + 1))
        axes.grid(color=OUTLINE, lw=0.5, alpha=0.5)
        axes.set_axisbelow(True)
        axes.tick_params(colors=FAINT, labelsize=8.5)
        for side, spine in axes.spines.items():
            spine.set(visible=side in ("left", "bottom"), color=OUTLINE)


def _draw(above: Axes, below: Axes, name: str, found: Calibration, place: tuple[int, int]) -> None:
    """One calibration, the first of `place` of so many beside each other."""
    number, of = place
    colour = _COLOURS[number % len(_COLOURS)]
    predicted, true = [b.predicted for b in found.bins], [b.true for b in found.bins]
    counts = np.array([b.cases for b in found.bins], np.float64)
    error = "no objects" if found.ece is None else f"ECE {found.ece:.3f}, {found.cases} objects"
    label = f"{name}: {error}"
    above.plot(predicted, true, color=colour, lw=1.2, alpha=0.4, zorder=2)
    diameters = np.clip(_DOT[0] * np.sqrt(counts), *_DOT)
    style: dict[str, Any] = {"color": colour, "edgecolors": "white", "zorder": 3, "clip_on": False}
    above.scatter(predicted, true, s=diameters**2, linewidths=1.0, **style)
    above.plot([], [], "o-", color=colour, label=label)
    width = 0.8 / BINS / of
    left = np.array([b.lower for b in found.bins]) + 0.1 / BINS + number * width
    below.bar(left, counts, width, align="edge", color=colour)
