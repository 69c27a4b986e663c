"""Tools about changes: the transactions of one thing, and the objects that changed."""

from __future__ import annotations

import time
from functools import partial
from typing import Annotated, Final

from pydantic import Field

from hereabouts.agents import answers as a
from hereabouts.agents.list_tools import Limit, Skip, ThingName
from hereabouts.agents.map_context import MapContext, clock
from kg.history.reports.comparison import FAR, ObjectChange, RoomChange
from kg.history.timestamps import instant
from planner.questions.moments import read_since

_MAX_CHANGES: Final = 4  # listed for a transaction


class ChangeTools:
    """The tools on a map's past. Every method is a tool; its docstring is what agents read."""

    def __init__(self, context: MapContext) -> None:
        self._context = context

    def history(self, what: ThingName, limit: Limit = 10, skip: Skip = 0) -> a.HistoryAnswer:
        """The last changes of one thing (object/17, place/1), the latest first, with authors."""
        state = self._context.state()
        semantic_map = self._context.semantic_map
        iri = self._context.iri(what).removeprefix(semantic_map.base)
        entries = [*semantic_map.history.events(iri)][::-1]
        return a.HistoryAnswer(
            map=state,
            events=[
                a.Event(
                    sequence=entry.sequence,
                    time=clock(entry.time),
                    kind=entry.cause.kind,
                    untrusted_by=entry.cause.by,
                    untrusted_note=entry.cause.note,
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
        compare = partial(semantic_map.history.compare, far=metres)
        found = read_since(semantic_map, instant(since, time.time()), compare)
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
