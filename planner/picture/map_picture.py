"""A semantic map as a floor plan on paper: places, objects, the robot, a planned route.

Reads nothing but the map's records, its catalogue and one shipped query.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.lines import Line2D
from matplotlib.text import Text
from numpy.typing import ArrayLike, NDArray

from kg.errors import PictureError
from kg.records import ObjectRecord, PlaceRecord
from kg.semantic_map import SemanticMap
from planner.goals import Goal
from planner.picture.drawing import (
    Shade,
    draw_find,
    draw_floor,
    draw_goal,
    draw_house,
    draw_object,
    draw_place,
    draw_robot,
    draw_route,
    draw_shade,
    mark,
)
from planner.picture.label_placement import Box, Label, place_labels
from planner.picture.palette import (
    FAINT,
    FOUND,
    FURNITURE,
    HALO,
    INK,
    ROUTE,
    TRUE_SPOT,
    WALL,
    object_groups,
    place_colours,
    top_category,
)
from planner.picture.paper import Extent, Sheet
from planner.picture.place_names import calm_spot, fit_name
from planner.simulation.house import House
from planner.space.mapped import mapped_floor

FORMATS: Final = (".png", ".svg", ".pdf")

#: What would make two drawings of one map differ is left out.
_METADATA: Final[dict[str, dict[str, Any]]] = {
    ".png": {"Software": None},
    ".svg": {"Date": None},
    ".pdf": {"CreationDate": None},
}
_STYLE: Final[dict[Any, Any]] = {"font.family": "DejaVu Sans", "svg.hashsalt": "hereabouts"}


def plot_map(
    semantic_map: SemanticMap,
    path: Path | str,
    *,
    route: ArrayLike | None = None,
    goals: Sequence[Goal] | None = None,
    title: str | None = None,
    truth: House | None = None,
    numbers: Sequence[str] | None = None,
    shades: Sequence[Shade] = (),
    finds: Sequence[ArrayLike] = (),
) -> Path:
    """Draw `semantic_map` to `path` and return it; PNG, SVG or PDF by its ending.

    `route` is a polyline (n, 2) [m] in the map frame, `goals` are numbered in the order given or as
    `numbers` says, `shades` tint the floor, `finds` ((2,) or (3,) [m] each) get a star, and `truth`
    adds a house's walls and furniture, with a small cross where each object truly is. The fainter
    an object, the less probable its existence. Without a `truth`, what depth showed of the floor is
    drawn over the places. Labels that find no room are left out.
    Raises PictureError for another ending or a path that cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in FORMATS:
        given = f"the ending {path.suffix}" if path.suffix else "no ending"
        raise PictureError(f"cannot draw {path.name!r} with {given}; .png, .svg or .pdf would work")
    with rc_context(_STYLE):
        line = None if route is None else np.asarray(route, np.float64).reshape(-1, 2)
        picture = _Picture(semantic_map, line, tuple(goals or ()), truth)
        if numbers is not None:
            picture.numbers = tuple(numbers)
        picture.shades = tuple(shades)
        picture.finds = tuple(np.asarray(find, np.float64) for find in finds)
        picture.draw(title or semantic_map.title)
        _save(picture.sheet, path)
    return path


def _save(sheet: Sheet, path: Path) -> None:
    kind = path.suffix.lower()
    try:
        sheet.figure.savefig(
            path, dpi=sheet.figure.dpi, facecolor="white", format=kind[1:], metadata=_METADATA[kind]
        )
    except OSError as error:
        raise PictureError(f"cannot write {path}: {error.strerror or error}") from error


