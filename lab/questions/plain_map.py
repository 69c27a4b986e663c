"""A map as plain JSON of rooms and objects, of any system, and a program that answers from it.

The schema is that of `hereabouts export --format json`; what a system does not have is left out:

    {"rooms": [{"label": "kitchen", "outline": [[[0, 0], [4, 0], [4, 3], [0, 3]]],
                "viewed_share": 0.95,
                "objects": [{"name": "object/1", "category": "cup", "position": [1.0, 2.0, 0.8],
                             "existence": 0.9, "last_seen": 1772442000.0,
                             "size": [0.1, 0.1, 0.1],
                             "seen_in": {"recording": "session-1", "frame": "frame-000017"},
                             "relations": [{"kind": "on", "target": "object/2"}]}]}],
     "elsewhere": [], "departed": [{"category": "cup", "last_seen": 1772442000.0}]}

Lengths in metres, times in seconds since 1970. `viewed_share` is the share of the room that was
viewed (1 where it is missing), `elsewhere` has the objects of no room, `departed` what left. A
second such file, of the moment before the things moved, answers what moved: by the same `name`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from kg.model.errors import GraphError

PRESENT: Final = 0.5  # existence from which on a thing counts as there
MOVED: Final = 0.3  # [m]
STRIP: Final = 1.0  # [m] width of the strip that is between two things
NEVER, WHOLE = 0.05, 0.9  # shares of a room: never looked below, all of it from here on

NOT_KNOWN: Final = "not known"

Thing = Mapping[str, Any]


class ByLists(ABC):
    """Counts by the things of a category that an interface lists."""

    @abstractmethod
    def _of(self, category: str, room: str | None = None) -> Sequence[Mapping[str, Any]]:
        """The things of a category, in a room or anywhere."""

    def count(self, category: str) -> int:
        return len(self._of(category))

    def count_in_place(self, category: str, room: str) -> int:
        return len(self._of(category, room))

    def presence(self, category: str, room: str) -> bool:
        return bool(self._of(category, room))


class PlainMap(ByLists):
    """Answers each family from a document of the schema. Raises GraphError for anything else."""

    def __init__(
        self, document: Mapping[str, Any], before: Mapping[str, Any] | None = None
    ) -> None:
        try:
            self._rooms = {str(room["label"]): room for room in document["rooms"]}
            self.things = _things(document)
            self._before = _things(before) if before else []
            self._departed = [
                {"room": self._room_at(one.get("position", ())), **one}
                for one in document.get("departed", ())
            ]
        except (AttributeError, KeyError, TypeError) as error:
            raise GraphError(f"no plain map of rooms with objects: {error!r}") from error

    def nearest(self, category: str, to: str, to_room: str) -> list[float] | None:
        origin = self._one(to, to_room)
        if origin is None:
            return None
        others = [one for one in self._of(category) if one is not origin]
        best = min(others, key=lambda one: _away(one, origin), default=None)
        return None if best is None else list(best["position"])

    def within_radius(self, radius: float, of: str, of_room: str) -> list[str] | None:
        origin = self._one(of, of_room)
        if origin is None:
            return None
        near = (one for one in self.things if _away(one, origin) <= radius)
        return _categories(one for one in near if one is not origin)

    def between(self, one: str, one_room: str, other: str, other_room: str) -> list[str] | None:
        first, last = self._one(one, one_room), self._one(other, other_room)
        if first is None or last is None:
            return None
        inside = (thing for thing in self.things if thing not in (first, last))
        return _categories(thing for thing in inside if on_strip(thing, first, last))

    def on_or_in(self, thing: str, thing_room: str) -> list[str] | None:
        carrier = self._one(thing, thing_room)
        return (
            None
            if carrier is None
            else _categories(
                one
                for one in self.things
                for relation in one.get("relations", ())
                if relation["target"] == carrier["name"]
                and relation["kind"] in ("on", "inside")
                and relation.get("probability", 1.0) >= PRESENT
            )
        )

    def last_seen(self, category: str) -> float | None:
        found = [*self._of(category), *(d for d in self._departed if d["category"] == category)]
        return max((one["last_seen"] for one in found if one.get("last_seen")), default=None)

    def moved_since(self, room: str | None) -> list[str]:
        then = {one["name"]: one["position"] for one in self._before}
        return _categories(
            one
            for one in self.things
            if one["name"] in then
            and math.dist(one["position"], then[one["name"]]) >= MOVED
            and room in (None, one["room"])
        )

    def never_looked(self, category: str, room: str) -> str:
        share = self._rooms.get(room, {}).get("viewed_share", 1.0)
        if self.presence(category, room):
            return "present"
        if any((d["category"], d.get("room")) == (category, room) for d in self._departed):
            return "gone"
        looked = "looked, none seen" if share >= WHOLE else "hidden"
        return "never looked" if share < NEVER else looked

    def why(self, thing: str, thing_room: str) -> list[str] | None:
        seen = (self._one(thing, thing_room) or {}).get("seen_in")
        return None if seen is None else [seen["recording"], seen["frame"]]

    def plan(self, category: str) -> list[str]:
        def worth(label: str) -> tuple[int, float]:
            share = self._rooms[label].get("viewed_share", 1.0)
            return -self.count_in_place(category, label), share

        return sorted(self._rooms, key=worth)

    def past(self, category: str, room: str) -> int:
        return sum((one["category"], one["room"]) == (category, room) for one in self._before)

    def appeared_since(self, room: str | None) -> list[str]:
        return _categories(_new(self.things, self._before, room))

    def vanished_since(self, room: str | None) -> list[str]:
        return _categories(_new(self._before, self.things, room))

    def size(self, thing: str, thing_room: str) -> float | None:
        size = (self._one(thing, thing_room) or {}).get("size")
        return None if size is None else float(max(size[:2]))

    def picture(self, thing: str, thing_room: str) -> list[Any] | None:
        seen = (self._one(thing, thing_room) or {}).get("seen_in") or {}
        return [seen["recording"], seen["frame"], *seen["box"]] if "box" in seen else None

    def unanswerable(self, category: str, room: str) -> int | str:
        never = self.never_looked(category, room) == "never looked"
        return NOT_KNOWN if never else self.count_in_place(category, room)

    def _room_at(self, position: Any) -> str | None:
        for label, room in self._rooms.items():
            ring = (room.get("outline") or [[]])[0]
            sides = list(zip(*ring, strict=False))
            if (
                len(position) > 1
                and sides
                and all(
                    min(side) <= c < max(side) for side, c in zip(sides, position, strict=False)
                )
            ):
                return label
        return None

    def _of(self, category: str, room: str | None = None) -> list[Thing]:
        return [
            one
            for one in self.things
            if one["category"] == category and room in (None, one["room"])
        ]

    def _one(self, category: str, room: str) -> Thing | None:
        """The surest thing of a category in a room."""
        return max(
            self._of(category, room), key=lambda one: one.get("existence", 1.0), default=None
        )


def on_strip(thing: Thing, one: Thing, other: Thing, margin: float = 0.0) -> bool:
    """Whether a thing lies on the strip between two, made wider and longer by `margin` [m]."""
    start, end, p = (np.array(each["position"][:2], np.float64) for each in (one, other, thing))
    length = float(np.linalg.norm(end - start)) or math.inf
    along, (dx, dy) = float((p - start) @ (end - start)) / length, (end - start) / length
    off = abs((p - start)[0] * dy - (p - start)[1] * dx)
    return -margin < along < length + margin and bool(off <= STRIP / 2 + margin)


def _new(things: list[Thing], others: list[Thing], room: str | None) -> list[Thing]:
    """Things in `room` whose names are not among the others."""
    names = {one["name"] for one in others}
    return [one for one in things if one["name"] not in names and room in (None, one["room"])]


def _things(document: Mapping[str, Any]) -> list[Thing]:
    listed = [(one, room["label"]) for room in document["rooms"] for one in room["objects"]]
    listed += [(one, None) for one in document.get("elsewhere", ())]
    things = [
        {**one, "category": str(one["category"]), "position": _point(one), "room": room}
        for one, room in listed
        if one.get("existence", 1.0) >= PRESENT
    ]
    return sorted(things, key=lambda one: str(one["name"]))


def _point(one: Thing) -> list[float]:
    point = [float(c) for c in one["position"]]
    if len(point) not in (2, 3) or not all(map(math.isfinite, point)):
        raise TypeError(f"position {point} of {one['name']}")
    return point


def _away(one: Thing, other: Thing) -> float:
    """[m] over the floor."""
    return math.dist(one["position"][:2], other["position"][:2])


def _categories(things: Any) -> list[str]:
    return sorted({one["category"] for one in things})
