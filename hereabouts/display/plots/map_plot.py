"""A semantic map as a floor plan on paper: places, objects, the robot, a search.

Reads nothing but the map's records, its catalogue and one shipped query.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Final, Literal

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.text import Text
from numpy.typing import NDArray
from PIL import Image

from hereabouts.display.plots.drawing import (
    SHOWN_EXISTENCE,
    GroundTruth,
    Shade,
    Stop,
    draw_door,
    draw_find,
    draw_floor,
    draw_ground_truth,
    draw_object,
    draw_place,
    draw_robot,
    draw_route,
    draw_shade,
    draw_stop,
    draw_surface,
    mark,
)
from hereabouts.display.plots.label_placement import WallsBelow, drawable, wall_cells
from hereabouts.display.plots.layout import Extent, Listing, Sheet
from hereabouts.display.plots.map_labels import (
    NamedPlace,
    PointLabel,
    write_labels,
    write_place_names,
)
from hereabouts.display.plots.palette import (
    FAINT,
    FOUND,
    FURNITURE,
    INK,
    ROUTE,
    TRUE_SPOT,
    WALL,
    Group,
    object_groups,
    place_groups,
    top_category,
)
from hereabouts.display.plots.picture_file import checked_ending, picture_style, save_picture
from kg.maps.semantic_map import SemanticMap
from kg.maps.surface.voxels import Surface
from kg.model.place_names import NUMBERED, SURE, plain_place
from kg.model.records import TALL, ObjectRecord, PlaceRecord
from mapping.occupancy.mapped_floor import mapped_floor

Legend = Literal["class", "place"]

#: minimum existence of objects that are marked, without a name
GHOST_EXISTENCE: Final = 0.1
_COLOURS: Final = 256  # of small pictures
_CROWD: Final = 300  # more objects than this have smaller marks
_SIZES: Final = (6.2, 4.0)  # [pt] of the marks of few objects, of many
_SECTOR: Final = 34.0  # [pt] radius of the sector that a look goes to
_ARROW: Final = 9.0  # [pt] of the robot


@dataclass(frozen=True, slots=True, eq=False)
class SearchDrawing:
    """A search as it is drawn over the map; lengths in metres of the map frame."""

    route: NDArray[np.float64]  # (n, 2) the way; (0, 2) for none
    stops: tuple[Stop, ...] = ()
    shade: Shade | None = None  # the floor that the looks show
    finds: tuple[NDArray[np.float64], ...] = ()  # (2,) or (3,) each, marked by a star
    listing: Listing | None = None  # the stops in words

    @property
    def spots(self) -> list[NDArray[np.float64]]:
        """(2,) points that the page must contain."""
        return [*self.route, *(stop.p_map for stop in self.stops), *(f[:2] for f in self.finds)]


def plot_map(
    semantic_map: SemanticMap,
    path: Path | str,
    *,
    title: str | None = None,
    search: SearchDrawing | None = None,
    truth: GroundTruth | None = None,
    least: float = SHOWN_EXISTENCE,
    legend: Legend = "class",
) -> Path:
    """Draw `semantic_map` to `path` and return it; PNG, SVG or PDF by its ending.

    Objects of at least the existence `least` have names, others of 0.1 and above are faint marks.
    Marks have the colour and shape of their class, or with `legend` "place" of the category of
    their place. `truth` adds walls and furniture, with a small cross at each true object; without
    it, the mapped floor is drawn. Names without room are left out.
    Raises PictureError for another ending or a path that cannot be written.
    """
    path = checked_ending(path)
    with picture_style():
        picture = _Picture(semantic_map, search, truth, least, legend)
        figure = picture.draw(title or semantic_map.description.title)
        save_picture(figure.figure, path)
    return path


def map_png(semantic_map: SemanticMap, pixels: int) -> bytes:
    """The map as a PNG whose sides have at most `pixels`; objects have their own names (cup 2)."""
    with picture_style():
        picture = _Picture(semantic_map, None, None, SHOWN_EXISTENCE, "class", numbered=True)
        figure = picture.draw(semantic_map.description.title).figure
        file = BytesIO()
        page = figure.get_tightbbox().padded(0.25)  # [inch]
        dpi = min(figure.dpi, pixels / max(page.size))
        figure.savefig(file, dpi=dpi, facecolor="white", format="png")
    few, smaller = Image.open(file).convert("RGB").quantize(_COLOURS), BytesIO()
    few.save(smaller, "PNG", optimize=True)
    return smaller.getvalue()


class _Picture:
    """One picture under construction."""

    def __init__(
        self,
        semantic_map: SemanticMap,
        search: SearchDrawing | None,
        truth: GroundTruth | None,
        least: float,
        legend: Legend,
        *,
        numbered: bool = False,
    ) -> None:
        self._label, self._numbered = semantic_map.catalogue.label, numbered
        self._title = semantic_map.catalogue.title
        self._names = {
            a.subject: a.value for a in semantic_map.assertions.all() if a.property == "label"
        }
        marked = semantic_map.objects(min_existence=min(least, GHOST_EXISTENCE))
        self._objects = tuple(r for r in marked if np.isfinite(r.p_map).all())
        self._named = tuple(r for r in self._objects if r.existence >= least)
        self._places = semantic_map.places()
        self._doors = semantic_map.doors()
        self._robot = semantic_map.robot()
        self._search = search or SearchDrawing(np.empty((0, 2)))
        self._truth = truth
        height = None if self._robot is None else float(self._robot.p_map[2])
        tiles = () if truth else semantic_map.floor()
        self._floor = mapped_floor(tiles, height)
        self._surface = Surface.empty()
        if self._floor is not None:
            self._surface = semantic_map.surface(min_count=2)
            storey = self._floor.storey
            self._height = next(tile.height for tile in tiles if tile.storey == storey)
        self._of_places = place_groups(semantic_map, self._places)
        self._groups = self._grouped(semantic_map, legend)

    def _grouped(self, semantic_map: SemanticMap, legend: Legend) -> dict[str, Group]:
        """Object IRI -> the group that gives its colour and mark."""
        if legend == "place":
            tops = {place.iri: top_category(place) or "" for place in self._places}
            return {r.iri: self._of_places[tops.get(r.place or "", "")] for r in self._objects}
        groups = object_groups(semantic_map, self._objects)
        return {r.iri: groups[r.category] for r in self._objects}

    def draw(self, title: str) -> Sheet:
        """Everything, from the floor up."""
        spots = self._spots()
        sheet = Sheet(
            Extent.around(np.vstack([spots, self._corners()])),
            [record.p_map[:2] for record in self._named],
            title=title,
            line=self._summary(),
            legend=self._legend(),
            listing=self._search.listing,
        )
        self._draw_surroundings(sheet)
        texts = self._draw_search(sheet)
        size = _SIZES[len(self._objects) > _CROWD]
        for record in self._objects:
            draw_object(sheet.axes, record, self._groups[record.iri], size)
        if self._robot is not None:
            draw_robot(sheet.axes, self._robot, sheet.metres(_ARROW))
        self._write_names(sheet, spots, texts)
        return sheet

    def _spots(self) -> NDArray[np.float64]:
        """(n, 2) [m] all points of spots and lines."""
        points = [record.p_map[:2] for record in self._objects] + self._search.spots
        points += [] if self._robot is None else [self._robot.p_map[:2]]
        return np.array(points, np.float64).reshape(-1, 2)

    def _corners(self) -> NDArray[np.float64]:
        corners = [c for p in self._places for c in ((p.xmin, p.ymin), (p.xmax, p.ymax))]
        if self._truth is not None:
            corners += [(float(x), float(y)) for x, y in self._truth.corners]
        if self._floor is not None:
            corners += list(self._floor.bounds)
        return np.array(corners, np.float64).reshape(-1, 2)

    def _draw_surroundings(self, sheet: Sheet) -> None:
        coloured = [(place, self._colour(place)) for place in self._places]
        for place, colour in coloured:
            draw_place(sheet.axes, place, colour, filled=self._floor is None)
        if self._floor is not None:
            known = [(place, colour) for place, colour in coloured if colour is not None]
            draw_floor(sheet.axes, self._floor, known)
            if len(self._surface):
                draw_surface(sheet.axes, self._surface, self._height)
        if self._truth is not None:
            draw_ground_truth(sheet.axes, self._truth)
        else:
            for door in self._doors:
                draw_door(sheet.axes, door)

    def _colour(self, place: PlaceRecord) -> str | None:
        best = top_category(place)
        return None if best is None else self._of_places[best].colour

    def _draw_search(self, sheet: Sheet) -> list[Text]:
        search = self._search
        if search.shade is not None:
            draw_shade(sheet.axes, search.shade)
        if len(search.route):
            draw_route(sheet.axes, search.route)
        for find in search.finds:
            draw_find(sheet.axes, find)
        return [draw_stop(sheet.axes, stop, sheet.metres(_SECTOR)) for stop in search.stops]

    def _write_names(self, sheet: Sheet, spots: NDArray[np.float64], texts: list[Text]) -> None:
        covers = self._walls(sheet)
        places = [self._named_place(place) for place in self._places]
        written, lost = write_place_names(sheet, places, spots, covers)
        labels = [PointLabel(o.p_map, self._name(o), INK) for o in self._named]
        marks = [stop.p_map for stop in self._search.stops] + list(self._search.finds)
        marks += [] if self._robot is None else [self._robot.p_map]
        lost += write_labels(sheet, labels, texts=texts + written, marks=marks, covers=covers)
        if lost:
            sheet.write_note(f"{_count(lost, 'name')} left out for lack of room")

    def _walls(self, sheet: Sheet) -> WallsBelow | None:
        if self._truth is not None:
            corners, cell = self._truth.corners, 0.05
            walls = wall_cells(self._truth.walls, corners, cell)
            return WallsBelow(walls, corners[0], cell, sheet.axes)
        if self._floor is None:
            return None
        floor = self._floor
        return WallsBelow(floor.states == TALL, floor.origin, floor.resolution, sheet.axes)

    def _named_place(self, place: PlaceRecord) -> NamedPlace:
        best, label = top_category(place), drawable(place.label)
        if best is None:
            return NamedPlace(place.area, label, "not viewed yet")
        sure = place.beliefs[best] >= SURE
        kind = ("" if sure else "perhaps ") + plain_place(self._label(best))
        names = drawable(kind), label
        if not NUMBERED.fullmatch(place.label):  # a person, or the recording, named it
            names = label, kind
        return NamedPlace(place.area, names[0], f"{names[1]}, belief {place.beliefs[best]:.2f}")

    def _name(self, record: ObjectRecord) -> str:
        own = self._title(record.category, record.iri) if self._numbered else ""
        return drawable(self._names.get(record.iri) or own or self._label(record.category))

    def _summary(self) -> str:
        unseen = sum(not place.views for place in self._places)
        parts = [_count(len(self._named), "object"), _count(len(self._places), "place")]
        parts[1] += f", {unseen} not viewed yet" if unseen else ""
        parts += [_count(len(self._search.stops), "stop")] if self._search.stops else []
        return "   ·   ".join(parts)

    def _legend(self) -> list[Line2D]:
        counts = Counter(self._groups[record.iri] for record in self._named)
        groups = sorted(counts, key=lambda g: (g.name in ("other", "elsewhere"), g.name))
        marks = [
            mark(g.marker, f"{drawable(g.name)} {counts[g]}", mfc=g.colour, mec="white")
            for g in groups
        ]
        if any(record.existence < SHOWN_EXISTENCE for record in self._objects):
            ghost = f"existence below {SHOWN_EXISTENCE:g}"
            marks.append(mark("o", ghost, mfc="none", mec=FAINT, alpha=0.6, ms=6.2))
        return marks + self._search_legend() + self._floor_legend()

    def _search_legend(self) -> list[Line2D]:
        marks = []
        if self._robot is not None:
            marks.append(mark((3, 0, -90), "robot", mfc=INK, mec="white"))
        if len(self._search.route):
            marks.append(Line2D([], [], color=ROUTE, lw=1.7, ls=(0, (4, 2)), label="route"))
        if (shade := self._search.shade) is not None:
            marks.append(mark("s", shade.label, mfc=shade.colour, mec="none", alpha=0.45))
        if self._search.finds:
            marks.append(mark("*", "found", mfc=FOUND, mec=INK, mew=0.7))
        return marks

    def _floor_legend(self) -> list[Line2D]:
        if self._truth is not None:
            return [mark("+", "truth", mec=TRUE_SPOT)]
        marks = []
        if self._doors:
            marks.append(mark("o", "door", mfc="white", mec=FAINT, ms=4.2, mew=0.8))
        if self._floor is not None:
            marks.append(mark("s", "wall", mfc=WALL, mec="none"))
        if self._floor is not None and not len(self._surface):
            marks.append(mark("s", "furniture", mfc=FURNITURE, mec="none", alpha=0.45))
            marks.append(mark("s", "never seen", mfc="white", mec=FAINT, mew=0.6))
        return marks


def _count(n: int, what: str) -> str:
    return f"{n:,} {what}" + ("" if n == 1 else "s")
