"""Drawing of places, objects, robot, route and floor on axes in map metres."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch, Polygon, Rectangle
from matplotlib.path import Path
from matplotlib.text import Text
from numpy.typing import NDArray

from kg.areas import Ring, signed_area
from kg.records import FREE, LOW, TALL, ObjectRecord, PlaceRecord, RobotRecord
from mapping.occupancy.mapped_floor import MappedFloor
from planner.goals.search_goals import Goal
from planner.visualization.palette import (
    FOUND,
    FURNITURE,
    INK,
    OUTLINE,
    ROUTE,
    TRUE_SPOT,
    WALL,
    Group,
)


def draw_place(axes: Axes, place: PlaceRecord, colour: str | None) -> None:
    """Its area; white and dashed where `colour` is None, for it has not been viewed."""
    fill, line = ("white", (0, (4, 3))) if colour is None else (colour, "solid")
    path = Path.make_compound_path(
        *(Path([*ring, ring[0]], closed=True) for ring in _turned(place))
    )
    axes.add_patch(PathPatch(path, fc=fill, ec="#b9bec7", lw=0.9, ls=line))


def _turned(place: PlaceRecord) -> Iterator[Ring]:
    """Its rings, holes the other way round than the outer one, so that they are not filled."""
    for number, ring in enumerate(place.area.rings):
        yield ring if (signed_area(ring) > 0) == (number == 0) else ring[::-1]


@dataclass(frozen=True, slots=True, eq=False)
class GroundTruth:
    """Ground truth beside a map: what really is where; all in metres of the map frame."""

    corners: NDArray[np.float64]  # (2, 2) lowest and highest x, y
    boxes: NDArray[np.float64]  # (k, 2, 3) lowest and highest x, y, z of furniture and objects
    walls: NDArray[np.float64]  # (w, 2, 2) both ends x, y of each piece of wall
    objects: NDArray[np.float64]  # (n, 2) middles x, y


def draw_ground_truth(axes: Axes, truth: GroundTruth) -> None:
    """Walls with their doorways, furniture from above, and a cross where each object truly is."""
    style: dict[str, Any] = {"fc": (1, 1, 1, 0.5), "ec": OUTLINE, "lw": 0.6}
    for lo, hi in truth.boxes:
        if lo[2] > 0.9 or hi[2] < 0.05:
            continue  # hangs on a wall, or lies flat
        corner, (width, depth) = (float(lo[0]), float(lo[1])), hi[:2] - lo[:2]
        axes.add_patch(Rectangle(corner, width, depth, zorder=1.5 + 0.1 * float(lo[2]), **style))
    for ends in truth.walls:
        axes.plot(*ends.T, color=WALL, lw=2.6, solid_capstyle="projecting", zorder=2)
    axes.plot(*truth.objects.T, "+", color=TRUE_SPOT, ms=4.5, mew=0.7, zorder=2.5)


def draw_route(axes: Axes, route: NDArray[np.float64]) -> None:
    """A dashed line along `route` (n, 2) [m], with a ring where it begins."""
    axes.plot(*route.T, color="white", lw=4.2, zorder=4, solid_joinstyle="round")
    axes.plot(*route.T, color=ROUTE, lw=1.7, zorder=4.1, ls=(0, (5, 2.2)), dash_capstyle="round")
    axes.plot(*route[:1].T, "o", ms=7, mfc="white", mec=ROUTE, mew=1.7, zorder=4.2)


def draw_find(axes: Axes, p_map: NDArray[np.float64]) -> None:
    """A star at `p_map` (2,) or (3,) [m]."""
    style: dict[str, Any] = {"mfc": FOUND, "mec": INK, "mew": 0.9}
    axes.plot(float(p_map[0]), float(p_map[1]), "*", ms=17, zorder=8.5, **style)


def draw_object(axes: Axes, record: ObjectRecord, group: Group) -> None:
    """A dot in its group's colour, fainter where existence is doubtful."""
    x, y, _ = record.p_map
    alpha = 0.35 + 0.65 * float(np.clip(record.existence, 0, 1))
    axes.plot(x, y, "o", ms=6.2, mfc=group.colour, mec="white", mew=0.9, alpha=alpha, zorder=6)


@dataclass(frozen=True, slots=True, eq=False)
class Shade:
    """A tint over the floor."""

    label: str  # for the legend
    colour: str
    strength: NDArray[np.float64]  # (nx, ny) 0..1
    corner: NDArray[np.float64]  # (2,) [m] of cell (0, 0)
    cell: float  # [m]


def draw_shade(axes: Axes, shade: Shade) -> None:
    """Each cell in the shade's colour, the more opaque the stronger; a thin line around it all."""
    nx, ny = shade.strength.shape
    far = shade.corner + np.array([nx, ny]) * shade.cell
    image = np.empty((ny, nx, 4))
    image[..., :3] = to_rgb(shade.colour)
    image[..., 3] = shade.strength.T
    box = (float(shade.corner[0]), float(far[0]), float(shade.corner[1]), float(far[1]))
    axes.imshow(image, extent=box, origin="lower", interpolation="bilinear", zorder=1.2)
    axes.set_aspect("equal")


def draw_floor(axes: Axes, floor: MappedFloor) -> None:
    """What depth showed of the floor: seen floor lighter, furniture grey, walls dark."""
    nx, ny = floor.states.shape
    far = floor.origin + np.array([nx, ny]) * floor.resolution
    tints = np.zeros((4, 4), np.uint8)
    tints[FREE] = (255, 255, 255, 140)
    for state, colour, strength in ((LOW, FURNITURE, 110), (TALL, WALL, 230)):
        tints[state] = (*(round(255 * c) for c in to_rgb(colour)), strength)
    box = (float(floor.origin[0]), float(far[0]), float(floor.origin[1]), float(far[1]))
    image = tints[floor.states.T]
    axes.imshow(image, extent=box, origin="lower", interpolation="nearest", zorder=1.1)
    axes.set_aspect("equal")


def draw_goal(axes: Axes, goal: Goal, number: str) -> Text:
    """A numbered disc."""
    x, y = float(goal.p_map[0]), float(goal.p_map[1])
    axes.plot(x, y, "o", ms=14, mfc=ROUTE, mec="white", mew=1.4, zorder=8)
    style: dict[str, Any] = {"ha": "center", "va": "center_baseline", "fontweight": "bold"}
    if len(number) > 2:  # more than the disc holds: it grows into a pill
        style["bbox"] = {"boxstyle": "round,pad=0.35,rounding_size=0.9", "fc": ROUTE, "ec": "white"}
    return axes.text(x, y, number, color="white", fontsize=8.5, zorder=9, **style)


def draw_robot(axes: Axes, robot: RobotRecord, reach: float) -> None:
    """An arrowhead of `reach` [m] along its heading."""
    angles = robot.heading + np.array([0.0, 2.5, np.pi, -2.5])
    radii = reach * np.array([1.15, 0.95, 0.42, 0.95])
    corners = robot.p_map[:2] + np.column_stack([np.cos(angles), np.sin(angles)]) * radii[:, None]
    axes.add_patch(Polygon(corners, closed=True, fc=INK, ec="white", lw=1.2, zorder=7.5))


def mark(marker: Any, label: str, **style: Any) -> Line2D:
    """An entry of the legend."""
    return Line2D([], [], **{"ls": "none", "marker": marker, "ms": 7.5, "label": label} | style)
