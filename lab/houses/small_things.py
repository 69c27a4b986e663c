"""Small things: their rooms, the furniture they stand on, and free spots on it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.simulation.house import FACINGS, OBJECTS, Facing, Item

TRIES: Final = 30  # random spots tried before a thing stays out
GAP: Final = 0.03  # [m] between things on one surface
ALIKE: Final = 0.45  # [m] between two things of one class that are no pair
PAIR: Final = (0.25, 0.40)  # [m] between the two of a pair

#: (z [m], half width, half depth [m] of the usable part, free height above [m]) by furniture
SURFACES: Final[Mapping[str, tuple[tuple[float, float, float, float], ...]]] = {
    "bed": ((0.55, 0.60, 0.70, 1.0),),
    "bench": ((0.45, 0.50, 0.14, 1.0),),
    "bookcase": tuple((z, 0.44, 0.11, 0.35) for z in (0.09, 0.49, 0.89, 1.29)),
    "cabinet": ((0.50, 0.22, 0.20, 1.0),),
    "chair": ((0.48, 0.18, 0.16, 1.0),),
    "coffee table": ((0.42, 0.44, 0.27, 1.0),),
    "couch": ((0.42, 0.75, 0.20, 1.0),),
    "counter": ((0.90, 0.48, 0.28, 1.0),),
    "desk": ((0.74, 0.80, 0.31, 1.0),),
    "dining table": ((0.75, 0.75, 0.41, 1.0),),
    "low board": ((0.46, 0.78, 0.19, 1.0),),
    "sideboard": ((0.85, 0.58, 0.19, 1.0),),
    "vanity": ((0.84, 0.62, 0.21, 1.0),),
}
FLOOR: Final = "floor"

#: Furniture that a small thing usually stands on. FLOOR: along a wall.
STANDS_ON: Final[Mapping[str, tuple[str, ...]]] = {
    "apple": ("counter", "dining table", "coffee table", "sideboard"),
    "backpack": (FLOOR,),
    "banana": ("counter", "dining table", "coffee table"),
    "book": ("bookcase", "desk", "low board", "cabinet", "coffee table", "bed"),
    "bottle": ("counter", "dining table", "sideboard", "vanity", "coffee table", "desk"),
    "bowl": ("counter", "dining table", "coffee table", "sideboard"),
    "cake": ("dining table", "counter"),
    "candle": ("dining table", "sideboard", "coffee table", "bookcase", "vanity"),
    "cell phone": ("cabinet", "desk", "coffee table", "sideboard", "counter"),
    "cup": ("counter", "dining table", "desk", "coffee table", "cabinet"),
    "hair drier": ("vanity", "cabinet"),
    "handbag": ("bench", "chair", "sideboard", "bed"),
    "jar": ("counter", "sideboard", "vanity", "bookcase"),
    "knife": ("counter", "dining table"),
    "lamp": ("cabinet", "desk", "sideboard", "low board"),
    "orange": ("counter", "dining table", "coffee table", "sideboard"),
    "remote": ("coffee table", "low board", "couch"),
    "scissors": ("desk", "counter", "cabinet"),
    "speaker": ("low board", "desk", "bookcase", "sideboard"),
    "sports ball": (FLOOR,),
    "suitcase": (FLOOR,),
    "teddy bear": ("bed", "couch", "chair"),
    "tissue box": ("cabinet", "desk", "vanity", "coffee table"),
    "toothbrush": ("vanity",),
    "umbrella": (FLOOR,),
    "vase": ("sideboard", "low board", "dining table", "cabinet", "coffee table"),
    "wine glass": ("dining table", "counter", "sideboard"),
}
#: Small things that people move and that a detector of COCO classes can name.
MOVABLE: Final = frozenset(STANDS_ON) & frozenset(OBJECTS)
#: Things that often stand in pairs.
IN_PAIRS: Final = frozenset({"apple", "book", "bottle", "bowl", "cup", "orange", "wine glass"})

#: Mean number of each small thing in a room of a category.
MEAN_COUNT: Final[Mapping[str, Mapping[str, float]]] = {
    "living room": {
        "book": 1.6,
        "remote": 0.8,
        "cup": 0.8,
        "vase": 0.6,
        "teddy bear": 0.4,
        "bottle": 0.4,
        "apple": 0.3,
        "cell phone": 0.3,
        "bowl": 0.3,
        "sports ball": 0.3,
        "candle": 0.6,
        "speaker": 0.6,
        "lamp": 0.5,
        "tissue box": 0.3,
    },
    "kitchen": {
        "bottle": 1.1,
        "cup": 1.1,
        "bowl": 0.9,
        "banana": 0.6,
        "apple": 0.6,
        "knife": 0.6,
        "orange": 0.5,
        "wine glass": 0.4,
        "cake": 0.3,
        "jar": 0.9,
    },
    "dining room": {
        "wine glass": 0.9,
        "vase": 0.9,
        "bowl": 0.7,
        "bottle": 0.6,
        "cup": 0.5,
        "cake": 0.3,
        "orange": 0.4,
        "candle": 0.8,
        "jar": 0.3,
    },
    "bedroom": {
        "book": 1.1,
        "cell phone": 0.6,
        "handbag": 0.5,
        "teddy bear": 0.5,
        "suitcase": 0.5,
        "backpack": 0.4,
        "cup": 0.4,
        "lamp": 0.9,
        "tissue box": 0.5,
    },
    "home office": {
        "book": 2.0,
        "cup": 0.8,
        "scissors": 0.6,
        "cell phone": 0.5,
        "backpack": 0.6,
        "bottle": 0.5,
        "speaker": 0.6,
        "lamp": 0.5,
        "tissue box": 0.3,
    },
    "shower": {"bottle": 0.9, "toothbrush": 0.9, "hair drier": 0.6, "candle": 0.3, "jar": 0.3},
    "corridor": {"umbrella": 0.6, "handbag": 0.4, "vase": 0.3, "sports ball": 0.3, "backpack": 0.3},
}


@dataclass(frozen=True, slots=True)
class SupportSurface:
    """A level rectangle that carries small things."""

    support: int  # index into SurfaceSampler.items
    label: str  # of the furniture
    lo: NDArray[np.float64]  # (2,) [m] map frame
    hi: NDArray[np.float64]  # (2,) [m]
    z: float  # [m]
    headroom: float  # [m] free height above


class SurfaceSampler:
    """Random free spots on the furniture of a house."""

    def __init__(self, items: Iterable[Item]) -> None:
        self.items = list(items)
        self._bounds = [item.bounds() for item in self.items]
        self.surfaces = [s for k in range(len(self.items)) for s in self._surfaces_of(k)]

    def place(
        self, thing: Item, surfaces: Sequence[SupportSurface], rng: np.random.Generator
    ) -> Item | None:
        """`thing` on a random free spot of one of `surfaces`; None where none was found."""
        fitting = [s for s in surfaces if s.headroom > thing.bounds()[1][2] - thing.z]
        for _ in range(TRIES if fitting else 0):
            surface = fitting[rng.integers(len(fitting))]
            placed = self._at_random(thing, surface, rng)
            if placed is not None and self._nearest_alike(placed) > ALIKE:
                self._add(placed)
                return placed
        return None

    def beside(self, thing: Item, other: Item, rng: np.random.Generator) -> Item | None:
        """`thing` beside `other` on its surface, at a distance in PAIR; None without free spot."""
        around = [s for s in self.surfaces if abs(s.z - other.z) < 1e-6 and _over(s, other)]
        for _ in range(TRIES if around else 0):
            angle, away = rng.uniform(0, 2 * np.pi), rng.uniform(*PAIR)
            x, y = other.x + away * np.cos(angle), other.y + away * np.sin(angle)
            placed = replace(thing, x=float(x), y=float(y), z=other.z)
            if self._is_free(placed, around[0]) and self._nearest_alike(placed) >= PAIR[0]:
                self._add(placed)
                return placed
        return None

    def _at_random(
        self, thing: Item, surface: SupportSurface, rng: np.random.Generator
    ) -> Item | None:
        x, y = rng.uniform(surface.lo, surface.hi)
        facing = self._facing(thing, surface, rng)
        placed = replace(thing, x=float(x), y=float(y), z=surface.z, facing=facing)
        return placed if self._is_free(placed, surface) else None

    def _facing(self, thing: Item, surface: SupportSurface, rng: np.random.Generator) -> Facing:
        """As the furniture in a bookcase, else at random."""
        if surface.label in ("bookcase", "cabinet", "low board") or thing.label == "clock":
            return self.items[surface.support].facing
        return FACINGS[rng.integers(4)]

    def _is_free(self, placed: Item, surface: SupportSurface) -> bool:
        lo, hi = placed.bounds()
        if np.any(lo[:2] < surface.lo) or np.any(hi[:2] > surface.hi):
            return False
        for k, (other_lo, other_hi) in enumerate(self._bounds):
            if k != surface.support and np.all(lo < other_hi + GAP) and np.all(hi > other_lo - GAP):
                return False
        return True

    def _nearest_alike(self, placed: Item) -> float:
        """[m] to the nearest other thing of the class; infinite without one."""
        away = [
            float(np.linalg.norm((item.x - placed.x, item.y - placed.y, item.z - placed.z)))
            for item in self.items
            if item.label == placed.label and (not item.name or item.name != placed.name)
        ]
        return min(away, default=np.inf)

    def _add(self, item: Item) -> None:
        self.items.append(item)
        self._bounds.append(item.bounds())

    def _surfaces_of(self, number: int) -> list[SupportSurface]:
        item = self.items[number]
        out = []
        for z, half_width, half_depth, headroom in SURFACES.get(item.label, ()):
            half = np.array([half_width * item.scale[0], half_depth * item.scale[1]])
            half = half if item.facing in ("north", "south") else half[::-1]
            centre, height = np.array([item.x, item.y]), item.z + z * item.scale[2]
            out.append(
                SupportSurface(number, item.label, centre - half, centre + half, height, headroom)
            )
        return out


def _over(surface: SupportSurface, item: Item) -> bool:
    return bool(np.all(surface.lo <= (item.x, item.y)) and np.all(surface.hi >= (item.x, item.y)))
