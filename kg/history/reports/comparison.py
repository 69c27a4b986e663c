"""Comparison of two moments: what appeared, is gone, moved, or has another name or shape."""

from __future__ import annotations

import base64
import binascii
import math
import zlib
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final, Literal

from kg.history.map_state import Categories, Row, State, state_after
from kg.history.storage.log import HistoryLog
from kg.history.timestamps import iso, natural_order
from kg.rdf.literals import area_of_polygon

PRESENT: Final = 0.5  # existence from which on an object counts as present
FAR: Final = 0.3  # [m] from which on an object counts as moved
SURE: Final = 2.0  # standard deviations of the distance that a move must exceed, too
RESHAPED: Final = 0.5  # [m^2] by which the area of a room differs that has another shape
_MAX_CELLS: Final = 1 << 20  # of one tile, whatever its text claims

Kind = Literal["appeared", "gone", "moved", "relabelled"]
RoomKind = Literal["appeared", "gone", "relabelled", "reshaped"]
Point = tuple[float, float, float]
_ORDER: Final[tuple[Kind, ...]] = ("appeared", "gone", "moved", "relabelled")


@dataclass(frozen=True, slots=True)
class ObjectChange:
    """The change of one object between two moments."""

    kind: Kind
    iri: str  # without the base of the map
    category: str  # label
    place: str | None  # IRI without the base: where it is, or was
    was: Point | None = None  # [m] position at the first moment
    now: Point | None = None  # [m] position at the second moment
    before: str | None = None  # former name, of an object that is relabelled
    after: str | None = None
    name: str = ""  # what sentences call it

    @property
    def metres(self) -> float | None:
        """[m] from the first to the second position."""
        return None if self.was is None or self.now is None else math.dist(self.was, self.now)

    @property
    def sides(self) -> tuple[str, str]:
        """The two states in words."""
        if self.kind == "relabelled":
            return self.before or "", self.after or ""
        return _at(self.was), _at(self.now)


@dataclass(frozen=True, slots=True)
class RoomChange:
    """The change of one room between two moments."""

    kind: RoomKind
    iri: str  # without the base of the map
    title: str  # what sentences call it
    before: str  # former title, or area in words; "" if it was not there
    after: str


@dataclass(frozen=True, slots=True)
class Comparison:
    """The difference between two moments as people see it."""

    before: int  # sequence numbers
    after: int
    times: tuple[str, str]  # ISO 8601
    floor: tuple[float, float]  # [m^2] of the floor that had been seen
    changes: tuple[ObjectChange, ...]
    surface: tuple[float, float] = (0.0, 0.0)  # [m^2] of the surface that was there
    rooms: tuple[RoomChange, ...] = ()

    @property
    def area_words(self) -> str:
        """Floor and surface in one line."""
        parts = [_area_words("floor", *self.floor)]
        if any(self.surface):
            parts.append(_area_words("surface", *self.surface))
        return "; ".join(parts)


def _area_words(name: str, before: float, after: float) -> str:
    if before == after:
        return f"{after:.1f} m² of {name} seen"
    return f"{before:.1f} m² of {name} seen, then {after:.1f} m²"


def compare(
    log: HistoryLog, categories: Categories, base: str, before: int, after: int, far: float = FAR
) -> Comparison:
    """The changes between the states after two transactions, by kind; moves the farthest first.

    A room has another shape if its area differs by `RESHAPED` [m^2] or more.

    An object is there if its existence is at least `PRESENT`. It has moved if it stands at least
    `far` [m] away, and farther than the uncertainty of both positions, so that a bed that is seen
    from another side has not moved. Raises HistoryError if a moment is not kept.
    """
    first, second = (state_after(log, number, categories, base) for number in (before, after))
    old, new = ({row["iri"]: row for row in _present(state)} for state in (first, second))
    changes = [
        *(_change("appeared", row, categories.label) for iri, row in new.items() if iri not in old),
        *(_change("gone", row, categories.label) for iri, row in old.items() if iri not in new),
        *(one for iri in old.keys() & new.keys() for one in _kept(old[iri], new[iri], categories)),
    ]
    found = [one for one in changes if one.kind != "moved" or (one.metres or 0.0) >= far]
    found.sort(
        key=lambda one: (_ORDER.index(one.kind), -(one.metres or 0.0), natural_order(one.iri))
    )
    floors = _floor_area(first), _floor_area(second)
    times = iso(log.time_of(before)), iso(log.time_of(after))
    rooms = sorted(_room_changes(first, second), key=lambda one: (one.kind, natural_order(one.iri)))
    return Comparison(before, after, times, floors, tuple(found), rooms=tuple(rooms))


def _room_changes(first: State, second: State) -> Iterator[RoomChange]:
    old, new = ({row["iri"]: row for row in state["places"]} for state in (first, second))
    for iri in old.keys() | new.keys():
        was, now = old.get(iri), new.get(iri)
        if was is None or now is None:
            row = now or old[iri]
            areas = ("", _area(row)[1]) if was is None else (_area(row)[1], "")
            yield RoomChange("appeared" if was is None else "gone", iri, row["title"], *areas)
            continue
        title = now["title"]
        if was["title"] != title:
            yield RoomChange("relabelled", iri, title, was["title"], title)
        (small, before), (large, after) = _area(was), _area(now)
        if abs(large - small) >= RESHAPED:
            yield RoomChange("reshaped", iri, title, before, after)


def _area(row: Row) -> tuple[float, str]:
    """[m^2] within the outline of a room, or within its box; and in words."""
    area = (row["xmax"] - row["xmin"]) * (row["ymax"] - row["ymin"])
    with suppress(ValueError, KeyError):
        area = area_of_polygon(row["outline"]).area
    return area, f"{area:.1f} m²"


