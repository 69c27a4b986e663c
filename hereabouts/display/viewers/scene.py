"""Scene: the content of a map, and of a planned search, that viewers draw at one moment.

Colours and choice are those of `hereabouts plot`: objects of existence 0.5 and above in their
group's colour, places in that of their likeliest category. Each group has a shape as well, as in
the thesis' markers.
"""

from __future__ import annotations

import math
import re
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np
from matplotlib.colors import to_rgb
from numpy.typing import NDArray

from hereabouts.display.plots.drawing import SHOWN_EXISTENCE
from hereabouts.display.plots.palette import (
    FREQUENT,
    Group,
    object_groups,
    pale,
    place_groups,
    top_category,
)
from hereabouts.display.plots.search_plot import SAME, shown_steps
from kg.maps.semantic_map import SemanticMap
from kg.maps.surface.voxels import Surface, coarser
from kg.model.areas import Outline, polygon_of
from kg.model.records import FloorTile, ObjectRecord, PlaceRecord, RobotRecord
from mapping.occupancy.mapped_floor import MappedFloor, mapped_floor
from planner.execution.protocol import cleaned
from planner.search.plans.report import step_purpose
from planner.search.plans.search_state import build_search
from planner.search.plans.view_plan import Start, ViewStep, plan_from, planned_route

Shape = Literal["cube", "sphere", "cylinder"]
Colour = tuple[float, float, float]  # red, green, blue, 0..1
Point = tuple[float, float, float]  # (x, y, z) [m] in the map frame

_OBJECT: Final = "object/"
_SHAPES: Final[tuple[Shape, ...]] = ("cube", "cylinder", "sphere")
_MIN_PROBABILITY: Final = 0.5  # of a drawn relation
MAX_VOXELS: Final = 300_000  # of a drawn surface; more are joined into larger ones
_SURFACE_PERIOD: Final = 5.0  # [s] between two readings of the surface


@dataclass(frozen=True, slots=True)
class SceneObject:
    """An object: a marker with text, and its box where the extent is known."""

    name: str  # object/17
    text: str  # its category
    group: str  # objects of a group share colour and shape
    shape: Shape
    colour: Colour
    existence: float  # 0..1
    p_map: Point
    extent: Point | None  # [m] of its box along its own axes, centred at `p_map`
    yaw: float = 0.0  # [rad] of its box about z


@dataclass(frozen=True, slots=True)
class ScenePlace:
    """A place: a piece of floor with a name on it."""

    name: str  # place/1
    text: str
    colour: Colour | None  # None: not viewed yet
    outline: Outline  # rings [m], holes after the first
    centre: Point  # a point well inside, on the floor


@dataclass(frozen=True, slots=True)
class SceneStop:
    """A stop of a search plan, from which the robot looks."""

    p_map: tuple[float, float]  # [m]
    heading: float  # [rad] the middle of the look
    text: str  # reasons; "" if another stop on the same spot has them


@dataclass(frozen=True, slots=True)
class ScenePlan:
    """A search plan: the way and its stops."""

    path: tuple[tuple[float, float], ...]  # (x, y) [m]
    stops: tuple[SceneStop, ...]


@dataclass(frozen=True, slots=True, eq=False)
class SceneFloor:
    """The occupancy floor of one storey, with its height [m]."""

    grid: MappedFloor
    height: float

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, SceneFloor)
            and self.height == other.height
            and np.array_equal(self.grid.origin, other.grid.origin)
            and self.grid.resolution == other.grid.resolution
            and np.array_equal(self.grid.states, other.grid.states)
        )

    __hash__ = None  # type: ignore[assignment]


@dataclass(frozen=True, slots=True)
class SceneFrame:
    """The frame of tf of an object that was asked for."""

    name: str  # as it was asked for, in letters, digits and _
    p_map: Point
    yaw: float  # [rad] about z


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """All drawn parts of a map."""

    title: str
    objects: tuple[SceneObject, ...] = ()
    places: tuple[ScenePlace, ...] = ()
    #: ends of lines between objects that are on, inside or beside one another
    relations: tuple[tuple[Point, Point], ...] = ()
    floor: SceneFloor | None = None
    robot: RobotRecord | None = None
    plan: ScenePlan | None = None
    surface: Surface = field(default_factory=Surface.empty)
    frames: tuple[SceneFrame, ...] = ()


