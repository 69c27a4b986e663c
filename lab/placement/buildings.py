"""Rooms of real buildings with what they hold, as data sets of homes and offices have them."""

from __future__ import annotations

import csv
import json
from collections import Counter, defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from kg.knowledge.ontology.catalogue import Catalogue
from kg.knowledge.placement.surveys import room_types
from kg.model.errors import InvalidFactError

#: S3DIS' names of rooms and objects where they differ from ours
_S3DIS_ROOMS: Final = {"office": "office (building)", "pantry": "kitchenette"}
_S3DIS_OBJECTS: Final = {"chair": "chair", "sofa": "couch", "table": "dining table"}


@dataclass(frozen=True, slots=True)
class TrialRoom:
    """One real room: what kinds of place it is (several for a room that is two), what it holds."""

    name: str  # as the data set calls it
    places: tuple[str, ...]  # IRIs; empty where the name says nothing
    objects: frozenset[str]  # IRIs of the kinds of object it holds


@dataclass(frozen=True, slots=True)
class TrialBuilding:
    """A home, or an area of an office building."""

    name: str
    rooms: tuple[TrialRoom, ...]


def load_homes(folder: Path, catalogue: Catalogue) -> tuple[TrialBuilding, ...]:
    """The homes of a folder of JSON files: ``{"scene", "rooms": [{"label", "coco": {name: n}}]}``.

    Raises InvalidFactError where there are none or one is not of this form.
    """
    files = sorted(folder.glob("*.json")) if folder.is_dir() else []
    if not files:
        raise InvalidFactError(f"no homes in {folder}: expected a folder of JSON files, one a home")
    return tuple(_home(path, catalogue) for path in files)


def _home(path: Path, catalogue: Catalogue) -> TrialBuilding:
    try:
        read: Any = json.loads(path.read_text(encoding="utf-8"))
        rooms = [(str(room["label"]), Counter(room["coco"])) for room in read["rooms"]]
        name = str(read["scene"])
        return TrialBuilding(name, tuple(_room(label, held, catalogue) for label, held in rooms))
    except (ValueError, KeyError, TypeError, OSError, RecursionError) as error:
        raise InvalidFactError(
            f"{path} is no home: it needs a scene and rooms, each with label and coco counts "
            f"({type(error).__name__}: {error})"
        ) from error


def load_s3dis(path: Path, catalogue: Catalogue) -> tuple[TrialBuilding, ...]:
    """The areas of S3DIS from a table ``area,room_type,room_number,object,instances``.

    Raises InvalidFactError where the file is not of this form.
    """
    areas: dict[str, dict[tuple[str, str], Counter[str]]] = defaultdict(
        lambda: defaultdict(Counter)
    )
    try:
        with path.open(newline="", encoding="utf-8") as file:
            for row in csv.DictReader(file):
                room = areas[row["area"]][row["room_type"], row["room_number"]]
                if row["object"] in _S3DIS_OBJECTS:
                    room[_S3DIS_OBJECTS[row["object"]]] += int(row["instances"])
    except (OSError, ValueError, KeyError, TypeError, csv.Error) as error:
        raise InvalidFactError(
            f"{path} is no table of S3DIS: it needs the columns area, room_type, room_number, "
            f"object and instances ({type(error).__name__}: {error})"
        ) from error
    return tuple(
        TrialBuilding(
            f"area {area}",
            tuple(
                _room(_S3DIS_ROOMS.get(kind, kind), held, catalogue)
                for (kind, _), held in rooms.items()
            ),
        )
        for area, rooms in sorted(areas.items())
    )


def _room(name: str, held: Counter[str], catalogue: Catalogue) -> TrialRoom:
    places = tuple(kind.iri for kind in room_types(name, catalogue))
    found = (catalogue.get(label, "object") for label, number in held.items() if number > 0)
    return TrialRoom(name, places, frozenset(category.iri for category in found if category))
