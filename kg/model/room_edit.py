"""Edits of the rooms of a map, as people and programs order them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

from kg.model.errors import InvalidFactError

Point = tuple[float, float]  # (x, y) [m] of the map

RoomEditKind = Literal["split", "merge", "wall", "draw", "door", "here", "undo"]

#: Kinds of edits, with the number of places and the least number of points that each needs.
NEEDS: Final[Mapping[str, tuple[int, int]]] = {
    "split": (1, 2),
    "merge": (2, 0),
    "wall": (2, 2),
    "draw": (0, 3),
    "door": (2, 1),
    "here": (0, 0),
    "undo": (0, 0),
}


@dataclass(frozen=True, slots=True)
class RoomEdit:
    """An edit of the rooms of a map.

    - split: divide a place along the line `points`; the smaller part is a new place called `name`
    - merge: two places become the first one
    - wall: divide the area of two places anew along the line `points`
    - draw: a new place called `name` with the corners `points`
    - door: a door at the point between two places
    - here: the place in which the robot stands is called `name`
    - undo: the last edit of the same author that was not undone
    """

    kind: RoomEditKind
    places: tuple[str, ...] = ()  # IRIs, or short: place/2
    points: tuple[Point, ...] = ()  # (x, y) [m] of the map
    name: str = ""

    def __post_init__(self) -> None:
        if self.kind not in NEEDS:
            raise InvalidFactError(
                f"no edit {str(self.kind)[:40]!r} of rooms; there are {', '.join(NEEDS)}"
            )
        places, points = NEEDS[self.kind]
        if len(set(self.places)) != places or len(self.places) != places:
            raise InvalidFactError(f"{self.kind} needs {places} different places")
        if len(self.points) < points:
            raise InvalidFactError(f"{self.kind} needs {points} points or more, got {self.points}")
        from kg.model.areas import MAX_CORNERS  # which loads numpy: not for the help of a command

        if len(self.points) > MAX_CORNERS:
            raise InvalidFactError(f"an edit has at most {MAX_CORNERS} points")
        if self.kind == "here" and not self.name.strip():
            raise InvalidFactError("here needs the name of the room, as in 'room 315'")
