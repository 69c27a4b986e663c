"""Furniture of each kind of room, as groups that are placed together: a desk with its chair.

Group coordinates in metres: x to the right, y to the front, the origin at the middle of the back.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from planner.simulation.house import FACINGS, QUARTER_TURNS, Facing, Item, turned


@dataclass(frozen=True, slots=True)
class GroupItem:
    """One item of a group, in the group's coordinates."""

    label: str
    x: float = 0.0  # [m] middle of its footprint
    y: float = 0.0
    z: float = 0.0
    turns: int = 0  # quarter turns to the left
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)

    def placed(self, at: tuple[float, float], facing: Facing) -> Item:
        """The item where the group's origin is `at` [m] and its front looks to `facing`."""
        x, y = turned(self.x, self.y, facing)
        item_facing = FACINGS[(QUARTER_TURNS[facing] + self.turns) % 4]
        return Item(self.label, at[0] + x, at[1] + y, self.z, item_facing, scale=self.scale)


Group = tuple[GroupItem, ...]
Where = Literal["wall", "centre", "outer wall"]


@dataclass(frozen=True, slots=True)
class GroupChoice:
    """A group that a room may have."""

    make: Callable[[np.random.Generator], Group]
    where: Where = "wall"
    probability: float = 1.0
    otherwise: Callable[[np.random.Generator], Group] | None = None  # where the group does not fit


def single(
    label: str, z: float = 0.0, scale: tuple[float, float, float] = (1.0, 1.0, 1.0)
) -> Group:
    """A group of one item, its back at the group's back."""
    lo = Item(label, 0, 0, 0, scale=scale).bounds()[0]
    return (GroupItem(label, 0, -float(lo[1]) + 0.02, z, scale=scale),)


def _one(label: str, z: float = 0.0) -> Callable[[np.random.Generator], Group]:
    return lambda rng: single(label, z)


def _desk(rng: np.random.Generator) -> Group:
    desk = GroupItem("desk", 0, 0.37)
    chair = GroupItem("chair", rng.uniform(-0.3, 0.3), rng.uniform(0.95, 1.10), turns=2)
    if rng.random() < 0.5:
        return (desk, chair, GroupItem("laptop", chair.x, 0.42, 0.74))
    screen = GroupItem("tv", chair.x, 0.18, 0.74, scale=(0.52, 1.0, 0.58))
    board = GroupItem("keyboard", chair.x, 0.50, 0.74)
    return (desk, chair, screen, board, GroupItem("mouse", chair.x + 0.34, 0.50, 0.74))


def _bed(rng: np.random.Generator) -> Group:
    bed = GroupItem("bed", 0, 1.06)
    sides = [side for side in (-1.10, 1.10) if rng.random() < 0.75]
    return (bed, *(GroupItem("cabinet", side, 0.25) for side in sides))


def _sofa(rng: np.random.Generator) -> Group:
    couch = GroupItem("couch", 0, 0.48)
    away = rng.uniform(1.65, 1.85)
    return (couch, GroupItem("rug", 0, away), GroupItem("coffee table", 0, away))


def _tv_board(rng: np.random.Generator) -> Group:
    return (GroupItem("low board", 0, 0.23), GroupItem("tv", rng.uniform(-0.1, 0.1), 0.24, 0.46))


def _dining_set(rng: np.random.Generator) -> Group:
    chairs = [(-0.45, -0.62, 0), (0.45, -0.62, 0), (-0.45, 0.62, 2), (0.45, 0.62, 2)]
    kept = [c for c in chairs if rng.random() < 0.9]
    if rng.random() < 0.3:
        kept += [(-1.0, 0.0, 3), (1.0, 0.0, 1)]
    shift = rng.uniform(-0.06, 0.06, (len(kept), 2))
    seats = [
        GroupItem("chair", x + a, y + b, turns=t)
        for (x, y, t), (a, b) in zip(kept, shift, strict=True)
    ]
    return (GroupItem("dining table"), *seats)


def _kitchen_table(rng: np.random.Generator) -> Group:
    table = GroupItem("dining table", 0, 0.42, scale=(0.6, 0.85, 1.0))
    sides = [(-0.72, 3), (0.72, 1)] if rng.random() < 0.7 else [(-0.72, 3)]
    return (table, *(GroupItem("chair", x, 0.42, turns=t) for x, t in sides))