class _Picture:
    """One picture under construction."""

    def __init__(
        self,
        semantic_map: SemanticMap,
        route: NDArray[np.float64] | None,
        goals: tuple[Goal, ...],
        truth: House | None,
    ) -> None:
        self._label = semantic_map.catalogue.label
        self._objects = semantic_map.objects()
        self._places = semantic_map.places()
        self._robot = semantic_map.robot()
        self._route, self._goals, self._truth = route, goals, truth
        height = None if self._robot is None else float(self._robot.p_map[2])
        self._floor = None if truth else mapped_floor(semantic_map.floor(), height)
        self._groups = object_groups(semantic_map, self._objects)
        self._colours = place_colours(self._places)
        self._busy = self._spots()
        extent = Extent.around(np.vstack([self._busy, self._corners()]))
        self.sheet = Sheet(extent, [record.p_map[:2] for record in self._objects])
        self._axes = self.sheet.axes
        self._texts: list[Text] = []
        self.numbers = tuple(str(n) for n in range(1, len(goals) + 1))
        self.shades: tuple[Shade, ...] = ()
        self.finds: tuple[NDArray[np.float64], ...] = ()

    def draw(self, title: str) -> None:
        """Everything, from the floor up."""
        for place in self._places:
            self._draw_place(place)
        if self._floor is not None:
            draw_floor(self._axes, self._floor)
        for shade in self.shades:
            draw_shade(self._axes, shade)
        if self._truth is not None:
            draw_house(self._axes, self._truth)
        if self._route is not None:
            draw_route(self._axes, self._route)
        for record in self._objects:
            draw_object(self._axes, record, self._groups[record.category])
        if self._robot is not None:
            draw_robot(self._axes, self._robot, self.sheet.metres(9))
        for number, goal in zip(self.numbers, self._goals, strict=True):
            self._texts.append(draw_goal(self._axes, goal, number))
        for find in self.finds:
            draw_find(self._axes, find)
        self.sheet.write_heading(title, self._summary(), FAINT)
        self._draw_legend()
        self.sheet.draw_scale_bar()
        self._label_objects()

    def _spots(self) -> NDArray[np.float64]:
        """(n, 2) [m] everything that is drawn as a spot or a line."""
        points = [record.p_map[:2] for record in self._objects]
        points += [goal.p_map for goal in self._goals]
        points += [] if self._robot is None else [self._robot.p_map[:2]]
        points += [] if self._route is None else list(self._route)
        return np.array(points, np.float64).reshape(-1, 2)

    def _corners(self) -> NDArray[np.float64]:
        corners = [c for p in self._places for c in ((p.xmin, p.ymin), (p.xmax, p.ymax))]
        if self._truth is not None:
            xmin, xmax, ymin, ymax = self._truth.extent
            corners += [(xmin, ymin), (xmax, ymax)]
        if self._floor is not None:
            corners += list(self._floor.bounds)
        return np.array(corners, np.float64).reshape(-1, 2)

    def _draw_place(self, place: PlaceRecord) -> None:
        best = top_category(place)
        draw_place(self._axes, place, None if best is None else self._colours[best])
        if best is None:
            name = fit_name(self.sheet, place, place.label, "not viewed yet")
        else:
            detail = f"{place.label}, belief {place.beliefs[best]:.2f}"
            name = fit_name(self.sheet, place, self._label(best), detail)
        self._texts += name.write(self._axes, calm_spot(name, self.sheet, place, self._busy))

    def _summary(self) -> str:
        unseen = sum(not place.views for place in self._places)
        parts = [_count(len(self._objects), "object"), _count(len(self._places), "place")]
        parts[1] += f", {unseen} not viewed yet" if unseen else ""
        what = "stop" if self.shades or self.finds else "goal"
        parts += [_count(len(self._goals), what)] if self._goals else []
        return "   ·   ".join(parts)

    def _draw_legend(self) -> None:
        groups = sorted(set(self._groups.values()), key=lambda g: (g.name == "other", g.name))
        marks = [mark("o", group.name, mfc=group.colour, mec="white") for group in groups]
        if self._robot is not None:
            marks.append(mark((3, 0, -90), "robot", mfc=INK, mec="white"))
        if self._route is not None:
            marks.append(Line2D([], [], color=ROUTE, lw=1.7, ls=(0, (4, 2)), label="route"))
        marks += [mark("s", s.label, mfc=s.colour, mec="none", alpha=0.45) for s in self.shades]
        if self.finds:
            marks.append(mark("*", "found", mfc=FOUND, mec=INK, mew=0.7))
        if self._floor is not None:
            marks.append(mark("s", "wall", mfc=WALL, mec="none"))
            marks.append(mark("s", "furniture", mfc=FURNITURE, mec="none", alpha=0.45))
        if self._truth is not None:
            marks.append(mark("+", "truth", mec=TRUE_SPOT))
        if not marks:
            return
        self._axes.legend(
            handles=marks,
            loc="upper right",
            bbox_to_anchor=(1.0, -0.012),
            frameon=False,
            ncols=min(len(marks), 7),
            fontsize=8.5,
            handletextpad=0.4,
            columnspacing=1.4,
            labelcolor=INK,
            borderaxespad=0.0,
        )

    def _label_objects(self) -> None:
        if not self._objects:
            return
        size = 7.2 if len(self._objects) <= 60 else 6.4
        names = [self._label(record.category) for record in self._objects]
        pixel = self.sheet.figure.dpi / 72
        measured = _Measure(self.sheet)
        points = self._axes.transData.transform([record.p_map[:2] for record in self._objects])
        labels = place_labels(
            points,
            [measured.size(name, size) for name in names],
            [*map(measured.box, self._texts), *self._large_marks(8 * pixel)],
            bounds=measured.drawing(),
            gap=6.5 * pixel,
        )
        for label in labels:
            self._write(label, names[label.index], size, self._objects[label.index])

    def _large_marks(self, reach: float) -> list[Box]:
        """Boxes [px] of robot and goals, which labels keep clear of."""
        spots = [goal.p_map for goal in self._goals]
        spots += [find[:2] for find in self.finds]
        spots += [] if self._robot is None else [self._robot.p_map[:2]]
        pixels = self._axes.transData.transform(np.array(spots).reshape(-1, 2))
        return [
            (float(x - reach), float(y - reach), float(x + reach), float(y + reach))
            for x, y in pixels
        ]

    def _write(self, label: Label, name: str, size: float, record: ObjectRecord) -> None:
        box = np.array(label.box)
        x, y = self._axes.transData.inverted().transform((box[:2] + box[2:]) / 2)
        colour = self._groups[record.category].colour
        if label.distant:
            ends = [record.p_map[0], x], [record.p_map[1], y]
            self._axes.plot(*ends, color=colour, lw=0.5, alpha=0.5, zorder=5)
        style: dict[str, Any] = {"ha": "center", "va": "center", "size": size, "zorder": 7}
        # apart from its halo the name stays writing in SVG and PDF, not an outline
        self._axes.text(x, y, name, color="none", path_effects=HALO, **style)
        self._axes.text(x, y, name, color=colour, **style)


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


def _count(n: int, what: str) -> str:
    return f"{n} {what}" + ("" if n == 1 else "s")
