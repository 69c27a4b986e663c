"""Room editor: people split, merge, draw and name the rooms of a map.

Each edit is one transaction. The new areas are assertions of the author, which outrank the rooms
that perception finds in the floor.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from kg.maps.facts import room_edits
from kg.maps.facts.assertion_service import AssertionService, PerceivedRecords
from kg.maps.facts.assertions import (
    Assertions,
    PropertyAssertions,
    area_text,
    believed_object,
    value_of,
)
from kg.maps.facts.frame_writer import FrameWriter
from kg.maps.facts.objects_and_places import RecordCodec
from kg.maps.facts.replaced_values import ago, noted
from kg.maps.facts.robot import robot_in
from kg.maps.facts.room_edits import EditedAreas
from kg.maps.facts.spatial_relations import doors_in
from kg.maps.map_extent import check_positions
from kg.maps.stored_history import StoredHistory
from kg.model.areas import Area
from kg.model.errors import InvalidFactError
from kg.model.iris import agent_iri, whole_number
from kg.model.records import Assertion, DoorRecord, MapUpdate, ObjectRecord, PlaceRecord
from kg.model.room_edit import Point, RoomEdit
from kg.model.transactions import Cause, ChangeSet
from kg.model.vocabulary import MAP_GRAPH
from kg.store.scheduling import WriterLock
from kg.store.transactional import TransactionalStore

_DOOR_WIDTH: Final = 0.8  # [m]
_BY_PEOPLE: Final = ("rooms", "assert", "retract", "update", "restore")  # kinds of causes
_OVERLAP: Final = 0.01  # [m^2] from which two places overlap


@dataclass(frozen=True, slots=True)
class _Result:
    """Places to write, with their assertions, and what else the edit changes."""

    places: Mapping[str, tuple[PlaceRecord, PropertyAssertions]]
    removed: tuple[str, ...] = ()  # IRIs of places and doors
    doors: tuple[DoorRecord, ...] = ()


class RoomEditor:
    """Edits of the rooms of one map under `guard`."""

    def __init__(
        self,
        store: TransactionalStore,
        facts: RecordCodec,
        perceived: PerceivedRecords,
        writer: FrameWriter,
        assertions: AssertionService,
        history: StoredHistory,
        guard: WriterLock,
    ) -> None:
        self._store, self._facts, self._perceived = store, facts, perceived
        self._writer, self._asserted, self._history = writer, assertions, history
        self._guard = guard
        self._codec = Assertions(facts.base)

    def edit(self, edit: RoomEdit, *, by: str = "") -> ChangeSet | None:
        """Apply an edit in one transaction; None if nothing changed.

        Its notes tell of values of other people that it replaces, and of points that are odd.
        Raises InvalidFactError, with nothing written, if the edit is not possible.
        """
        if not by.strip():
            raise InvalidFactError("an edit of rooms needs an author: by='ann'")
        with self._guard:
            self._store.check_writable()
            note = f"{edit.kind} {' '.join(edit.places)} {edit.name}".strip()
            odd = check_positions(self._store.engine, edit.points, "point")
            if edit.kind == "undo":
                result, note = self._undone(by.strip())
            else:
                result = self._result(edit, by.strip())
            update = MapUpdate(
                objects=self._objects_elsewhere(result),
                places=tuple(record for record, _ in result.places.values()),
                doors=result.doors,
                removed=result.removed,
            )
            asserted = {iri: assertions for iri, (_, assertions) in result.places.items()}
            change = self._writer.change(update, Cause("rooms", by.strip(), note), asserted)
            return noted(change, self._facts.base, self._facts.catalogue, odd)

    def _result(self, edit: RoomEdit, by: str) -> _Result:
        known = {place.iri: place for place in self._facts.places(self._store.engine)}
        chosen = [self._chosen(known, name) for name in edit.places]
        if edit.kind == "door":
            return self._with_door(chosen, edit.points[0], by)
        if edit.kind == "here":
            return self._named(self._robots_place(known.values()), edit.name, by)
        made = {
            "split": lambda: room_edits.split(chosen[0], edit.points),
            "merge": lambda: room_edits.merge(chosen),
            "wall": lambda: room_edits.move_wall(chosen[0], chosen[1], edit.points),
            "draw": lambda: room_edits.draw(edit.points),
        }[edit.kind]()
        return self._with_areas(made, known, edit.name, by)

    def _with_areas(
        self, made: EditedAreas, known: Mapping[str, PlaceRecord], name: str, by: str
    ) -> _Result:
        """The places of an edit, and the others without what these cover."""
        perceived = {place.iri: place for place in self._perceived.places()}
        result: dict[str, tuple[PlaceRecord, PropertyAssertions]] = {}
        for iri, area in made.areas.items():
            record = perceived[iri] if iri else self._new_place(known, name)
            asserted = self._asserted_of(record.iri)
            claim = self._asserted.made(record, asserted, "area", area_text(area), by)
            if not iri:
                claim = replace(claim, perceived=None)
            adjacent = tuple(other for other in record.adjacent if other not in made.removed)
            record = replace(record.with_area(area), adjacent=adjacent)
            result[record.iri] = record, {**asserted, "area": claim}
        for iri, place in known.items():
            if iri in result or iri in made.removed:
                continue
            taken = [a for a in made.areas.values() if a.shared_area(place.area) > _OVERLAP]
            if taken:
                result[iri] = self._cut(perceived[iri], taken)
        doors = doors_in(self._store.engine)
        gone = (door.iri for door in doors if set(door.places) & set(made.removed))
        return _Result(result, (*made.removed, *gone))

    def _cut(
        self, place: PlaceRecord, taken: Iterable[Area]
    ) -> tuple[PlaceRecord, PropertyAssertions]:
        rest = room_edits.cut(place, taken)
        asserted = self._asserted_of(place.iri)
        if "area" in asserted:
            asserted["area"] = replace(asserted["area"], value=area_text(rest))
        return place.with_area(rest), asserted

    def _new_place(self, known: Iterable[str], name: str) -> PlaceRecord:
        prefix = f"{self._facts.base}place/"
        numbers = (iri.removeprefix(prefix) for iri in known)
        number = 1 + max((whole_number(n) or 0 for n in numbers), default=0)
        label = self._label(name) if name.strip() else f"room {number}"
        return PlaceRecord(f"{prefix}{number}", label, 0.0, 0.0, 0.0, 0.0, from_floor=True)

    def _named(self, place: PlaceRecord, name: str, by: str) -> _Result:
        asserted = self._asserted_of(place.iri)
        record = next(p for p in self._perceived.places() if p.iri == place.iri)
        claim = self._asserted.made(record, asserted, "label", self._label(name), by)
        return _Result({place.iri: (record, {**asserted, "label": claim})})

    def _label(self, name: str) -> str:
        """The name of a room as its label may be asserted."""
        return value_of("label", name, self._facts.catalogue, "place")

    def _with_door(self, places: Sequence[PlaceRecord], point: Point, by: str) -> _Result:
        one, other = sorted(places, key=lambda place: (len(place.iri), place.iri))
        for place in (one, other):
            if room_edits.distance(place.area, point) > room_edits.MAX_GAP:
                raise InvalidFactError(
                    f"({point[0]:g}, {point[1]:g}) is no door of {place.label}; a point at most "
                    f"{room_edits.MAX_GAP:g} m from both places would work"
                )
        taken = {door.iri for door in doors_in(self._store.engine)}
        prefix = f"{self._facts.base}place/"
        numbers = "-".join(place.iri.removeprefix(prefix) for place in (one, other))
        name = f"{self._facts.base}door/{numbers}"
        iri = next(i for i in (name, *(f"{name}-{n}" for n in range(2, 1000))) if i not in taken)
        agent = agent_iri(self._facts.base, by)
        door = DoorRecord(iri, *point, _DOOR_WIDTH, (one.iri, other.iri), marked_by=agent)
        written: dict[str, tuple[PlaceRecord, PropertyAssertions]] = {}
        for place, beyond in ((one, other), (other, one)):
            (record,) = (known for known in self._perceived.places() if known.iri == place.iri)
            adjacent = tuple(sorted({*record.adjacent, beyond.iri}))
            written[place.iri] = replace(record, adjacent=adjacent), self._asserted_of(place.iri)
        return _Result(written, doors=(door,))

    def _undone(self, by: str) -> tuple[_Result, str]:
        """The last edit of an author in reverse: its places and doors as they were before.

        What was asserted of the places since then, other than areas and names of the edit, stays.
        """
        edit, later = self._last_edit(by)
        past = self._history.store_at(edit.sequence - 1).engine
        before = {place.iri: place for place in self._facts.places(past)}
        now = {place.iri: place for place in self._perceived.places()}
        subjects, asserted = self._touched(edit)
        prefix = f"{self._facts.base}place/"
        touched = {iri for iri in subjects if iri.rpartition("/")[0] + "/" == prefix}
        new = (touched - before.keys()) & now.keys()
        self._check_not_built_on(edit, later, new)
        places = {}
        for iri in touched & before.keys():
            record = now.get(iri, before[iri]).with_area(before[iri].area)
            record = replace(record, adjacent=before[iri].adjacent)
            former = self._codec.of(past, iri)
            kept = {p: a for p, a in self._asserted_of(iri).items() if (iri, p) not in asserted}
            if iri in now:
                former = {p: a for p, a in former.items() if (iri, p) in asserted}
            places[iri] = record, {**kept, **former}
        doors = {door.iri: door for door in doors_in(past) if door.iri in subjects}
        known = {door.iri for door in doors_in(self._store.engine)}
        gone = [*new, *(known & subjects) - doors.keys()]
        result = _Result(places, tuple(sorted(gone)), tuple(doors.values()))
        return result, f"undo #{edit.sequence}"

    def _last_edit(self, by: str) -> tuple[ChangeSet, list[ChangeSet]]:
        """The last edit of an author that was not undone, and what people changed after it."""
        log, later = self._history.log, list[ChangeSet]()
        undone: set[str] = set()
        changes = [c for c in self._history.changes(log.floor) if c.cause.kind in _BY_PEOPLE]
        for change in reversed(changes):
            note = change.cause.note
            if change.cause.kind == "rooms" and note.startswith("undo #"):
                undone.add(note.removeprefix("undo "))
            elif f"#{change.sequence}" in undone:
                continue
            elif change.cause.kind == "rooms" and change.cause.by == by:
                return change, later
            else:
                later.append(change)
        raise InvalidFactError(
            f"no edit of rooms is left to undo for {by}; everyone takes back edits of one's own"
        )

    def _touched(self, change: ChangeSet) -> tuple[set[str], set[tuple[str, str]]]:
        """IRIs of what a transaction changed, and the assertions among it: thing and property."""
        subjects: set[str] = set()
        asserted: set[tuple[str, str]] = set()
        for quad in (*change.added, *change.removed):
            iri = getattr(quad.subject, "value", "")
            if (about := self._codec.subject(iri)) is not None:
                asserted.add((about, iri.split("/perceived/")[0].rpartition("/")[2]))
            elif quad.graph_name == MAP_GRAPH:
                subjects.add(iri)
        return subjects, asserted

    def _check_not_built_on(
        self, edit: ChangeSet, later: Iterable[ChangeSet], new: Iterable[str]
    ) -> None:
        """Raise InvalidFactError where another person changed the same areas, doors or new places.

        The places beside an edited area are of it too. Objects, which only changed their place,
        do not count.
        """
        _, claims = self._touched(edit)
        places = {iri for iri, _ in claims} | set(new)
        for change in reversed([*later]):
            if change.cause.by == edit.cause.by:
                continue
            _, others = self._touched(change)
            on_new = {iri for iri, _ in others} & set(new)
            same = on_new | {iri for iri, prop in others & claims}
            if change.cause.kind == "rooms":
                same |= {iri for iri, _ in others} & places
            if same:
                labels = {
                    place.iri: place.label for place in self._facts.places(self._store.engine)
                }
                name = min(labels.get(iri, iri.removeprefix(self._facts.base)) for iri in same)
                raise InvalidFactError(
                    f"{change.cause.by} changed {name} {ago(change.time)} ago (#{change.sequence}, "
                    f"{change.cause.kind} {change.cause.note[:40]}), after the edit "
                    f"#{edit.sequence} of {edit.cause.by}: that stays; an undo by "
                    f"{change.cause.by} first, or a new edit, would work"
                )

    def _objects_elsewhere(self, result: _Result) -> tuple[ObjectRecord, ...]:
        """The objects that lie in another place after the edit."""
        places = {place.iri: place for place in self._facts.places(self._store.engine)}
        places |= {iri: record for iri, (record, _) in result.places.items()}
        left = [place for iri, place in places.items() if iri not in result.removed]
        moved = []
        for record in self._perceived.objects():
            believed = believed_object(record, self._asserted_of(record.iri))
            x, y = (float(value) for value in believed.p_map[:2])
            now = next((place.iri for place in left if place.area.contains(x, y)), None)
            if now != record.place:
                moved.append(replace(record, place=now))
        return tuple(moved)

    def _robots_place(self, places: Iterable[PlaceRecord]) -> PlaceRecord:
        robot = robot_in(self._store.engine, self._facts.base)
        if robot is None:
            raise InvalidFactError("the map has no robot; name a place by its IRI instead")
        x, y = (float(value) for value in robot.p_map[:2])
        for place in places:
            if place.area.contains(x, y):
                return place
        raise InvalidFactError(f"the robot is at ({x:.2f}, {y:.2f}), in no place of the map")

    def _chosen(self, known: Mapping[str, PlaceRecord], name: str) -> PlaceRecord:
        iri = self._asserted.place(name)
        if iri not in known:
            base = self._facts.base
            there = ", ".join(i.removeprefix(base) for i in list(known)[:10]) or "none"
            raise InvalidFactError(f"no place {name[:100]!r}; the map has {there}")
        return known[iri]

    def _asserted_of(self, iri: str) -> dict[str, Assertion]:
        return self._codec.of(self._store.engine, iri)
