"""Drawing of places, objects, robot, route and floor on axes in map metres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb, to_rgba
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch, Polygon, Rectangle, Wedge
from matplotlib.path import Path
from matplotlib.text import Text
from numpy.typing import NDArray

from hereabouts.display.plots.palette import (
    FAINT,
    FLOOR,
    FOUND,
    FURNITURE,
    INK,
    OUTLINE,
    ROUTE,
    TRUE_SPOT,
    WALL,
    Group,
    pale,
)
from kg.maps.surface.voxels import Surface
from kg.model.records import (
    LOW,
    TALL,
    UNKNOWN,
    DoorRecord,
    ObjectRecord,
    PlaceRecord,
    RobotRecord,
)
from mapping.occupancy.mapped_floor import MappedFloor

#: minimum existence of objects that are drawn as things; the others are ghosts
SHOWN_EXISTENCE: Final = 0.5
#: [m] the surface is drawn from this far below the floor up to this far above it
BELOW: Final = 0.3
CUT: Final = 2.0


def draw_place(axes: Axes, place: PlaceRecord, colour: str | None, *, filled: bool) -> None:
    """The outline of a place, dashed if `colour` is None; `filled` with a pale `colour`."""
    path = Path.make_compound_path(  # holes run the other way round and are not filled
        *(Path([*ring, ring[0]], closed=True) for ring in place.area.oriented_rings)
    )
    fill = pale(colour) if filled and colour else "white" if filled else "none"
    line = (0, (4, 3)) if colour is None else "solid"
    edge = to_rgba(colour or TRUE_SPOT, 0.75)
    axes.add_patch(PathPatch(path, fc=fill, ec=edge, lw=0.9, ls=line, zorder=1.07))


@dataclass(frozen=True, slots=True, eq=False)
class GroundTruth:
    """Ground truth that is drawn beside a map; lengths in metres of the map frame."""

    corners: NDArray[np.float64]  # (2, 2) lowest and highest x, y
    boxes: NDArray[np.float64]  # (k, 2, 3) lowest and highest x, y, z of furniture and objects
    walls: NDArray[np.float64]  # (w, 2, 2) both ends x, y of each piece of wall
    objects: NDArray[np.float64]  # (n, 2) middles x, y


def draw_ground_truth(axes: Axes, truth: GroundTruth) -> None:
    """Walls with doorways, furniture from above, and a cross at each true object."""
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
    """A dashed line along `route` (n, 2) [m], with a ring at its start."""
    axes.plot(*route.T, color="white", lw=4.2, zorder=4, solid_joinstyle="round")
    axes.plot(*route.T, color=ROUTE, lw=1.7, zorder=4.1, ls=(0, (5, 2.2)), dash_capstyle="round")
    axes.plot(*route[:1].T, "o", ms=7, mfc="white", mec=ROUTE, mew=1.7, zorder=4.2)


def draw_find(axes: Axes, p_map: NDArray[np.float64]) -> None:
    """A star at `p_map` (2,) or (3,) [m]."""
    style: dict[str, Any] = {"mfc": FOUND, "mec": INK, "mew": 0.9}
    axes.plot(float(p_map[0]), float(p_map[1]), "*", ms=17, zorder=8.5, **style)


def draw_object(axes: Axes, record: ObjectRecord, group: Group, size: float = 6.2) -> None:
    """A mark of `size` [pt] in its group's colour and shape; hollow for a low existence.

    The box is outlined if the extent is known.
    """
    x, y, _ = record.p_map
    style: dict[str, Any] = {"marker": group.marker, "ms": size, "ls": "none"}
    if record.existence < SHOWN_EXISTENCE:
        style |= {"mfc": "none", "mec": group.colour, "mew": 0.9, "alpha": 0.45, "zorder": 5.5}
    else:
        alpha = 0.35 + 0.65 * float(np.clip(record.existence, 0, 1))
        rim = {"mec": "white", "mew": min(0.8, size / 8)}
        style |= {"mfc": group.colour, "alpha": alpha, "zorder": 6, **rim}
        corners = record.footprint
        if corners is not None and np.isfinite(corners).all():
            fill, edge = to_rgba(group.colour, 0.05), to_rgba(group.colour, 0.4)
            axes.add_patch(Polygon(corners, fc=fill, ec=edge, lw=0.7, zorder=3.5))
    axes.plot(x, y, **style)


@dataclass(frozen=True, slots=True, eq=False)
class Shade:
    """A tint over the floor."""

    label: str  # for the legend
    colour: str
    strength: NDArray[np.float64]  # (nx, ny) 0..1
    corner: NDArray[np.float64]  # (2,) [m] of cell (0, 0)
    cell: float  # [m]


def draw_shade(axes: Axes, shade: Shade) -> None:
    """Each cell in the shade's colour, the more opaque the stronger."""
    image = np.empty((*shade.strength.T.shape, 4))
    image[..., :3] = to_rgb(shade.colour)
    image[..., 3] = shade.strength.T
    _draw_cells(axes, image, shade.corner, shade.cell, zorder=1.08, interpolation="bilinear")


