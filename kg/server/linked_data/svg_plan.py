"""The map as a small SVG floor plan: places, objects, the robot."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from html import escape
from typing import Final

import numpy as np

from kg.records import PlaceRecord, RobotRecord

MARGIN: Final = 0.6  # [m] around what is drawn
LETTER: Final = 0.55  # a letter's width in its size
TONES: Final = 8  # colours of the style sheet's .tone0, .tone1, ...

#: link, tooltip, category, x [m], y [m], existence
Spot = tuple[str, str, str, float, float, float]


def floor_plan(
    places: Sequence[PlaceRecord],
    spots: Sequence[Spot],
    robot: RobotRecord | None,
    category: Callable[[PlaceRecord], str],
) -> str:
    """An ``<svg>`` with y up, one unit a metre; an empty text where there is nothing to draw."""
    corners = [(x, y) for p in places for x, y in ((p.xmin, p.ymin), (p.xmax, p.ymax))]
    corners += [(x, y) for *_, x, y, _ in spots]
    corners += [(float(robot.p_map[0]), float(robot.p_map[1]))] if robot else []
    if not corners:
        return ""
    low, high = np.min(corners, axis=0) - MARGIN, np.max(corners, axis=0) + MARGIN
    width, height = (float(size) for size in high - low)
    unit = max(width, height) / 100
    kinds = {kind: n for n, kind in enumerate(sorted({spot[2] for spot in spots}))}
    parts = [_place(place, category(place), unit) for place in places]
    parts += [_spot(spot, kinds[spot[2]] % TONES, unit) for spot in spots]
    parts += [_robot(robot, unit)] if robot else []
    view = f"{low[0]:.2f} {-high[1]:.2f} {width:.2f} {height:.2f}"
    return (
        f'<svg class="floor" viewBox="{view}" role="img" aria-label="Floor plan">'
        f"{''.join(parts)}</svg>"
    )


def _place(place: PlaceRecord, category: str, unit: float) -> str:
    width, height = place.area.size
    size = 2.6 * unit
    # a name that does not fit would run over the neighbours'
    fits = len(category) * LETTER * size < width - 2 * unit and 2 * size < height
    name = (
        f'<text class="place-name" x="{place.xmin + unit:.2f}" '
        f'y="{-place.ymax + unit + 0.8 * size:.2f}" font-size="{size:.2f}">'
        f"{escape(category)}</text>"
    )
    return f"{_shape(place, unit)}{name if fits else ''}"


def _shape(place: PlaceRecord, unit: float) -> str:
    width, height = place.area.size
    title = f"<title>{escape(place.label)}</title>"
    if place.outline:
        rings = (" L".join(f"{x:.2f} {-y:.2f}" for x, y in ring) for ring in place.outline)
        path = "".join(f"M{ring}Z" for ring in rings)
        return f'<path class="place" fill-rule="evenodd" d="{path}">{title}</path>'
    return (
        f'<rect class="place" x="{place.xmin:.2f}" y="{-place.ymax:.2f}" width="{width:.2f}" '
        f'height="{height:.2f}" rx="{unit:.2f}">{title}</rect>'
    )


def _spot(spot: Spot, tone: int, unit: float) -> str:
    link, tooltip, _, x, y, existence = spot
    opacity = 0.35 + 0.65 * min(max(existence, 0.0), 1.0)
    return (
        f'<a href="{escape(link)}"><circle class="tone{tone}" cx="{x:.2f}" cy="{-y:.2f}" '
        f'r="{0.9 * unit:.2f}" opacity="{opacity:.2f}"><title>{escape(tooltip)}</title>'
        f"</circle></a>"
    )


def _robot(robot: RobotRecord, unit: float) -> str:
    x, y = float(robot.p_map[0]), -float(robot.p_map[1])
    degrees = -math.degrees(robot.heading)
    reach = 1.8 * unit
    shape = f"{reach:.2f},0 {-reach:.2f},{reach * 0.8:.2f} {-reach:.2f},{-reach * 0.8:.2f}"
    return (
        f'<polygon class="robot" points="{shape}" '
        f'transform="translate({x:.2f} {y:.2f}) rotate({degrees:.1f})">'
        f"<title>robot</title></polygon>"
    )
