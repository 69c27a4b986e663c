"""A semantic map as a floor plan on paper: places, objects, the robot, a planned route.

Reads nothing but the map's records, its catalogue and one shipped query.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib import rc_context
from matplotlib.lines import Line2D
from matplotlib.text import Text
from numpy.typing import ArrayLike, NDArray

from kg.maps.semantic_map import SemanticMap
from kg.records import PlaceRecord
from mapping.occupancy.mapped_floor import mapped_floor
from planner.goals.search_goals import Goal
from planner.visualization.drawing import (
    GroundTruth,
    Shade,
    draw_find,
    draw_floor,
    draw_goal,
    draw_ground_truth,
    draw_object,
    draw_place,
    draw_robot,
    draw_route,
    draw_shade,
    mark,
)
from planner.visualization.layout import Extent, Sheet
from planner.visualization.palette import (
    FAINT,
    FOUND,
    FURNITURE,
    INK,
    ROUTE,
    TRUE_SPOT,
    WALL,
    object_groups,
    place_colours,
    top_category,
)
from planner.visualization.picture_file import STYLE, checked_ending, save_picture
from planner.visualization.place_names import calm_spot, fit_name
from planner.visualization.point_labels import PointLabel, write_labels

#: existence from which on objects are drawn
SHOWN_EXISTENCE: Final = 0.5


def plot_map(
    semantic_map: SemanticMap,
    path: Path | str,
    *,
    route: ArrayLike | None = None,
    goals: Sequence[Goal] | None = None,
    title: str | None = None,
    truth: GroundTruth | None = None,
    numbers: Sequence[str] | None = None,
    shades: Sequence[Shade] = (),
    finds: Sequence[ArrayLike] = (),
    least: float = SHOWN_EXISTENCE,
) -> Path:
    """Draw `semantic_map` to `path` and return it; PNG, SVG or PDF by its ending.

    `route` is a polyline (n, 2) [m] in the map frame, `goals` are numbered in the order given or as
    `numbers` says, `shades` tint the floor, `finds` ((2,) or (3,) [m] each) get a star, and `truth`
    adds walls and furniture, with a small cross where each object truly is. Objects of at least
    the existence `least` are drawn; the fainter, the less probable. Without a `truth`, what depth
    showed of the floor is drawn over the places. Labels that find no room are left out.
    Raises PictureError for another ending or a path that cannot be written.
    """
    path = checked_ending(path)
    with rc_context(STYLE):
        line = None if route is None else np.asarray(route, np.float64).reshape(-1, 2)
        picture = _Picture(semantic_map, line, tuple(goals or ()), truth, least)
        if numbers is not None:
            picture.numbers = tuple(numbers)
        picture.shades = tuple(shades)
        picture.finds = tuple(np.asarray(find, np.float64) for find in finds)
        picture.draw(title or semantic_map.title)
        save_picture(picture.sheet.figure, path)
    return path


class _Picture:
    """One picture under construction."""

    def __init__(
        self,
        semantic_map: SemanticMap,
        route: NDArray[np.float64] | None,
        goals: tuple[Goal, ...],
        truth: GroundTruth | None,
        least: float,
    ) -> None:
        self._label = semantic_map.catalogue.label
        self._objects = tuple(r for r in semantic_map.objects() if r.existence >= least)
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
            draw_ground_truth(self._axes, self._truth)
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
            corners += [(float(x), float(y)) for x, y in self._truth.corners]
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
        self.sheet.draw_legend(marks)

    def _label_objects(self) -> None:
        labels = [
            PointLabel(o.p_map, self._label(o.category), self._groups[o.category].colour)
            for o in self._objects
        ]
        marks = [goal.p_map for goal in self._goals] + list(self.finds)
        marks += [] if self._robot is None else [self._robot.p_map]
        write_labels(self.sheet, labels, texts=self._texts, marks=marks)


def _count(n: int, what: str) -> str:
    return f"{n} {what}" + ("" if n == 1 else "s")
