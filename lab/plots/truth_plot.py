"""A map against its truth, seen from above: true objects, duplicates, wrong labels, ghosts, missed.

True objects have outlines of their extents. Mapped objects have marks in the colour of their group,
with a line to the compared entry of the truth.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.colors import to_rgba
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from hereabouts.display.plots.drawing import draw_floor, mark
from hereabouts.display.plots.layout import Extent, Sheet
from hereabouts.display.plots.map_labels import PointLabel, write_labels
from hereabouts.display.plots.picture_file import checked_ending, picture_style, save_picture
from lab.maps.session_identity import SHOWN
from lab.maps.truth_matching import Matching, Pair, TruthMatcher
from mapping.occupancy.mapped_floor import MappedFloor


@dataclass(frozen=True, slots=True)
class _Kind:
    """The style of one group of objects."""

    name: str
    marker: str
    colour: str
    hollow: bool = False


_TRUE: Final = _Kind("true", "o", "#2b8a3e")
_DUPLICATE: Final = _Kind("duplicate", "s", "#6741d9")
_WRONG: Final = _Kind("wrong label", "D", "#d9480f")
_GHOST: Final = _Kind("ghost", "X", "#c2255c")
_IGNORED: Final = _Kind("ignored", "o", "#98a0a8")
_MISSED: Final = _Kind("missed", "o", "#1864ab", hollow=True)
_LEGEND: Final = (_TRUE, _MISSED, _DUPLICATE, _WRONG, _GHOST, _IGNORED)
_OUTLINE: Final = "#868e96"
_VEIL: Final = (1, 1, 1, 0.6)  # over the floor, so that marks stand out
_NAMELESS: Final = "not coco"  # class of truth that has no label of its own


def plot_truth(
    matching: Matching,
    matcher: TruthMatcher,
    path: Path | str,
    *,
    title: str,
    existence: float = SHOWN,
    floor: MappedFloor | None = None,
) -> Path:
    """Draw the matching of a map to its truth to `path` and return it; PNG, SVG or PDF.

    `existence` is the minimum existence of matched objects; `floor` is drawn below them. Extents of
    the truth have their width along the x axis of its world, seen from above. Raises PictureError
    for another ending or a path that cannot be written.
    """
    path = checked_ending(path)
    with picture_style():
        picture = _Picture(matching, matcher, floor)
        picture.draw(title, existence)
        save_picture(picture.sheet.figure, path)
    return path


class _Picture:
    """One picture under construction."""

    def __init__(
        self, matching: Matching, matcher: TruthMatcher, floor: MappedFloor | None
    ) -> None:
        self._matching, self._matcher, self._floor = matching, matcher, floor
        self._groups: tuple[tuple[_Kind, tuple[Pair, ...]], ...] = (
            (_IGNORED, matching.ignored),
            (_TRUE, matching.matched),
            (_DUPLICATE, matching.duplicates),
            (_WRONG, matching.wrong),
            (_GHOST, matching.ghosts),
        )
        self._outlines = [truth_outline(matcher, i) for i in range(len(matcher.truth))]

    def draw(self, title: str, existence: float) -> None:
        """Everything, from the floor up."""
        truth = self._matcher.p_map[:, :2]
        spots = [o.p_map[:2] for o in self._matching.mapped] + list(truth)
        around = np.array([*spots, *(p for outline in self._outlines for p in outline)])
        self.sheet = Sheet(
            Extent.around(around.reshape(-1, 2)),
            spots,
            title=title,
            line=self._summary(existence),
            legend=[self._legend(kind) for kind in _LEGEND],
        )
        if self._floor is not None:
            draw_floor(self.sheet.axes, self._floor)
            self.sheet.axes.axhspan(*self.sheet.axes.get_ylim(), fc=_VEIL, zorder=1.3)
        for index in range(len(self._outlines)):
            self._draw_entry(index)
        for kind, pairs in self._groups:
            for pair in pairs:
                self._draw_object(kind, pair)
        write_labels(self.sheet, self._labels())

    def _draw_entry(self, index: int) -> None:
        """Outline and mark of an entry of the truth."""
        axes, entry = self.sheet.axes, self._matcher.truth[index]
        x, y = self._matcher.p_map[index][:2]
        missed = index in self._matching.missed
        colour = _MISSED.colour if missed else _IGNORED.colour if entry.ignore else _OUTLINE
        if entry.extent:
            style: dict[str, Any] = {"ec": colour, "lw": 0.7 if entry.ignore else 1.0}
            style["ls"] = (0, (3, 2.5)) if entry.ignore else "solid"
            fill = to_rgba(colour, 0.0 if entry.ignore else 0.08)
            axes.add_patch(Polygon(self._outlines[index], fc=fill, zorder=2, **style))
        if missed:
            axes.plot(x, y, **_style(_MISSED), zorder=6)
        elif not entry.ignore:
            axes.plot(x, y, "+", color=_OUTLINE, ms=5, mew=0.9, zorder=5.5)

    def _draw_object(self, kind: _Kind, pair: Pair) -> None:
        """Mark of a mapped object, and a line to its entry of the truth."""
        x, y = self._matching.mapped[pair.mapped].p_map[:2]
        if (entry := self._compared(kind, pair)) is not None:
            ends = np.array([(x, y), self._matcher.p_map[entry][:2]])
            self.sheet.axes.plot(*ends.T, color=kind.colour, lw=1.0, alpha=0.6, zorder=5)
        self.sheet.axes.plot(x, y, **_style(kind), zorder=6.5)

    def _compared(self, kind: _Kind, pair: Pair) -> int | None:
        """The entry that an object matches, is near to, or doubles."""
        if kind is _GHOST:
            return None
        if kind in (_TRUE, _WRONG):
            return pair.true
        o, truth = self._matching.mapped[pair.mapped], self._matcher.truth
        accepting = (i for i, t in enumerate(truth) if t.accepts(o.label))
        return min(accepting, key=lambda i: self._matcher.distance(o, i))

    def _labels(self) -> list[PointLabel]:
        p_map, truth, mapped = self._matcher.p_map, self._matcher.truth, self._matching.mapped
        labels = [
            PointLabel(mapped[pair.mapped].p_map, self._text(kind, pair), kind.colour)
            for kind, pairs in reversed(self._groups)
            for pair in pairs
        ]
        missed = self._matching.missed
        return labels + [PointLabel(p_map[i], truth[i].label, _MISSED.colour) for i in missed]

    def _text(self, kind: _Kind, pair: Pair) -> str:
        label = self._matching.mapped[pair.mapped].label
        if kind is not _WRONG:
            return label
        entry = self._matcher.truth[pair.true]
        true = entry.name.replace("_", " ") if entry.label == _NAMELESS else entry.label
        return f"{label} (near {true})"

    def _count(self, kind: _Kind) -> int:
        if kind is _MISSED:
            return len(self._matching.missed)
        return sum(len(pairs) for group, pairs in self._groups if group is kind)

    def _legend(self, kind: _Kind) -> Line2D:
        style = _style(kind)
        marker = style.pop("marker")
        return mark(marker, f"{kind.name} {self._count(kind)}", **style | {"ls": "none"})

    def _summary(self, existence: float) -> str:
        found, true = self._count(_TRUE), self._matcher.counted
        false = sum(map(self._count, (_DUPLICATE, _WRONG, _GHOST)))
        right = found / (found + false) if found + false else 0.0
        recall = found / true if true else 0.0
        return (
            f"existence {existence:g} and above   ·   {found} of {true} true objects found "
            f"(recall {recall:.2f})   ·   precision {right:.2f}   ·   outlines: truth"
        )


def truth_outline(matcher: TruthMatcher, index: int) -> NDArray[np.float64]:
    """(4, 2) [m] corners of an entry of the truth from above; (1, 2) where it has no extent."""
    entry, middle = matcher.truth[index], matcher.p_map[index][:2]
    if len(entry.extent) < 2:
        return np.array([middle])
    along = matcher.T_map_world[:2, 0]
    heading = np.arctan2(along[1], along[0])
    axes = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]])
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * np.array(entry.extent[:2]) / 2
    return np.asarray(middle + corners @ axes, np.float64)


def _style(kind: _Kind) -> dict[str, Any]:
    edge = kind.colour if kind.hollow else "white"
    fill = "white" if kind.hollow else kind.colour
    return {
        "marker": kind.marker,
        "ms": 7.2 + 1.6 * (kind is _GHOST),
        "mfc": fill,
        "mec": edge,
        "mew": 1.3,
    }
