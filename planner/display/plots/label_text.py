"""Text on a picture: cleaned, measured, and cut to a width."""

from __future__ import annotations

from typing import Any, Final

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

from planner.display.plots.label_placement import Box
from planner.execution.protocol import cleaned

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
