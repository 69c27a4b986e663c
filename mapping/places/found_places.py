"""Places found in the mapped floor: rooms become places, which keep their identity as they change.

A room becomes the place with which it shares most of its area. A place with assertions is never
merged into another, and is preferred when several match a room. Given places (from a file, or drawn
by people) do not change; a room that lies in one is a part of it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.maps.semantic_map import SemanticMap
from kg.model.areas import Area
from kg.model.iris import whole_number
from kg.model.records import DoorRecord, MapUpdate, ObjectRecord, PlaceRecord
from mapping.occupancy.mapped_floor import mapped_floor
from mapping.occupancy.room_segmentation import Segmentation, SegmentationSettings, segmented
from mapping.places.place_registry import PlaceRegistry, areas_asserted

_SAME: Final = 0.5  # share of the smaller of two areas that both must have to be one place
_ALIKE: Final = 0.97  # intersection over union from which an outline is not written again
_SAME_DOOR: Final = 1.0  # [m] doors closer than this between two places are one
_COVERED: Final = 0.5  # share of a room in a given place that makes it a part of that place


@dataclass(frozen=True, slots=True)
class FoundChanges:
    """Changes to the map by found rooms, beside the records of places."""

    doors: tuple[DoorRecord, ...] = ()
    removed: tuple[str, ...] = ()  # IRIs of places and doors

    def followed_by(self, later: FoundChanges) -> FoundChanges:
        """Both changes as one."""
        kept = {door.iri for door in later.doors}
        removed = (iri for iri in (*self.removed, *later.removed) if iri not in kept)
        return FoundChanges(later.doors, tuple(dict.fromkeys(removed)))


class FoundPlaces:
    """Keeps the places of a registry in step with the rooms of the map's floor.

    `recording` names the stream whose own growing place is one of the rooms, once there are any.
    """

    def __init__(
        self,
        semantic_map: SemanticMap,
        places: PlaceRegistry,
        settings: SegmentationSettings | None = None,
        *,
        recording: str = "",
    ) -> None:
        self._map, self._places, self._recording = semantic_map, places, recording
        self._settings = settings or SegmentationSettings()
        self._prefix = semantic_map.place_iri(0)[:-1]
        self._next = 1  # number of the next new place; each is used once

    def update(self) -> FoundChanges:
        """Segment the floor that the map holds, and update the places."""
        floor = mapped_floor(self._map.floor())
        if floor is None:
            return FoundChanges()
        return self._match(segmented(floor, self._settings))

    def _match(self, found: Segmentation) -> FoundChanges:
        """Match the rooms with the changeable places, and write the result to the registry.

        A room that fixed places cover becomes no place.
        """
        asserted = {assertion.subject for assertion in self._map.assertions.all()}
        drawn = areas_asserted(self._map)
        found = _without(found, [p.area for p in self._places.places() if p.iri in drawn])
        changing, fixed = self._changeable(found, asserted, drawn)
        given = [place.area for place in fixed]
        rooms = [k for k, area in enumerate(found.areas) if not _is_covered(area, given)]
        shared = _shared_area([found.areas[k] for k in rooms], [p.area for p in changing])
        matched = _matches(shared, found, rooms, changing, asserted)
        records = self._records(found, rooms, changing, matched)
        merged = self._merged(records, shared, rooms, changing, matched, asserted)
        iris = _holders(found.areas, fixed) | {k: record.iri for k, record in records.items()}
        doors = self._with_marked(_doors(found, iris, self._map.base))
        adjacent = _adjacent(doors)
        for record in (*fixed, *records.values()):
            self._places.put(replace(record, adjacent=adjacent.get(record.iri, ())))
        self._places.remove(merged)
        known = {door.iri for door in self._map.doors()}
        gone = known - {door.iri for door in doors}
        return FoundChanges(doors, (*merged, *sorted(gone)))

    def _changeable(
        self, found: Segmentation, asserted: set[str], drawn: Collection[str]
    ) -> tuple[list[PlaceRecord], list[PlaceRecord]]:
        """Places that may change their areas, and all other places.

        Changeable are places found in the floor, and the growing places of recordings; not those
        that persons have `drawn`, and not places with assertions that share one room.
        """
        places = self._places.places()
        grown = {self._recording, *(known.name for known in self._map.recordings())}
        changing = [
            place
            for place in places
            if place.iri not in drawn and (place.from_floor or place.label in grown)
        ]
        kept = _in_one_room(found.areas, [p for p in changing if p.iri in asserted])
        changing = [place for place in changing if place.iri not in kept]
        return changing, [place for place in places if place not in changing]

    def _with_marked(self, doors: Sequence[DoorRecord]) -> tuple[DoorRecord, ...]:
        """The doors found, and those that persons marked, with one of each IRI and spot."""
        marked = [door for door in self._map.doors() if door.marked_by]
        new = (door for door in doors if not any(_is_same_door(door, known) for known in marked))
        return *marked, *new

    def _records(
        self,
        found: Segmentation,
        rooms: Sequence[int],
        changing: Sequence[PlaceRecord],
        matched: Mapping[int, int],
    ) -> dict[int, PlaceRecord]:
        """The place of each room, by the room's number."""
        records = {}
        number = self._next = self._next_number()
        for row, room in enumerate(rooms):
            if row in matched:
                old = changing[matched[row]]
                alike = _overlap(found.areas[room], old.area) >= _ALIKE
                records[room] = old if alike else old.with_area(found.areas[room])
            else:
                iri = self._map.place_iri(number)
                place = PlaceRecord(iri, f"room {number}", 0.0, 0.0, 0.0, 0.0)
                records[room] = place.with_area(found.areas[room])
                number = self._next = number + 1
            if len(rooms) > 1 and not records[room].from_floor and row in matched:
                name = f"room {records[room].iri.removeprefix(self._prefix)}"
                records[room] = replace(records[room], label=name)
            records[room] = replace(records[room], from_floor=True)
        return records

    def _next_number(self) -> int:
        numbers = (place.iri.removeprefix(self._prefix) for place in self._places.places())
        used = max((whole_number(n) or 0 for n in numbers), default=0)
        return max(self._next, used + 1)

    def _merged(
        self,
        records: dict[int, PlaceRecord],
        shared: NDArray[np.float64],
        rooms: Sequence[int],
        changing: Sequence[PlaceRecord],
        matched: Mapping[int, int],
        asserted: set[str],
    ) -> tuple[str, ...]:
        """IRIs of places that match no room; their views go to the room around them."""
        gone = []
        for column, place in enumerate(changing):
            if column in matched.values() or place.iri in asserted:
                continue
            gone.append(place.iri)
            row = int(np.argmax(shared[:, column])) if len(rooms) else -1
            if row >= 0 and shared[row, column] > _SAME * place.area.area:
                records[rooms[row]] = _with_views_of(records[rooms[row]], place)
        return tuple(gone)


