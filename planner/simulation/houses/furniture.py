"""Shapes of things: each class as a few boxes, cylinders and ellipsoids.

Local coordinates are in metres: x to the right, y to the front, z up; the origin is in the middle
of the underside. Sizes are those of ordinary household things.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

Shape = Literal["box", "cylinder", "ellipsoid"]
Surface = Literal["opaque", "screen", "glass"]
Facing = Literal["north", "west", "south", "east"]
RGB = tuple[float, float, float]

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


WOOD: Final = (0.62, 0.44, 0.27)
DARK_WOOD: Final = (0.40, 0.27, 0.18)
PALE_WOOD: Final = (0.80, 0.66, 0.47)
WHITE: Final = (0.93, 0.93, 0.91)
CREAM: Final = (0.90, 0.86, 0.76)
STEEL: Final = (0.66, 0.69, 0.72)
BLACK: Final = (0.10, 0.10, 0.12)
GREY: Final = (0.45, 0.46, 0.48)
LEAF: Final = (0.25, 0.52, 0.25)
TERRACOTTA: Final = (0.74, 0.40, 0.27)
TEAL: Final = (0.20, 0.47, 0.50)
NAVY: Final = (0.20, 0.28, 0.45)
RED: Final = (0.76, 0.20, 0.18)
YELLOW: Final = (0.95, 0.80, 0.22)
GREEN: Final = (0.20, 0.50, 0.30)
TAN: Final = (0.70, 0.50, 0.32)


def _legs(
    width: float, depth: float, height: float, thick: float, colour: RGB
) -> tuple[SolidPart, ...]:
    x, y = (width - thick) / 2, (depth - thick) / 2
    corners = ((-x, -y), (x, -y), (-x, y), (x, y))
    return tuple(SolidPart(u, v, 0, thick, thick, height, colour) for u, v in corners)


def _table(width: float, depth: float, height: float, colour: RGB) -> tuple[SolidPart, ...]:
    top = SolidPart(0, 0, height - 0.04, width, depth, 0.04, colour)
    return (top, *_legs(width - 0.1, depth - 0.1, height - 0.04, 0.06, colour))


def _books(*colours: RGB) -> tuple[SolidPart, ...]:
    step = 0.045
    return tuple(
        SolidPart(
            (i - len(colours) / 2) * step, 0, 0, step - 0.006, 0.16, 0.22 + 0.03 * (i % 2), colour
        )
        for i, colour in enumerate(colours)
    )


#: COCO classes the house can hold.
OBJECTS: Final[Mapping[str, tuple[SolidPart, ...]]] = {
    "apple": (SolidPart(0, 0, 0, 0.085, 0.085, 0.08, RED, "ellipsoid"),),
    "backpack": (
        SolidPart(0, 0, 0, 0.34, 0.20, 0.46, NAVY),
        SolidPart(0, 0.13, 0.05, 0.26, 0.08, 0.22, (0.28, 0.38, 0.60)),
    ),
    "banana": (
        SolidPart(-0.07, 0, 0, 0.12, 0.05, 0.045, YELLOW, "ellipsoid"),
        SolidPart(0.0, 0.02, 0.01, 0.13, 0.05, 0.05, YELLOW, "ellipsoid"),
        SolidPart(0.07, 0, 0, 0.12, 0.05, 0.045, YELLOW, "ellipsoid"),
    ),
    "bed": (
        SolidPart(0, 0, 0.06, 1.60, 2.00, 0.26, WOOD),
        SolidPart(0, 0, 0.32, 1.56, 1.94, 0.20, WHITE),
        SolidPart(0, 0.33, 0.36, 1.62, 1.36, 0.19, TEAL),
        SolidPart(-0.40, -0.75, 0.50, 0.62, 0.38, 0.14, CREAM, "ellipsoid"),
        SolidPart(0.40, -0.75, 0.50, 0.62, 0.38, 0.14, CREAM, "ellipsoid"),
        SolidPart(0, -1.01, 0.06, 1.64, 0.06, 0.90, DARK_WOOD),
    ),
    "bench": (
        SolidPart(0, 0, 0.40, 1.10, 0.34, 0.05, PALE_WOOD),
        *_legs(1.04, 0.30, 0.40, 0.05, PALE_WOOD),
    ),
    "book": _books(RED, NAVY, CREAM, GREEN, TERRACOTTA),
    "bottle": (
        SolidPart(0, 0, 0, 0.085, 0.085, 0.21, GREEN, "cylinder"),
        SolidPart(0, 0, 0.21, 0.035, 0.035, 0.09, GREEN, "cylinder"),
    ),
    "bowl": (SolidPart(0, 0, 0, 0.24, 0.24, 0.09, (0.35, 0.55, 0.72), "cylinder"),),
    "cake": (
        SolidPart(0, 0, 0, 0.30, 0.30, 0.02, WHITE, "cylinder"),
        SolidPart(0, 0, 0.02, 0.24, 0.24, 0.09, (0.47, 0.28, 0.18), "cylinder"),
        SolidPart(0, 0, 0.11, 0.24, 0.24, 0.02, (0.95, 0.80, 0.82), "cylinder"),
    ),
    "cell phone": (SolidPart(0, 0, 0, 0.09, 0.16, 0.015, BLACK),),
    "chair": (
        SolidPart(0, 0, 0.43, 0.44, 0.44, 0.05, PALE_WOOD),
        SolidPart(0, -0.20, 0.48, 0.44, 0.04, 0.42, PALE_WOOD),
        *_legs(0.44, 0.44, 0.43, 0.045, WOOD),
    ),
    "clock": (
        SolidPart(0, 0, 0, 0.32, 0.05, 0.32, BLACK),
        SolidPart(0, 0.01, 0.03, 0.26, 0.05, 0.26, WHITE),
        SolidPart(0, 0.02, 0.15, 0.02, 0.05, 0.10, BLACK),
        SolidPart(0.04, 0.02, 0.15, 0.08, 0.05, 0.02, BLACK),
    ),
    "couch": (
        SolidPart(0, 0, 0.08, 2.00, 0.90, 0.34, TEAL),
        SolidPart(0, -0.34, 0.42, 2.00, 0.22, 0.42, TEAL),
        SolidPart(-0.91, 0, 0.08, 0.18, 0.92, 0.54, (0.17, 0.42, 0.45)),
        SolidPart(0.91, 0, 0.08, 0.18, 0.92, 0.54, (0.17, 0.42, 0.45)),
        SolidPart(-0.55, -0.14, 0.42, 0.42, 0.16, 0.36, YELLOW, "ellipsoid"),
    ),
    "cup": (SolidPart(0, 0, 0, 0.095, 0.095, 0.11, (0.88, 0.42, 0.24), "cylinder"),),
    "dining table": _table(1.60, 0.90, 0.75, WOOD),
    "hair drier": (
        SolidPart(0, 0, 0.10, 0.22, 0.09, 0.09, (0.70, 0.25, 0.45)),
        SolidPart(-0.05, 0, 0, 0.05, 0.05, 0.11, BLACK),
    ),
    "handbag": (
        SolidPart(0, 0, 0, 0.36, 0.14, 0.26, TAN),
        SolidPart(0, 0, 0.26, 0.20, 0.03, 0.10, DARK_WOOD),
    ),
    "keyboard": (
        SolidPart(0, 0, 0, 0.44, 0.15, 0.025, GREY),
        SolidPart(0, 0, 0.025, 0.42, 0.13, 0.008, WHITE),
    ),
    "knife": (
        SolidPart(-0.09, 0, 0, 0.12, 0.03, 0.03, BLACK),
        SolidPart(0.07, 0, 0, 0.20, 0.04, 0.02, STEEL),
    ),
    "laptop": (
        SolidPart(0, 0, 0, 0.36, 0.25, 0.02, STEEL),
        SolidPart(0, -0.125, 0.02, 0.36, 0.02, 0.23, BLACK),
        SolidPart(0, -0.112, 0.035, 0.33, 0.01, 0.20, (0.45, 0.65, 0.88), surface="screen"),
    ),
    "microwave": (
        SolidPart(0, 0, 0, 0.50, 0.36, 0.29, STEEL),
        SolidPart(-0.07, 0.01, 0.03, 0.32, 0.36, 0.23, BLACK),
    ),
    "mouse": (SolidPart(0, 0, 0, 0.075, 0.12, 0.045, BLACK, "ellipsoid"),),
    "oven": (
        SolidPart(0, 0, 0, 0.60, 0.60, 0.90, STEEL),
        SolidPart(0, 0.02, 0.20, 0.50, 0.60, 0.42, BLACK),
        SolidPart(0, 0.06, 0.66, 0.46, 0.60, 0.03, WHITE),
        SolidPart(0, 0, 0.90, 0.56, 0.56, 0.015, BLACK),
    ),
    "orange": (SolidPart(0, 0, 0, 0.085, 0.085, 0.085, (0.95, 0.55, 0.12), "ellipsoid"),),
    "potted plant": (
        SolidPart(0, 0, 0, 0.34, 0.34, 0.32, TERRACOTTA, "cylinder"),
        SolidPart(0, 0, 0.30, 0.10, 0.10, 0.25, DARK_WOOD, "cylinder"),
        SolidPart(-0.08, 0.05, 0.45, 0.46, 0.44, 0.44, LEAF, "ellipsoid"),
        SolidPart(0.12, -0.06, 0.66, 0.36, 0.38, 0.38, (0.33, 0.60, 0.28), "ellipsoid"),
    ),
    "refrigerator": (
        SolidPart(0, 0, 0, 0.70, 0.66, 1.80, WHITE),
        SolidPart(0, 0.005, 1.18, 0.70, 0.66, 0.02, GREY),
        SolidPart(0.28, 0.03, 0.70, 0.03, 0.66, 0.40, STEEL),
        SolidPart(0.28, 0.03, 1.28, 0.03, 0.66, 0.30, STEEL),
    ),
    "remote": (SolidPart(0, 0, 0, 0.06, 0.20, 0.03, BLACK),),
    "scissors": (
        SolidPart(0, 0.05, 0, 0.03, 0.14, 0.015, STEEL),
        SolidPart(0, -0.06, 0, 0.10, 0.08, 0.02, RED),
    ),
    "sink": (
        SolidPart(0, 0, 0, 0.52, 0.42, 0.03, STEEL),
        SolidPart(0, 0.01, 0.03, 0.42, 0.30, 0.006, (0.40, 0.43, 0.46)),
        SolidPart(0, -0.16, 0.03, 0.03, 0.03, 0.24, WHITE),
        SolidPart(0, -0.09, 0.25, 0.03, 0.16, 0.03, WHITE),
    ),
    "sports ball": (SolidPart(0, 0, 0, 0.23, 0.23, 0.23, (0.85, 0.40, 0.18), "ellipsoid"),),
    "suitcase": (
        SolidPart(0, 0, 0.04, 0.42, 0.26, 0.62, (0.72, 0.22, 0.20)),
        SolidPart(0, -0.08, 0.66, 0.20, 0.03, 0.16, BLACK),
    ),
    "teddy bear": (
        SolidPart(0, 0, 0, 0.26, 0.22, 0.26, TAN, "ellipsoid"),
        SolidPart(0, 0.01, 0.22, 0.20, 0.19, 0.19, TAN, "ellipsoid"),
        SolidPart(-0.08, 0, 0.36, 0.07, 0.05, 0.07, DARK_WOOD, "ellipsoid"),
        SolidPart(0.08, 0, 0.36, 0.07, 0.05, 0.07, DARK_WOOD, "ellipsoid"),
    ),
    "toaster": (
        SolidPart(0, 0, 0, 0.30, 0.18, 0.20, RED),
        SolidPart(0, 0, 0.20, 0.22, 0.05, 0.005, BLACK),
    ),
    "toilet": (
        SolidPart(0, 0.12, 0, 0.36, 0.50, 0.40, WHITE, "cylinder"),
        SolidPart(0, 0.12, 0.40, 0.40, 0.54, 0.04, CREAM, "cylinder"),
        SolidPart(0, -0.23, 0.30, 0.42, 0.18, 0.50, WHITE),
    ),
    "toothbrush": (
        SolidPart(0, 0, 0, 0.075, 0.075, 0.10, (0.55, 0.78, 0.85), "cylinder"),
        SolidPart(0.01, 0, 0.10, 0.02, 0.02, 0.12, RED),
        SolidPart(-0.02, 0.01, 0.10, 0.02, 0.02, 0.10, NAVY),
    ),
    "tv": (
        SolidPart(0, -0.02, 0.06, 1.10, 0.05, 0.64, BLACK),
        SolidPart(0, 0.005, 0.09, 1.04, 0.01, 0.58, (0.16, 0.22, 0.30), surface="screen"),
        SolidPart(0, 0, 0, 0.40, 0.20, 0.03, BLACK),
        SolidPart(0, -0.02, 0.03, 0.06, 0.04, 0.06, BLACK),
    ),
    "umbrella": (
        SolidPart(0, 0, 0, 0.22, 0.22, 0.45, GREY, "cylinder"),
        SolidPart(0, 0, 0.45, 0.11, 0.11, 0.38, (0.45, 0.20, 0.50), "cylinder"),
    ),
    "vase": (
        SolidPart(0, 0, 0, 0.15, 0.15, 0.24, (0.30, 0.42, 0.72), "ellipsoid"),
        SolidPart(0, 0, 0.20, 0.08, 0.08, 0.08, (0.30, 0.42, 0.72), "cylinder"),
        SolidPart(0, 0, 0.28, 0.20, 0.20, 0.16, (0.90, 0.52, 0.62), "ellipsoid"),
    ),
    "wine glass": (
        SolidPart(0, 0, 0, 0.07, 0.07, 0.01, (0.80, 0.85, 0.90), "cylinder"),
        SolidPart(0, 0, 0.01, 0.015, 0.015, 0.09, (0.80, 0.85, 0.90), "cylinder"),
        SolidPart(0, 0, 0.09, 0.08, 0.08, 0.12, (0.62, 0.16, 0.26), "ellipsoid", "glass"),
    ),
}

#: Furnishings no detector of COCO classes names. They hide things and carry them.
FURNISHINGS: Final[Mapping[str, tuple[SolidPart, ...]]] = {
    "bathtub": (
        SolidPart(0, 0, 0, 1.70, 0.75, 0.52, WHITE),
        SolidPart(0, 0, 0.52, 1.50, 0.55, 0.005, (0.72, 0.84, 0.90)),
    ),
    "basket": (
        SolidPart(0, 0, 0, 0.36, 0.36, 0.30, TAN, "cylinder"),
        SolidPart(0, 0, 0.30, 0.32, 0.32, 0.04, CREAM, "ellipsoid"),
    ),
    "bookcase": (
        SolidPart(0, -0.14, 0, 1.00, 0.02, 1.70, PALE_WOOD),
        *(SolidPart(0, 0, z, 1.00, 0.30, 0.03, PALE_WOOD) for z in (0.06, 0.46, 0.86, 1.26, 1.67)),
        SolidPart(-0.49, 0, 0, 0.03, 0.30, 1.70, PALE_WOOD),
        SolidPart(0.49, 0, 0, 0.03, 0.30, 1.70, PALE_WOOD),
    ),
    "cardboard box": (
        SolidPart(0, 0, 0, 0.42, 0.32, 0.28, (0.72, 0.56, 0.38)),
        SolidPart(0, 0, 0.28, 0.06, 0.32, 0.004, CREAM),
    ),
    "coffee table": _table(0.95, 0.60, 0.42, PALE_WOOD),
    "cabinet": (
        SolidPart(0, 0, 0, 0.50, 0.46, 0.50, DARK_WOOD),
        SolidPart(0, 0.01, 0.27, 0.44, 0.46, 0.18, WOOD),
        SolidPart(0, 0.01, 0.05, 0.44, 0.46, 0.18, WOOD),
    ),
    "counter": (
        SolidPart(0, 0, 0, 1.00, 0.60, 0.86, CREAM),
        SolidPart(0, 0, 0.86, 1.00, 0.63, 0.04, GREY),
        SolidPart(0, 0.28, 0.66, 0.30, 0.07, 0.02, STEEL),
    ),
    "candle": (SolidPart(0, 0, 0, 0.07, 0.07, 0.16, CREAM, "cylinder"),),
    "curtain": (SolidPart(0, 0, 0, 0.24, 0.08, 1.70, (0.86, 0.72, 0.55)),),
    "desk": _table(1.70, 0.70, 0.74, PALE_WOOD),
    "jar": (
        SolidPart(0, 0, 0, 0.11, 0.11, 0.15, (0.80, 0.72, 0.62), "cylinder"),
        SolidPart(0, 0, 0.15, 0.09, 0.09, 0.03, DARK_WOOD, "cylinder"),
    ),
    "lamp": (
        SolidPart(0, 0, 0, 0.12, 0.12, 0.02, BLACK, "cylinder"),
        SolidPart(0, 0, 0.02, 0.03, 0.03, 0.24, BLACK, "cylinder"),
        SolidPart(0, 0, 0.24, 0.24, 0.24, 0.20, (1.0, 0.93, 0.75), "cylinder"),
    ),
    "low board": (
        SolidPart(0, 0, 0, 1.60, 0.42, 0.46, DARK_WOOD),
        SolidPart(-0.40, 0.01, 0.06, 0.74, 0.42, 0.34, WOOD),
        SolidPart(0.40, 0.01, 0.06, 0.74, 0.42, 0.34, WOOD),
    ),
    "picture": (
        SolidPart(0, 0, 0, 0.80, 0.04, 0.55, DARK_WOOD),
        SolidPart(0, 0.01, 0.05, 0.70, 0.04, 0.45, (0.62, 0.74, 0.78)),
        SolidPart(0, 0.012, 0.05, 0.70, 0.04, 0.16, (0.42, 0.58, 0.40)),
    ),
    "rug": (
        SolidPart(0, 0, 0, 2.20, 1.60, 0.012, (0.74, 0.52, 0.42)),
        SolidPart(0, 0, 0.001, 1.90, 1.30, 0.013, (0.88, 0.78, 0.64)),
    ),
    "sideboard": (
        SolidPart(0, 0, 0.10, 1.20, 0.42, 0.72, WOOD),
        SolidPart(0, 0, 0.82, 1.24, 0.44, 0.03, DARK_WOOD),
    ),
    "speaker": (
        SolidPart(0, 0, 0, 0.18, 0.20, 0.30, BLACK),
        SolidPart(0, 0.10, 0.04, 0.12, 0.01, 0.12, GREY),
    ),
    "tissue box": (SolidPart(0, 0, 0, 0.23, 0.12, 0.09, (0.62, 0.72, 0.80)),),
    "vanity": (
        SolidPart(0, 0, 0.20, 1.30, 0.46, 0.60, WHITE),
        SolidPart(0, 0, 0.80, 1.30, 0.48, 0.04, PALE_WOOD),
    ),
    "waste bin": (
        SolidPart(0, 0, 0, 0.26, 0.26, 0.32, GREY, "cylinder"),
        SolidPart(0, 0, 0.32, 0.22, 0.22, 0.005, BLACK, "cylinder"),
    ),
    "wardrobe": (
        SolidPart(0, 0, 0, 1.50, 0.58, 2.10, WOOD),
        SolidPart(0, 0.01, 0.06, 0.02, 0.58, 1.98, DARK_WOOD),
    ),
    "window": (
        SolidPart(0, 0, 0, 1.40, 0.10, 1.15, WHITE),
        SolidPart(-0.33, 0.01, 0.06, 0.62, 0.10, 1.03, (0.76, 0.88, 0.98)),
        SolidPart(0.33, 0.01, 0.06, 0.62, 0.10, 1.03, (0.76, 0.88, 0.98)),
    ),
}
