"""Rooms as data sets name them, and the place categories they are; which categories are alike.

``rooms.csv`` and ``similar.csv`` beside this file are the tables (docs/placement.md). A room name
that is the label or a synonym of a place category needs no row.
"""

from __future__ import annotations

import csv
import re
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final
from urllib.parse import quote

import numpy as np

from kg import vocabulary as v
from kg.categories import Catalogue
from kg.placement.model import Matrix

_FOLDER: Final = Path(__file__).parent
#: names that say that nobody knew what the room is
_NOTHING: Final = frozenset({"", "other", "unknown", "none"})


@dataclass(frozen=True, slots=True)
class RoomType:
    """A kind of room: the place category it is, or a new one below a place category."""

    iri: str
    label: str
    below: str | None = None  # IRI of the category a new one stands below; None: it exists


def room_types(name: str, catalogue: Catalogue) -> tuple[RoomType, ...]:
    """What a room of that name is; several for a room that is two ("kitchen/living room").

    Case and the space around do not matter. A tie between annotators ("tie: bedroom & office")
    counts as several. Empty where the name says nothing; a name nobody knows is a new category
    below here:Place.
    """
    name = " ".join(name.split())
    if name.casefold() in _NOTHING:
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
    with (_FOLDER / "rooms.csv").open(newline="", encoding="utf-8") as file:
        return {row["room"]: row for row in csv.DictReader(file)}


def buildings(
    iris: Iterable[str], catalogue: Catalogue, above: Mapping[str, tuple[str, ...]]
) -> dict[str, str]:
    """Which kind of building places speak for ("home", "offices"), as ``buildings.csv`` has it.

    By IRI; places that stand in either are left out. A place speaks as the nearest class above does
    that is listed.
    """
    listed: dict[str, str] = {}
    with (_FOLDER / "buildings.csv").open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            if (category := catalogue.get(row["category"], "place")) is not None:
                listed[category.iri] = row["building"]
    found = {}
    for iri in iris:
        ups = sorted((-len(above.get(up, ())), up) for up in above.get(iri, (iri,)) if up in listed)
        if ups:
            found[iri] = listed[ups[0][1]]
    return found


def similar_places(
    iris: tuple[str, ...], catalogue: Catalogue, above: Mapping[str, tuple[str, ...]]
) -> Matrix:
    """(m, m): 1 where two different places are in one group of ``similar.csv``, else 0.

    A place is in the groups of its superclasses too (`above`: IRI -> it and all its superclasses).
    """
    groups = defaultdict(set)
    with (_FOLDER / "similar.csv").open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            if (category := catalogue.get(row["category"], "place")) is not None:
                groups[category.iri].add(row["group"])
    of = [{g for up in above.get(iri, (iri,)) for g in groups.get(up, ())} for iri in iris]
    # a place and what is below it are alike even where no group names them
    ups = [set(above.get(iri, (iri,))) - {v.PLACE, v.BOT_SPACE} for iri in iris]
    alike = [
        [bool(a & b or c & d) for b, d in zip(of, ups, strict=True)]
        for a, c in zip(of, ups, strict=True)
    ]
    return np.asarray(alike, dtype=np.float64).reshape(len(iris), len(iris)) * (
        1 - np.eye(len(iris))
    )