def find_places(semantic_map: SemanticMap) -> tuple[PlaceRecord, ...]:
    """Find the places of a finished map in its floor, and put its objects into them.

    One transaction; returns the places. Without floor nothing changes.
    """
    with semantic_map.hold():
        places = PlaceRegistry(semantic_map, recording=None)
        found = FoundPlaces(semantic_map, places).update()
        objects = objects_elsewhere(semantic_map, places)
        update = MapUpdate(
            objects=objects,
            places=places.take_changed(),
            doors=found.doors,
            removed=found.removed,
        )
        semantic_map.apply(update)
    return places.places()


def objects_elsewhere(semantic_map: SemanticMap, places: PlaceRegistry) -> tuple[ObjectRecord, ...]:
    """Objects of a map whose believed positions lie in another place now."""
    believed = {record.iri: record.p_map for record in semantic_map.objects()}
    now = (
        replace(record, place=places.at(believed.get(record.iri, record.p_map)))
        for record in semantic_map.perceived.objects()
    )
    before = {record.iri: record.place for record in semantic_map.perceived.objects()}
    return tuple(record for record in now if record.place != before[record.iri])


def _matches(
    shared: NDArray[np.float64],
    found: Segmentation,
    rooms: Sequence[int],
    changing: Sequence[PlaceRecord],
    asserted: set[str],
) -> dict[int, int]:
    """Row of each room -> column of its place, by assertions first, then by shared area."""
    size_room = np.array([found.areas[k].area for k in rooms])
    size_place = np.array([place.area.area for place in changing])
    enough = shared >= _SAME * np.minimum.outer(size_room, size_place)
    pairs = [(int(row), int(column)) for row, column in np.argwhere(enough)]
    pairs.sort(key=lambda p: (changing[p[1]].iri not in asserted, -shared[p], p))
    matched: dict[int, int] = {}
    for row, column in pairs:
        if row not in matched and column not in matched.values():
            matched[row] = column
    return matched


