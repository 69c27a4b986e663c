"""Real homes as data sets have them: rooms with boxes, labels and what they hold, and doors.

A home is a JSON file ``{"scene", "rooms": [{"id", "label", "centroid", "dims", "coco"}],
"connections": [[id, id]]}``; y points up, the plan is x, z, and all lengths are metres.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from kg.model.areas import Area
from kg.model.errors import InvalidFactError


@dataclass(frozen=True, slots=True)
class RoomFloor(Area):
    """The floor of a room on one storey."""

    height: float = 0.0  # [m]


@dataclass(frozen=True, slots=True)
class HomeRoom:
    """One room of a home."""

    label: str  # as the data set calls it
    floor: RoomFloor
    holds: Mapping[str, int]  # kind of object -> how many, each at least 1


@dataclass(frozen=True, slots=True)
class Home:
    """Rooms, and which have a door between them."""

    name: str
    rooms: tuple[HomeRoom, ...]
    doors: tuple[tuple[int, int], ...] | None  # pairs of numbers of rooms; None: not known

    @property
    def objects(self) -> tuple[str, ...]:
        """The kinds of object it holds, sorted."""
        return tuple(sorted({kind for room in self.rooms for kind in room.holds}))


def read_homes(folder: Path) -> tuple[Home, ...]:
    """The homes of a folder, one JSON file each, by name of file.

    Raises InvalidFactError where there are none, or one is not of the form above.
    """
    files = sorted(folder.glob("*.json")) if folder.is_dir() else []
    if not files:
        raise InvalidFactError(f"no homes in {folder}: expected a folder of JSON files, one a home")
    return tuple(read_home(path) for path in files)


def read_home(path: Path) -> Home:
    """One home; raises InvalidFactError where the file is not of the form above."""
    try:
        read: Any = json.loads(path.read_text(encoding="utf-8"))
        numbers = {room["id"]: number for number, room in enumerate(read["rooms"])}
        rooms = tuple(_room(room) for room in read["rooms"])
        doors = tuple((numbers[a], numbers[b]) for a, b in read.get("connections", ()))
        name = str(read["scene"])
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise InvalidFactError(
            f"{path} is no home: it needs a scene, rooms with id, label, centroid, dims and coco "
            f"counts, and connections between them ({type(error).__name__}: {error})"
        ) from error
    if not rooms:
        raise InvalidFactError(f"{path} is no home: it has no rooms")
    return Home(name, rooms, doors)


def _room(read: Any) -> HomeRoom:
    x, y, z = (float(number) for number in read["centroid"])
    dx, dy, dz = (float(number) for number in read["dims"])
    if not all(map(math.isfinite, (x, y, z, dx, dy, dz))) or not (min(dx, dz) > 0 and dy >= 0):
        raise ValueError(f"a room of {dx:g} x {dy:g} x {dz:g} m at {x:g}, {y:g}, {z:g}")
    floor = RoomFloor(x - dx / 2, x + dx / 2, z - dz / 2, z + dz / 2, round(y - dy / 2, 1))
    holds = {str(kind): int(count) for kind, count in read["coco"].items() if int(count) > 0}
    return HomeRoom(str(read["label"]), floor, holds)
