"""Questions asked by the Python interface."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from kg.model.records import ObjectRecord
from lab.questions.graph_maps import AskedMap
from lab.questions.plain_map import NOT_KNOWN
from lab.questions.sparql_interfaces import in_order
from planner.search.goals.status import status
from planner.search.plans.search_state import build_search
from planner.search.plans.view_plan import plan_from

_PRESENT = 0.5  # existence
_EVERYWHERE = 100.0  # [m]


class PythonInterface:
    """Each family by `SemanticMap` and what builds on it."""

    def __init__(self, asked: AskedMap) -> None:
        self._map, self._since = asked.semantic_map, asked.since

    def count(self, category: str) -> int:
        return len(_there(self._map.objects(category)))

    def count_in_place(self, category: str, room: str) -> int:
        return len(_there(self._map.objects(category, place=room)))

    def presence(self, category: str, room: str) -> bool:
        return status(self._map, category, room).value == "present"

    def nearest(self, category: str, to: str, to_room: str) -> list[float] | None:
        one = self._one(to, to_room)
        if one is None:
            return None
        near = _there(self._map.objects(category, near=one.iri, radius=_EVERYWHERE))
        return [float(c) for c in near[0].p_map] if near else None

    def within_radius(self, radius: float, of: str, of_room: str) -> list[str] | None:
        one = self._one(of, of_room)
        if one is None:
            return None
        return self._categories(_there(self._map.objects(near=one.iri, radius=radius)))

    def between(self, one: str, one_room: str, other: str, other_room: str) -> list[str] | None:
        first, last = self._one(one, one_room), self._one(other, other_room)
        if first is None or last is None:
            return None
        way = (last.p_map - first.p_map)[:2]
        length = float(np.linalg.norm(way))
        found = []
        for thing in _there(self._map.objects()):
            dx, dy = (thing.p_map - first.p_map)[:2]
            along, off = (dx, dy) @ way / length, abs(dx * way[1] - dy * way[0]) / length
            if 0 < along < length and off <= 0.5 and thing.iri not in (first.iri, last.iri):
                found.append(thing)
        return self._categories(found)

    def on_or_in(self, thing: str, thing_room: str) -> list[str] | None:
        carrier = self._one(thing, thing_room)
        if carrier is None:
            return None
        return self._categories(
            one
            for one in _there(self._map.objects())
            for relation in one.relations or ()
            if relation.target == carrier.iri
            and relation.kind in ("on", "inside")
            and relation.probability >= _PRESENT
        )

    def last_seen(self, category: str) -> float | None:
        kind = self._map.catalogue.find(category, "object").iri
        gone = (one.last_seen for one in self._map.departed() if one.category == kind)
        known = (one.last_seen for one in _there(self._map.objects(category)))
        return max((*gone, *known), default=None)

    def moved_since(self, room: str | None) -> list[str]:
        return self._changed("moved", room)

    def never_looked(self, category: str, room: str) -> str:
        return status(self._map, category, room).value

    def past(self, category: str, room: str) -> int:
        with self._map.at(self._since) as then:
            return len(_there(then.objects(category, place=room)))

    def appeared_since(self, room: str | None) -> list[str]:
        return self._changed("appeared", room)

    def vanished_since(self, room: str | None) -> list[str]:
        return self._changed("gone", room)

    def _changed(self, kind: str, room: str | None) -> list[str]:
        place = None if room is None else self._map.resolve("place", room)
        found = self._map.history.compare(self._since).changes
        changed = [one for one in found if one.kind == kind]
        base = self._map.base
        return sorted({one.category for one in changed if place in (None, f"{base}{one.place}")})

    def size(self, thing: str, thing_room: str) -> float | None:
        one = self._one(thing, thing_room)
        return None if one is None or one.extent is None else float(max(one.extent[:2]))

    def picture(self, thing: str, thing_room: str) -> list[Any] | None:
        one = self._one(thing, thing_room)
        if one is None or one.evidence is None:
            return None
        return [one.evidence.recording, one.evidence.frame, *map(round, one.evidence.box)]

    def unanswerable(self, category: str, room: str) -> int | str:
        never = self.never_looked(category, room) == "never looked"
        return NOT_KNOWN if never else self.count_in_place(category, room)

    def why(self, thing: str, thing_room: str) -> list[str] | None:
        one = self._one(thing, thing_room)
        if one is None or one.evidence is None:
            return None
        return [one.evidence.recording, one.evidence.frame]

    def plan(self, category: str) -> list[str]:
        labels = {place.iri: place.label for place in self._map.places()}
        rooms = labels | {one.iri: labels.get(one.place or "") for one in self._map.objects()}
        state = build_search(self._map, [category])
        found = None if state is None else plan_from(state)
        steps = found.steps if found else ()
        return in_order(rooms.get(step.why[0].candidate.iri) for step in steps if step.why)

    def _one(self, category: str, room: str) -> ObjectRecord | None:
        found = _there(self._map.objects(category, place=room))
        return max(found, key=lambda one: (one.existence, one.confidence), default=None)

    def _categories(self, records: Iterable[ObjectRecord]) -> list[str]:
        return sorted({self._map.catalogue.label(record.category) for record in records})


def _there(records: Iterable[ObjectRecord]) -> list[ObjectRecord]:
    return [record for record in records if record.existence >= _PRESENT]