def _shared_area(rooms: Sequence[Area], places: Sequence[Area]) -> NDArray[np.float64]:
    """(rooms, places) [m^2] that each two have in common."""
    shared = [[room.shared_area(place) for place in places] for room in rooms]
    return np.array(shared, np.float64).reshape(len(rooms), len(places))


def _overlap(one: Area, other: Area) -> float:
    """Intersection over union of two areas."""
    shared = one.shared_area(other)
    return shared / max(one.area + other.area - shared, 1e-9)


def _is_same_door(door: DoorRecord, known: DoorRecord) -> bool:
    near = np.hypot(door.x - known.x, door.y - known.y) < _SAME_DOOR
    return door.iri == known.iri or (near and set(door.places) == set(known.places))


def _without(found: Segmentation, drawn: Sequence[Area]) -> Segmentation:
    """The rooms without the areas that persons drew; a room that these cover stays as it is."""
    areas = (_outside(area, [d for d in drawn if d.shared_area(area) > 0]) for area in found.areas)
    return replace(found, areas=tuple(areas))


def _outside(area: Area, drawn: Sequence[Area]) -> Area:
    if not drawn or _is_covered(area, drawn):
        return area
    return area.without(drawn) or area


def _holders(rooms: Sequence[Area], places: Sequence[PlaceRecord]) -> dict[int, str]:
    """The given place that covers most of each room, by the room's number."""
    shared = _shared_area(rooms, [place.area for place in places])
    if not places:
        return {}
    best = shared.argmax(axis=1).tolist()
    return {
        k: places[column].iri
        for k, column in enumerate(best)
        if shared[k, column] >= _COVERED * rooms[k].area
    }


def _is_covered(room: Area, given: Sequence[Area]) -> bool:
    return sum(map(room.shared_area, given)) >= _COVERED * room.area


def _in_one_room(rooms: Sequence[Area], places: Sequence[PlaceRecord]) -> set[str]:
    """IRIs of `places` that lie in one room with another one of them."""
    shared = _shared_area(rooms, [place.area for place in places])
    inside = shared > _SAME * np.array([place.area.area for place in places])
    return {places[k].iri for row in inside if row.sum() > 1 for k in np.flatnonzero(row).tolist()}


def _with_views_of(place: PlaceRecord, other: PlaceRecord) -> PlaceRecord:
    """`place` with the views of `other` too: the mean of their beliefs, by number of views."""
    total = place.views + other.views
    if total == 0:
        return place
    one, two = place.from_views, other.from_views
    beliefs = {
        category: (one.get(category, 0.0) * place.views + two.get(category, 0.0) * other.views)
        / total
        for category in sorted(one.keys() | two.keys())
    }
    return replace(place, views=total, beliefs=beliefs, scene_beliefs={}, evidence_objects=())


def _doors(found: Segmentation, iris: Mapping[int, str], base: str) -> tuple[DoorRecord, ...]:
    """The doors between places, numbered by these."""
    prefix = f"{base}place/"
    ends = []
    for door in found.doors:
        if all(room in iris for room in door.rooms):
            a, b = sorted((iris[room] for room in door.rooms), key=lambda iri: (len(iri), iri))
            ends.append(((a, b), door))
    ends.sort(key=lambda end: (end[0], end[1].p_map))
    doors = []
    for (a, b), group in groupby(ends, key=lambda end: end[0]):
        for number, (_, door) in enumerate(group, start=1):
            name = f"{a.removeprefix(prefix)}-{b.removeprefix(prefix)}"
            iri = f"{base}door/{name}" + (f"-{number}" if number > 1 else "")
            doors.append(DoorRecord(iri, *door.p_map, door.width, (a, b)))
    return tuple(doors)


def _adjacent(doors: Iterable[DoorRecord]) -> dict[str, tuple[str, ...]]:
    """The places that doors lead to, by place."""
    found: dict[str, set[str]] = {}
    for door in doors:
        for one, other in (door.places, door.places[::-1]):
            found.setdefault(one, set()).add(other)
    return {
        iri: tuple(sorted(others, key=lambda other: (len(other), other)))
        for iri, others in found.items()
    }
