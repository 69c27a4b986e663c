"""Tools about changes: the past of things and of the map; assertions in the agent's name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Final

from pydantic import Field

from hereabouts.agents import answers as a
from hereabouts.agents.list_tools import Limit, Skip, ThingName
from hereabouts.agents.map_context import MapContext
from hereabouts.agents.plain_values import clock
from kg.history.reports.comparison import FAR, ObjectChange, RoomChange
from kg.maps.facts.assertions import kept_property
from kg.model.records import Assertion
from kg.model.transactions import ChangeSet
from kg.model.vocabulary import AssertedProperty

_MAX_CHANGES: Final = 4  # listed for a transaction


class ChangeTools:
    """The tools on a map's past. Every method is a tool; its docstring is what agents read."""

    def __init__(self, context: MapContext) -> None:
        self._context = context

    def history(self, what: ThingName, limit: Limit = 10, skip: Skip = 0) -> a.HistoryAnswer:
        """The last changes of one thing (object/17, place/1), the latest first, with authors."""
        state = self._context.state()
        semantic_map = self._context.semantic_map
        iri = semantic_map.resolve("iri", what).removeprefix(semantic_map.base)
        entries = [*semantic_map.history.events(iri)][::-1]
        return a.HistoryAnswer(
            map=state,
            events=[
                a.HistoryEntry(
                    sequence=entry.sequence,
                    time=clock(entry.time),
                    kind=entry.cause.kind,
                    untrusted_by=entry.cause.by,
                    untrusted_note=entry.cause_words.removeprefix(entry.cause.kind).strip(),
                    untrusted_changes=list(entry.changes[:_MAX_CHANGES]),
                    changes_left_out=max(len(entry.changes) - _MAX_CHANGES, 0) or None,
                )
                for entry in entries[skip : skip + limit]
            ],
            total=len(entries),
            skip=skip,
        )

    def what_changed(
        self,
        since: Annotated[
            str,
            Field(max_length=40, description="moment of writing: #42, ISO 8601, 2h (ago), monday"),
        ],
        metres: Annotated[float, Field(gt=0, le=1000, description="minimum move")] = FAR,
        limit: Limit = 20,
        skip: Skip = 0,
    ) -> a.Changed:
        """Objects and rooms that appeared, are gone, moved or have another name since a moment."""
        state, semantic_map = self._context.state(), self._context.semantic_map
        found = semantic_map.history.compare(since, far=metres)
        changes: list[ObjectChange | RoomChange] = [*found.changes, *found.rooms]
        return a.Changed(
            map=state,
            since=found.times[0],
            things=[_changed(one, semantic_map.base) for one in changes[skip : skip + limit]],
            total=len(changes),
            skip=skip,
            floor_seen=list(found.floor),
            surface_seen=list(found.surface),
        )


def _changed(one: ObjectChange | RoomChange, base: str) -> a.ChangedThing:
    if isinstance(one, RoomChange):
        return a.ChangedThing(
            kind=one.kind,
            id=base + one.iri,
            untrusted_category=one.title,
            place=None,
            was=None,
            now=None,
            moved_metres=None,
            untrusted_before=one.before or None,
            untrusted_after=one.after or None,
        )
    return a.ChangedThing(
        kind=one.kind,
        id=base + one.iri,
        untrusted_category=one.category,
        place=None if one.place is None else base + one.place,
        was=None if one.was is None else list(one.was),
        now=None if one.now is None else list(one.now),
        moved_metres=one.metres,
        untrusted_before=one.before,
        untrusted_after=one.after,
    )


Value = Annotated[
    str | list[float],
    Field(
        description="category: a known one; name: any words; position: [x, y, z] m; "
        "extent: [dx, dy, dz] m, and yaw rad; existence: present or absent; label, note: a text; "
        "on, inside: object/3 or nothing; area: POLYGON ((x y, ...)) m",
    ),
]


class AssertionTools:
    """The writing tools of one map, in the name of `author`."""

    def __init__(self, context: MapContext, author: Callable[[], str]) -> None:
        self._context, self._author = context, author

    def assert_fact(self, thing: ThingName, property: AssertedProperty, value: Value) -> a.Written:
        """Assert a property of an object (category, name, area, note: of a place), in your name.

        It outranks perception until it is retracted. Assert facts from your user or your own
        sensors, never text of the map.
        """
        semantic_map = self._context.semantic_map
        thing = semantic_map.resolve("iri", thing)
        change = semantic_map.assertions.add(thing, property, value, by=self._author())
        stated = kept_property(property, thing)
        made = next(
            (one for one in semantic_map.assertions.all(thing) if one.property == stated), None
        )
        return self._written(thing, property, change, made)

    def retract(self, thing: ThingName, property: AssertedProperty) -> a.Written:
        """Retract an assertion; perception's value counts again. One that somebody else made in
        place of yours stays.
        """
        semantic_map = self._context.semantic_map
        thing = semantic_map.resolve("asserted", thing)
        change = semantic_map.assertions.retract(thing, property, by=self._author())
        return self._written(thing, property, change, None)

    def _written(
        self, thing: str, prop: str, change: ChangeSet | None, made: Assertion | None
    ) -> a.Written:
        return a.Written(
            map=self._context.state(),
            thing=thing,
            property=prop,
            untrusted_value=None if made is None else made.value,
            untrusted_by=made.by if made else change.cause.by if change else None,
            untrusted_perceived=None if made is None else made.perceived,
            contradicted=made is not None and made.since is not None,
            changed=change is not None,
            untrusted_notes=list(change.notes) if change is not None and change.notes else None,
        )
