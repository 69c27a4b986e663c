"""Mapping of room names of data sets to place categories, and groups of similar categories.

The tables are ``rooms.csv`` and ``similar.csv`` beside this file (docs/explanation/placement.md). A
label or synonym of a place category needs no row.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from kg.knowledge.ontology.catalogue import Catalogue
from kg.model import vocabulary as v
from kg.model.resources import table_rows

_FOLDER: Final = Path(__file__).parent
#: names of rooms of unknown kind
_UNKNOWN: Final = frozenset({"", "other", "unknown", "none"})


@dataclass(frozen=True, slots=True)
class RoomType:
    """Room type: an existing place category, or a new one below a place category."""

    iri: str
    label: str
    below: str | None = None  # IRI of the superclass of a new category; None: it exists


def room_types(name: str, catalogue: Catalogue) -> tuple[RoomType, ...]:
    """Room types of a room name, in any case and with any surrounding space.

    A combined room ("kitchen/living room") and a tie between annotators ("tie: bedroom & office")
    have several types, a room of unknown kind has none. A name without an entry is a new category
    below here:Place.
    """
    name = " ".join(name.split())
    if name.casefold() in _UNKNOWN:
        return ()
    if (one := _one(name, catalogue)) is not None:
        return (one,)
    parts = [part for part in re.split(r"[/&]", name.removeprefix("tie:")) if part.strip()]
    if len(parts) > 1:
        return tuple(kind for part in parts for kind in room_types(part, catalogue))
    return (_new(name, v.PLACE),)


def _one(name: str, catalogue: Catalogue) -> RoomType | None:
    row = _named_rooms().get(name.casefold())
    if row is None or (row["category"] and catalogue.get(row["category"], "place") is None):
        found = catalogue.get(name, "place")
        return None if found is None else RoomType(found.iri, found.label)
    if row["category"]:
        category = catalogue.find(row["category"], "place")
        return RoomType(category.iri, category.label)
    above = catalogue.get(row["below"], "place")
    return _new(name, above.iri if above else v.PLACE)


def _new(name: str, below: str) -> RoomType:
    return RoomType(v.ROOM_TYPE + quote(name.casefold().replace(" ", "-"), safe="-"), name, below)


@cache
def _named_rooms() -> Mapping[str, Mapping[str, str]]:
    return {row["room"]: row for row in table_rows(_FOLDER / "rooms.csv")}


def similarity(
    places: Sequence[str],
    others: Sequence[RoomType],
    catalogue: Catalogue,
    above: Mapping[str, tuple[str, ...]],
) -> NDArray[np.float64]:
    """(m, k): 1 for a place and another room type in one group of ``similar.csv``, else 0.

    A place is also in the groups of its superclasses (`above`: IRI -> itself and all its
    superclasses), and similar to its superclasses and subclasses. Only categories count: wider
    kinds that are not below here:Place, such as here:IndoorPlace, do not make places alike.
    """
    groups = _groups(catalogue)

    def signature(iri: str, ups: Iterable[str]) -> set[str]:
        own = {iri, *(up for up in ups if v.PLACE in above.get(up, ()) and up != v.PLACE)}
        return own | {group for up in own for group in groups.get(up, ())}

    of_places = [signature(iri, above.get(iri, ())) for iri in places]
    of_others = [signature(one.iri, _superclasses(one, above)) for one in others]
    alike = [[float(bool(a & b)) for b in of_others] for a in of_places]
    return np.array(alike).reshape(len(places), len(others))


def _superclasses(room: RoomType, above: Mapping[str, tuple[str, ...]]) -> tuple[str, ...]:
    below = () if room.below is None else (room.below, *above.get(room.below, ()))
    return (*above.get(room.iri, ()), *below)


def _groups(catalogue: Catalogue) -> Mapping[str, set[str]]:
    groups = defaultdict(set)
    for row in table_rows(_FOLDER / "similar.csv"):
        if (category := catalogue.get(row["category"], "place")) is not None:
            groups[category.iri].add(f"group {row['group']}")
    return groups