class SceneReader:
    """Reads the scene of a map repeatedly; groups of objects are computed only after changes."""

    def __init__(
        self,
        semantic_map: SemanticMap,
        least: float = SHOWN_EXISTENCE,
        frames: Sequence[str] = (),
    ) -> None:
        """`frames` are the things that get a frame of tf: a name of its kind, or object/N.

        Raises UnknownCategoryError for a kind that the map does not know.
        """
        self._map, self._least, self._frames = semantic_map, least, frames
        self._asked = dict[str, str]()  # IRI of the object that each has
        for name in frames:
            if not name.startswith(_OBJECT):
                semantic_map.catalogue.find(name, "object")
        self._counts: dict[str, int] | None = None
        self._groups: dict[str, Group] = {}
        self._surface, self._surface_at = Surface.empty(), -math.inf

    def read(self, plan: ScenePlan | None = None, *, fresh: bool = False) -> Scene:
        """The scene as the map is now, with a `plan`.

        The surface is read again every few seconds only, or if `fresh`; else it is the same object.
        """
        if fresh or time.monotonic() - self._surface_at > _SURFACE_PERIOD:
            found = self._map.surface(min_count=2)
            self._surface, self._surface_at = coarser(found, MAX_VOXELS), time.monotonic()
        robot = self._map.robot()
        robot = robot if robot is not None and np.isfinite(robot.p_map).all() else None
        floor = _floor(self._map.floor(), None if robot is None else float(robot.p_map[2]))
        records = self._map.objects(min_existence=self._least)
        records = tuple(r for r in records if np.isfinite(r.p_map).all())
        return Scene(
            title=cleaned(self._map.description.title),
            objects=tuple(self._objects(records)),
            places=tuple(self._places(self._map.places(), floor.height if floor else 0.0)),
            relations=tuple(self._relations(records)),
            floor=floor,
            robot=robot,
            plan=plan,
            surface=self._surface,
            frames=tuple(self._asked_for(records)),
        )

    def _asked_for(self, records: Sequence[ObjectRecord]) -> Iterator[SceneFrame]:
        """Of each kind the surest object, and the same as before while it is believed."""
        believed = {record.iri: record for record in records}
        for name in self._frames:
            if name.startswith(_OBJECT):
                named = believed.get(self._map.base + name)
                found: Sequence[ObjectRecord] = () if named is None else (named,)
            else:
                found = self._map.objects(name, min_existence=self._least)
            same = [one for one in found if one.iri == self._asked.get(name)]
            best = max(same or found, key=lambda one: one.existence, default=None)
            if best is not None and np.isfinite(best.p_map).all():
                self._asked[name] = best.iri
                yaw = best.yaw if math.isfinite(best.yaw) else 0.0
                yield SceneFrame(re.sub(r"\W", "_", name), _point(best.p_map), yaw)

    def _name(self, iri: str) -> str:
        return iri.removeprefix(self._map.base)

    def _objects(self, records: Sequence[ObjectRecord]) -> Iterable[SceneObject]:
        groups = self._groups_of(records)
        names = sorted({group.name for group in groups.values()} - {"other"})
        shapes = {name: _SHAPES[i % len(_SHAPES)] for i, name in enumerate(names)}
        for record in records:
            group = groups[record.category]
            extent = record.extent
            sized = extent is not None and np.isfinite(extent).all() and (extent > 0).all()
            yield SceneObject(
                name=self._name(record.iri),
                text=cleaned(self._map.catalogue.label(record.category)),
                group=group.name,
                shape=shapes.get(group.name, "sphere"),
                colour=to_rgb(group.colour),
                existence=round(min(max(record.existence, 0.0), 1.0), 3),
                p_map=_point(record.p_map),
                extent=_point(extent) if extent is not None and sized else None,
                yaw=record.yaw if math.isfinite(record.yaw) else 0.0,
            )

    def _groups_of(self, records: Sequence[ObjectRecord]) -> dict[str, Group]:
        counts = {c: min(n, FREQUENT) for c, n in Counter(r.category for r in records).items()}
        if counts != self._counts:
            self._groups, self._counts = object_groups(self._map, records), counts
        return self._groups

    def _places(self, records: Sequence[PlaceRecord], height: float) -> Iterable[ScenePlace]:
        groups = place_groups(self._map, records)
        for place in records:
            best = top_category(place)
            label = cleaned(place.label)
            if best is not None:
                category = cleaned(self._map.catalogue.label(best))
                text = f"{category}\n{label}, belief {place.beliefs[best]:.2f}"
            else:
                text = f"{label}\nnot viewed yet"
            yield ScenePlace(
                name=self._name(place.iri),
                text=text,
                colour=None if best is None else to_rgb(pale(groups[best].colour)),
                outline=place.area.rings,
                centre=(*place.area.centre, height),
            )

    def _relations(self, records: Sequence[ObjectRecord]) -> Iterable[tuple[Point, Point]]:
        at = {record.iri: _point(record.p_map) for record in records}
        for record in records:
            for relation in record.relations or ():
                if relation.probability >= _MIN_PROBABILITY and relation.target in at:
                    yield at[record.iri], at[relation.target]