def draw_floor(
    axes: Axes, floor: MappedFloor, places: Sequence[tuple[PlaceRecord, str]] = ()
) -> None:
    """Draw the mapped floor: free cells in the pale colours of `places`, furniture, walls.

    Cells that no depth image showed stay white.
    """
    states = floor.states
    ground = np.zeros((*states.shape, 4))
    ground[states != UNKNOWN] = to_rgba(FLOOR)
    for place, colour in places:
        columns, rows, inside = _cells_of(floor, place)
        part = ground[columns, rows]
        part[inside & (states[columns, rows] != UNKNOWN)] = to_rgba(pale(colour))
    above = np.zeros((*states.shape, 4))
    above[states == LOW] = to_rgba(FURNITURE, 0.42)
    above[states == TALL] = to_rgba(WALL, 0.95)
    for image, zorder in ((ground, 1.05), (above, 1.1)):
        image = image.transpose(1, 0, 2)
        _draw_cells(axes, image, floor.origin, floor.resolution, zorder=zorder)


def draw_surface(axes: Axes, surface: Surface, height: float) -> None:
    """Draw the surface from above: each column in the colour of its topmost voxel.

    Voxels from below the floor at `height` [m] up to `CUT` above it are shown, without the ceiling.
    """
    above = surface.points[:, 2] - height
    kept = np.flatnonzero((above > -BELOW) & (above < CUT))
    if not len(kept):
        return
    kept = kept[np.argsort(above[kept], kind="stable")]  # the topmost is written last
    cells = np.floor(surface.points[kept, :2] / surface.size).astype(np.int64)
    first = cells.min(0)
    image = np.zeros((*(cells.max(0) - first + 1), 4))
    columns, rows = (cells - first).T
    image[columns, rows, :3] = surface.colours[kept] / 255
    image[columns, rows, 3] = 1.0
    corner = first * surface.size
    _draw_cells(axes, image.transpose(1, 0, 2), corner, surface.size, zorder=1.12)


def _cells_of(floor: MappedFloor, place: PlaceRecord) -> tuple[slice, slice, NDArray[np.bool_]]:
    """Columns and rows around a place, and whether each cell has its centre in the place."""
    corners = np.array([(place.xmin, place.ymin), (place.xmax, place.ymax)])
    cells = np.round((corners - floor.origin) / floor.resolution).astype(np.int64)
    (i0, j0), (i1, j1) = np.clip(cells, 0, floor.states.shape)
    x = floor.origin[0] + (np.arange(i0, i1) + 0.5) * floor.resolution
    y = floor.origin[1] + (np.arange(j0, j1) + 0.5) * floor.resolution
    return slice(i0, i1), slice(j0, j1), place.area.contains_each(x[:, None], y[None, :])


def _draw_cells(
    axes: Axes,
    image: NDArray[np.float64],
    corner: NDArray[np.float64],
    cell: float,
    *,
    zorder: float,
    interpolation: str = "nearest",
) -> None:
    """Draw an image (ny, nx, 4) with pixels of side `cell` [m], from `corner` on."""
    (x, y), (rows, columns) = corner, image.shape[:2]
    box = (float(x), float(x + columns * cell), float(y), float(y + rows * cell))
    axes.imshow(
        image,
        extent=box,
        origin="lower",
        interpolation=interpolation,
        zorder=zorder,
        aspect="equal",
    )


def draw_door(axes: Axes, door: DoorRecord) -> None:
    """A small ring in the middle of a passage."""
    axes.plot(door.x, door.y, "o", ms=3.2, mfc="white", mec=FAINT, mew=0.8, zorder=3)


@dataclass(frozen=True, slots=True, eq=False)
class Stop:
    """A spot from which one or several looks are taken."""

    p_map: NDArray[np.float64]  # (2,) [m]
    text: str  # the numbers of its looks
    looks: tuple[tuple[float, float], ...] = ()  # heading and extent of each [rad]


def draw_stop(axes: Axes, stop: Stop, reach: float) -> Text:
    """A numbered disc, and a sector of radius `reach` [m] for each look."""
    x, y = float(stop.p_map[0]), float(stop.p_map[1])
    for heading, extent in stop.looks:
        sides = np.degrees([heading - extent / 2, heading + extent / 2])
        style: dict[str, Any] = {"fc": to_rgba(ROUTE, 0.14), "ec": to_rgba(ROUTE, 0.45), "lw": 0.7}
        axes.add_patch(Wedge((x, y), reach, *sides, zorder=3.8, **style))
    axes.plot(x, y, "o", ms=14, mfc=ROUTE, mec="white", mew=1.4, zorder=8)
    style = {"ha": "center", "va": "center_baseline", "fontweight": "bold"}
    if len(stop.text) > 2:  # too long for a disc: a rounded box
        style["bbox"] = {"boxstyle": "round,pad=0.35,rounding_size=0.9", "fc": ROUTE, "ec": "white"}
    return axes.text(x, y, stop.text, color="white", fontsize=8.5, zorder=9, **style)


def draw_robot(axes: Axes, robot: RobotRecord, reach: float) -> None:
    """An arrowhead of `reach` [m] along its heading."""
    angles = robot.heading + np.array([0.0, 2.5, np.pi, -2.5])
    radii = reach * np.array([1.15, 0.95, 0.42, 0.95])
    corners = robot.p_map[:2] + np.column_stack([np.cos(angles), np.sin(angles)]) * radii[:, None]
    axes.add_patch(Polygon(corners, closed=True, fc=INK, ec="white", lw=1.2, zorder=7.5))


def mark(marker: Any, label: str, **style: Any) -> Line2D:
    """An entry of the legend."""
    return Line2D([], [], **{"ls": "none", "marker": marker, "ms": 7.5, "label": label} | style)