def _kitchen_run(rng: np.random.Generator) -> Group:
    """Refrigerator, counters with sink and microwave, and oven, side by side."""
    order = ["counter", "oven", "counter"] if rng.random() < 0.5 else ["oven", "counter", "counter"]
    widths = {"counter": 1.0, "oven": 0.60, "refrigerator": 0.72}
    order = ["refrigerator", *order] if rng.random() < 0.5 else [*order, "refrigerator"]
    x, out = -sum(widths[label] for label in order) / 2, list[GroupItem]()
    on_top = [GroupItem("sink", 0, 0.32, 0.90), GroupItem("microwave", 0.2, 0.24, 0.90)]
    for label in order:
        middle = x + widths[label] / 2
        out.append(GroupItem(label, middle, 0.34))
        if label == "counter" and on_top:
            top = on_top.pop(0)
            out.append(GroupItem(top.label, middle + top.x, top.y, top.z))
        x += widths[label]
    return tuple(out)


def _short_kitchen_run(rng: np.random.Generator) -> Group:
    return (
        GroupItem("refrigerator", -1.14, 0.34),
        GroupItem("counter", -0.28, 0.34),
        GroupItem("sink", -0.28, 0.32, 0.90),
        GroupItem("oven", 0.52, 0.34),
    )


def _counters(rng: np.random.Generator) -> Group:
    toaster = GroupItem("toaster", -0.75, 0.20, 0.90)
    return (GroupItem("counter", -0.5, 0.33), GroupItem("counter", 0.5, 0.33), toaster)


def _washstand(rng: np.random.Generator) -> Group:
    return (GroupItem("vanity", 0, 0.25), GroupItem("sink", 0, 0.25, 0.84))


def _armchair(rng: np.random.Generator) -> Group:
    return single("chair", scale=(1.3, 1.3, 0.95))


_PLANT: Final = GroupChoice(_one("potted plant"), probability=0.5)
_WINDOW: Final = GroupChoice(_one("window", 0.95), "outer wall", 0.9)
_PICTURE: Final = GroupChoice(_one("picture", 1.35), "wall", 0.7)
_CLOCK: Final = GroupChoice(_one("clock", 1.60), "wall", 0.3)
_BIN: Final = GroupChoice(_one("waste bin"), probability=0.5)
_BOX: Final = GroupChoice(_one("cardboard box"), probability=0.35)
_BASKET: Final = GroupChoice(_one("basket"), probability=0.35)

#: Furniture of each category of room, the largest first.
GROUPS: Final[Mapping[str, Sequence[GroupChoice]]] = {
    "living room": (
        GroupChoice(_sofa),
        GroupChoice(_tv_board),
        GroupChoice(_one("bookcase"), probability=0.7),
        GroupChoice(_armchair, probability=0.6),
        GroupChoice(_one("sideboard"), probability=0.3),
        *(_PLANT, _PLANT, _BASKET, _WINDOW, _PICTURE, _CLOCK),
    ),
    "kitchen": (
        GroupChoice(_kitchen_run, otherwise=_short_kitchen_run),
        GroupChoice(_counters, probability=0.9),
        GroupChoice(_kitchen_table, probability=0.6),
        *(_BIN, _WINDOW, _CLOCK, _PLANT),
    ),
    "dining room": (
        GroupChoice(_dining_set, "centre", otherwise=_kitchen_table),
        GroupChoice(_one("sideboard"), probability=0.9),
        *(_PLANT, _PICTURE, _WINDOW, _CLOCK),
    ),
    "bedroom": (
        GroupChoice(_bed),
        GroupChoice(_one("wardrobe"), probability=0.9),
        GroupChoice(_one("chair"), probability=0.6),
        GroupChoice(_desk, probability=0.25),
        GroupChoice(_one("curtain"), probability=0.4),
        *(_PICTURE, _WINDOW, _PLANT, _BOX, _BASKET),
    ),
    "home office": (
        GroupChoice(_desk),
        GroupChoice(_one("bookcase"), probability=0.9),
        GroupChoice(_desk, probability=0.35),
        *(_BIN, _PLANT, _BOX, _PICTURE, _WINDOW),
    ),
    "shower": (
        GroupChoice(_one("toilet")),
        GroupChoice(_washstand),
        GroupChoice(_one("bathtub"), probability=0.7),
        *(_WINDOW, _BIN, _BASKET),
    ),
    "corridor": (
        GroupChoice(_one("bench"), probability=0.7),
        GroupChoice(_one("cabinet"), probability=0.5),
        *(_PLANT, _PICTURE, _CLOCK, _BOX),
    ),
}