def past_scenes(
    semantic_map: SemanticMap, steps: int, least: float = SHOWN_EXISTENCE
) -> Iterator[tuple[Scene, float]]:
    """Up to `steps` earlier scenes, oldest first, each with the robot's time then [s since 1970].

    Neither the present nor the time before the first robot pose is included.
    Raises HistoryError for a map without a history on this machine.
    """
    log = semantic_map.history.log
    numbers = np.linspace(log.floor, log.last, steps + 1)[:-1]
    for number in dict.fromkeys(int(n) for n in numbers):
        with semantic_map.at(number) as then:
            scene = SceneReader(then, least).read()
        if scene.robot is not None:
            yield scene, scene.robot.stamp


def present_scene(
    semantic_map: SemanticMap, least: float = SHOWN_EXISTENCE, plan: ScenePlan | None = None
) -> tuple[Scene, float]:
    """The present scene with a `plan`, and the robot's time or now [s since 1970]."""
    scene = SceneReader(semantic_map, least).read(plan)
    return scene, time.time() if scene.robot is None else scene.robot.stamp


def _point(values: NDArray[np.float64]) -> Point:
    x, y, z = (round(float(value), 3) for value in values)
    return x, y, z


def _floor(tiles: Sequence[FloorTile], camera: float | None) -> SceneFloor | None:
    grid = mapped_floor(tiles, camera)
    if grid is None:
        return None
    height = next(tile.height for tile in tiles if tile.storey == grid.storey)
    return SceneFloor(grid.cropped(), height)


def triangles(outline: Outline) -> NDArray[np.float64]:
    """(n, 3, 2) [m] constrained Delaunay triangles of the inside of `outline`."""
    import shapely

    parts = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon_of(outline)))
    corners: NDArray[np.float64] = shapely.get_coordinates(parts).reshape(-1, 4, 2)[:, :3]
    return corners


def planned_search(
    semantic_map: SemanticMap, target: str, start: Start | None = None
) -> ScenePlan | None:
    """The first looks for `target`, which together have nine tenths of the plan's success.

    The plan begins at `start`, or at the robot's pose. None without a floor to search.
    Raises UnknownCategoryError for an unknown target.
    """
    state = build_search(semantic_map, [target], start=start and start[:2])
    if state is None:
        return None
    found = plan_from(state, start)
    steps = shown_steps(found)
    path = planned_route(state, found, steps) if steps else np.empty((0, 2))
    return ScenePlan(tuple((float(x), float(y)) for x, y in path), _stops(steps))


def _stops(steps: Sequence[ViewStep]) -> tuple[SceneStop, ...]:
    """A stop for each look; looks from one spot have their reasons at the first stop."""
    spots: list[tuple[float, float]] = []
    reasons: list[list[str]] = []
    for number, step in enumerate(steps, start=1):
        at = float(step.p_map[0]), float(step.p_map[1])
        first = next((i for i, spot in enumerate(spots) if math.dist(spot, at) < SAME), len(spots))
        what = step_purpose(step) or step.place_name
        reason = cleaned(f"{number}. {what}: {step.probability:.2f}, by {step.seconds:.0f} s")
        spots.append(at)
        reasons.append([])
        reasons[first].append(reason)
    return tuple(
        SceneStop(spot, step.heading, "\n".join(lines))
        for spot, step, lines in zip(spots, steps, reasons, strict=True)
    )