def _present(state: State) -> Iterator[Row]:
    return (row for row in state["objects"] if row["existence"] >= PRESENT)


def _change(kind: Kind, row: Row, label: Callable[[str], str]) -> ObjectChange:
    was, now = (_point(row), None) if kind == "gone" else (None, _point(row))
    category = label(row["class"])
    name = row.get("label") or category
    return ObjectChange(kind, row["iri"], category, row.get("place"), was, now, name=name)


def _kept(old: Row, new: Row, categories: Categories) -> Iterator[ObjectChange]:
    """The changes of an object that is there at both moments; its move may be short."""
    was, now, place = _point(old), _point(new), new.get("place")
    deviation = math.hypot(old.get("deviation", 0.0), new.get("deviation", 0.0))
    category = categories.label(new["class"])
    names = [row.get("label") or categories.label(row["class"]) for row in (old, new)]
    if was != now and math.dist(was, now) >= SURE * deviation:
        yield ObjectChange("moved", new["iri"], category, place, was, now, name=names[1])
    if names[0] != names[1] or old["class"] != new["class"]:
        kinds = [categories.label(row["class"]) for row in (old, new)]
        one, other = names if names[0] != names[1] else kinds
        yield ObjectChange(
            "relabelled", new["iri"], category, place, was, now, one, other, names[1]
        )


def _point(row: Row) -> Point:
    return row["x"], row["y"], row.get("z", 0.0)


def _at(point: Point | None) -> str:
    return "" if point is None else ", ".join(f"{value:.2f}" for value in point)


def _floor_area(state: State) -> float:
    """[m^2] of the cells that have been seen."""
    area: float = sum(_known_cells(row["cells"]) * row["size"] ** 2 for row in state["floor"])
    return round(area, 2)


def _known_cells(text: str) -> int:
    try:
        data = zlib.decompressobj().decompress(base64.b64decode(text), _MAX_CELLS)
    except (binascii.Error, ValueError, zlib.error):
        return 0
    return len(data) - data.count(0)


MAX_MARKS: Final = 400  # of one timeline; marks that are close together are joined
MAX_SPANS: Final = 40
GAP: Final = 0.02  # share of all time with transactions that a quiet time must exceed to be cut out
MIN_GAP: Final = 60.0  # [s]


@dataclass(frozen=True, slots=True)
class Mark:
    """A moment at which things changed."""

    sequence: int
    time: float  # [s] since 1970-01-01 UTC
    objects: int  # that appeared, or are gone since
    edits: int  # transactions of people


@dataclass(frozen=True, slots=True)
class Timeline:
    """Spans of time without long quiet times between transactions, and marks in them."""

    first: tuple[int, float]  # number and time [s] of the oldest moment that is kept
    last: tuple[int, float]
    spans: tuple[tuple[float, float], ...]  # [s] beginning and end
    marks: tuple[Mark, ...]


def timeline(log: HistoryLog, base: str, there: Collection[str]) -> Timeline:
    """The timeline of a log: an axis of the clock from which quiet times are cut out.

    `there` has the IRIs of the present objects; the last write of another object is its end.
    """
    with log.lock:
        select = "SELECT time FROM commits WHERE sequence > ? ORDER BY time"
        times = [log.floor_time, *(time for (time,) in log.db.execute(select, (log.floor,)))]
        marks = _marks(log, base, there)
    ends = (log.floor, log.floor_time), (log.last, log.last_time)
    return Timeline(*ends, _spans(times), _joined(marks))


def _spans(times: list[float]) -> tuple[tuple[float, float], ...]:
    steps = sorted(later - earlier for earlier, later in pairwise(times))
    busy = sum(step for step in steps if step <= MIN_GAP)
    longest = steps[-MAX_SPANS] if len(steps) >= MAX_SPANS else 0.0
    least = max(MIN_GAP, GAP * busy, longest)
    spans = [[times[0], times[0]]]
    for time in times[1:]:
        if time - spans[-1][1] > least:
            spans.append([time, time])
        spans[-1][1] = time
    return tuple((start, end) for start, end in spans)


def _marks(log: HistoryLog, base: str, there: Collection[str]) -> list[Mark]:
    """A mark for each transaction in which an object came or went, or that a person made.

    Looks of a search have the name of a robot, and are no edits.
    """
    start = f"<{base}object/"
    rows = log.db.execute(
        "SELECT text, (SELECT min(sequence) FROM touched WHERE subject = id AND sequence > :floor),"
        " (SELECT max(sequence) FROM touched WHERE subject = id AND sequence > :floor) "
        "FROM subject WHERE text >= :start AND text < :end",
        {"floor": log.floor, "start": start, "end": f"{start}\U0010ffff"},
    )
    objects = Counter[int]()
    for text, first, last in rows:
        iri = text[1:-1]
        if "/" not in text[len(start) :] and first is not None:  # no belief or relation
            objects.update({first} if iri in there else {first, last})
    commits = log.db.execute(
        "SELECT sequence, time, by IS NOT NULL AND kind != 'search' FROM commits "
        "WHERE sequence > ? ORDER BY sequence",
        (log.floor,),
    )
    return [
        Mark(sequence, time, objects[sequence], edits)
        for sequence, time, edits in commits
        if objects[sequence] or edits
    ]


def _joined(marks: list[Mark]) -> tuple[Mark, ...]:
    """At most `MAX_MARKS` marks: neighbours become one, at the last of their moments."""
    size = -(-len(marks) // MAX_MARKS)
    groups = [marks[at : at + size] for at in range(0, len(marks), size or 1)]
    return tuple(
        replace(
            group[-1],
            objects=sum(mark.objects for mark in group),
            edits=sum(mark.edits for mark in group),
        )
        for group in groups
    )
