"""Colours of the plotted map, and the groups of objects that share one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from matplotlib.colors import to_hex, to_rgb
from matplotlib.patheffects import Stroke

from kg.maps.semantic_map import SemanticMap
from kg.model.records import ObjectRecord, PlaceRecord, likeliest

INK: Final = "#23272e"
FAINT: Final = "#68717d"
WALL: Final = "#4a505a"
FURNITURE: Final = "#8a7f72"
FLOOR: Final = "#eef0f3"  # seen floor outside of all places
OUTLINE: Final = "#c3c7ce"
TRUE_SPOT: Final = "#8b929c"
ROUTE: Final = "#b8124f"
FOUND: Final = "#ffd43b"

#: A light edge around small writing, so that it can be read on lines and colours.
HALO: Final = [Stroke(linewidth=2.2, foreground=(1, 1, 1, 0.8))]

#: minimum number of objects of a class with a colour of its own
FREQUENT: Final = 3

_OTHER: Final = "#5c6470"
#: Colours that stay apart for the colour-blind, after Okabe and Ito (2008), with two darker ones.
_STRONG: Final = [
    "#0072b2",
    "#d55e00",
    "#007d5c",
    "#cc79a7",
    "#e69f00",
    "#6f2d91",
    "#56b4e9",
    "#7f3b08",
]
_MARKERS: Final = ["o", "s", "^", "D", "v", "p", "P", "h"]
#: For categories of places: after Tol's muted scheme (2021).
_OF_PLACES: Final = [
    "#44aa99",
    "#332288",
    "#cc6677",
    "#88ccee",
    "#b8860b",
    "#aa4499",
    "#117733",
    "#6b7280",
    "#ddcc77",
    "#882255",
]
_PALENESS: Final = 0.84  # share of white in the colour of a place's floor


@dataclass(frozen=True, slots=True)
class Group:
    """Objects drawn in one colour."""

    name: str
    colour: str
    marker: str = "o"  # of matplotlib; tells groups apart without colours


def object_groups(semantic_map: SemanticMap, objects: Sequence[ObjectRecord]) -> dict[str, Group]:
    """Category IRI -> group: its supercategory, the category itself if frequent, or "other"."""
    catalogue = semantic_map.catalogue
    counts = Counter(record.category for record in objects)
    names: dict[str, str] = {}
    for above in (c for c in catalogue.categories if c.kind == "supercategory"):
        rows = semantic_map.query("objects-by-category", category=above.iri).records()
        members = {row["object"] for row in rows}
        names |= {record.category: above.label for record in objects if record.iri in members}
    room = len(_STRONG) - len(set(names.values()))
    frequent = [c for c, n in counts.most_common() if c not in names and n >= FREQUENT]
    names |= {category: catalogue.label(category) for category in frequent[:room]}
    styles = zip(sorted(set(names.values())), _STRONG, _MARKERS, strict=False)
    groups = {name: Group(name, colour, marker) for name, colour, marker in styles}
    return {c: groups[names[c]] if c in names else Group("other", _OTHER) for c in counts}


def top_category(place: PlaceRecord) -> str | None:
    """IRI of the likeliest category of a place that has been viewed, else None."""
    return likeliest(place.beliefs) if place.views else None


def place_groups(semantic_map: SemanticMap, places: Sequence[PlaceRecord]) -> dict[str, Group]:
    """Category IRI -> group, for the likeliest categories of `places`; "elsewhere" under ""."""
    label = semantic_map.catalogue.label
    tops = sorted({top for place in places if (top := top_category(place)) is not None})
    groups = {
        top: Group(label(top), _OF_PLACES[i % len(_OF_PLACES)], _MARKERS[i % len(_MARKERS)])
        for i, top in enumerate(tops)
    }
    return {"": Group("elsewhere", _OTHER), **groups}


def pale(colour: str) -> str:
    """The colour of a floor on which things of `colour` stand out."""
    red, green, blue = (_PALENESS + (1 - _PALENESS) * part for part in to_rgb(colour))
    return to_hex((red, green, blue))
