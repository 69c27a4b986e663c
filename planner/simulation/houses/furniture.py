"""Shapes of things: each class as a few boxes, cylinders and ellipsoids, one a line of a CSV file.

Local coordinates are in metres: x to the right, y to the front, z up; the origin is in the middle
of the underside. Sizes are those of ordinary household things.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Literal, cast

import numpy as np
from numpy.typing import NDArray

Shape = Literal["box", "cylinder", "ellipsoid"]
Surface = Literal["opaque", "screen", "glass"]
Facing = Literal["north", "west", "south", "east"]
RGB = tuple[float, float, float]

_FILE: Final = Path(__file__).with_name("furniture.csv")

FACINGS: Final[tuple[Facing, ...]] = ("north", "west", "south", "east")
QUARTER_TURNS: Final[Mapping[Facing, int]] = {facing: k for k, facing in enumerate(FACINGS)}


def turned(x: float, y: float, facing: Facing) -> tuple[float, float]:
    """(x, y) of a thing that faces north, turned with it to `facing`."""
    return ((x, y), (-y, x), (-x, -y), (y, -x))[QUARTER_TURNS[facing]]


@dataclass(frozen=True, slots=True)
class Solid:
    """An axis-aligned box, or the upright elliptic cylinder or ellipsoid that fills it."""

    shape: Shape
    lo: NDArray[np.float64]  # (3,) [m] map frame
    hi: NDArray[np.float64]  # (3,) [m]
    colour: RGB  # 0..1
    depth_return: bool = True  # False: a depth camera gets nothing back (lit screens, glass)

    def shifted(self, offset: NDArray[np.float64]) -> Solid:
        """The same solid, moved by `offset` (3,) [m]."""
        return replace(self, lo=self.lo + offset, hi=self.hi + offset)


@dataclass(frozen=True, slots=True)
class SolidPart:
    """One solid of a thing, in the thing's own coordinates."""

    x: float  # centre [m]
    y: float
    z: float  # underside [m]
    width: float  # along x [m]
    depth: float  # along y
    height: float
    colour: RGB
    shape: Shape = "box"
    surface: Surface = "opaque"

    def scaled(self, scale: tuple[float, float, float]) -> SolidPart:
        """The part of a thing that is `scale` times as wide, deep and high."""
        sx, sy, sz = scale
        return replace(
            self,
            x=self.x * sx,
            y=self.y * sy,
            z=self.z * sz,
            width=self.width * sx,
            depth=self.depth * sy,
            height=self.height * sz,
        )

    def placed(self, at: tuple[float, float, float], facing: Facing) -> Solid:
        """The part as a solid of the house, its front turned to `facing`."""
        half = np.array([self.width, self.depth]) / 2
        half = half[::-1] if QUARTER_TURNS[facing] % 2 else half
        centre = np.array(at[:2]) + turned(self.x, self.y, facing)
        lo = np.append(centre - half, at[2] + self.z)
        hi = np.append(centre + half, at[2] + self.z + self.height)
        return Solid(self.shape, lo, hi, self.colour)


def _shapes(kind: str) -> Mapping[str, tuple[SolidPart, ...]]:
    """The parts of each class of that kind, by its label, in the order of the file."""
    shapes = dict[str, tuple[SolidPart, ...]]()
    with _FILE.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            if row["kind"] == kind:
                shapes[row["label"]] = (*shapes.get(row["label"], ()), _part(row))
    return shapes


def _part(row: Mapping[str, str]) -> SolidPart:
    red, green, blue = map(float, row["colour"].split())
    return SolidPart(
        x=float(row["x"]),
        y=float(row["y"]),
        z=float(row["z"]),
        width=float(row["width"]),
        depth=float(row["depth"]),
        height=float(row["height"]),
        colour=(red, green, blue),
        shape=cast("Shape", row["shape"]),
        surface=cast("Surface", row["surface"]),
    )


#: COCO classes the house can hold.
OBJECTS: Final = _shapes("object")

#: Furnishings no detector of COCO classes names. They hide things and carry them.
FURNISHINGS: Final = _shapes("furnishing")
