"""The demo's house with objects that were placed after mapping."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from hereabouts.cli.arguments import MAX_DISTANCE
from kg.model.errors import LayoutError, did_you_mean

if TYPE_CHECKING:
    from planner.simulation.houses.house import House, Item


def add_hide(parser: argparse.ArgumentParser, whose: str = "") -> None:
    """Declare `--hide`, which `house_with` reads."""
    parser.add_argument(
        "--hide",
        action="append",
        metavar="LABEL@X,Y,Z",
        help=f"{whose}an object that is placed in the house after mapping (default: apple, the "
        "demo's own, which needs no @X,Y,Z)",
    )


def house_with(hidden: Sequence[str] | None) -> House:
    """The demo's house with the objects of `--hide`; raises LayoutError."""
    from hereabouts.demo.house_demo import HIDDEN
    from planner.simulation.houses.house import furnished_house

    own = {HIDDEN.label: HIDDEN}
    items = [own.get(text) or _item(text) for text in hidden or own]
    return furnished_house().with_objects(items)


def _item(text: str) -> Item:
    from planner.simulation.houses.house import OBJECTS, Item

    label, _, where = text.partition("@")
    try:
        x, y, z = (float(part) for part in where.split(","))
    except ValueError:
        x = y = z = math.nan
    if not all(abs(value) <= MAX_DISTANCE for value in (x, y, z)):
        raise LayoutError(
            f"--hide needs LABEL@X,Y,Z in metres, e.g. {label or 'apple'}@7,8.3,0.85, got {text!r}"
        )
    if label not in OBJECTS:
        near = did_you_mean(label, list(OBJECTS)) or f"; it has {', '.join(sorted(OBJECTS))}"
        raise LayoutError(f"the simulated house has no {label!r}{near}")
    return Item(label, x, y, z)
