"""Colours of the plotted map, and which objects share one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from matplotlib.patheffects import Stroke

from kg.maps.semantic_map import SemanticMap
from kg.records import ObjectRecord, PlaceRecord

INK: Final = "#23272e"
FAINT: Final = "#7a828e"
WALL: Final = "#4a505a"
FURNITURE: Final = "#8a7f72"
OUTLINE: Final = "#c3c7ce"
TRUE_SPOT: Final = "#8b929c"
ROUTE: Final = "#c2255c"
FOUND: Final = "#ffd43b"

#: A light edge around small writing, so that it can be read on lines and colours.
HALO: Final = [Stroke(linewidth=2.2, foreground=(1, 1, 1, 0.75))]

#: The fewest objects of a class that earn it a colour of its own.
FREQUENT: Final = 3

_OTHER: Final = "#5c6470"
_STRONG: Final = [
    "#0b7285",
    "#d9480f",
    "#5f3dc4",
    "#2b8a3e",
    "#a61e4d",
    "#1864ab",
    "#946200",
    "#862e9c",
]
_PALE: Final = [
    "#fdeccf",
    "#dbeafd",
    "#e0f3dc",
    "#f6dfeb",
    "#e8e1fa",
    "#d8f1f0",
    "#fbe3d9",
    "#ecebe0",
    "#e3e9c9",
    "#dde1ea",
]


@dataclass(frozen=True, slots=True)
class Group:
    """Objects drawn in one colour."""

    name: str
    colour: str


def object_groups(semantic_map: SemanticMap, objects: Sequence[ObjectRecord]) -> dict[str, Group]:
    """Category IRI -> group: its supercategory, itself where it is frequent, or "other"."""
    catalogue = semantic_map.catalogue
    counts = Counter(record.category for record in objects)
    names: dict[str, str] = {}
    for above in (c for c in catalogue.categories if c.kind == "supercategory"):
        rows = semantic_map.ask("objects-by-category", category=above.iri).records()
        members = {row["object"] for row in rows}
        names |= {record.category: above.label for record in objects if record.iri in members}
    room = len(_STRONG) - len(set(names.values()))
    frequent = [c for c, n in counts.most_common() if c not in names and n >= FREQUENT]
    names |= {category: catalogue.label(category) for category in frequent[:room]}
    colours = dict(zip(sorted(set(names.values())), _STRONG, strict=False))
    other = Group("other", _OTHER)
    return {c: Group(names[c], colours[names[c]]) if c in names else other for c in counts}


def top_category(place: PlaceRecord) -> str | None:
    """IRI of the likeliest category of a place that has been viewed, else None."""
    if not place.views or not place.beliefs:
        return None
    return max(place.beliefs, key=lambda category: (place.beliefs[category], category))


def place_colours(places: Sequence[PlaceRecord]) -> dict[str, str]:
    """Category IRI -> pale colour, for the likeliest categories of `places`."""
    tops = sorted({top for place in places if (top := top_category(place)) is not None})
    return {category: _PALE[i % len(_PALE)] for i, category in enumerate(tops)}
