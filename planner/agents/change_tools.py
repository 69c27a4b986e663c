"""Tools about changes: the transactions of one thing, and the objects that changed."""

from __future__ import annotations

from collections import deque
from typing import Annotated, Final

from pydantic import Field

from kg.history.reports.comparison import FAR, ObjectChange
from kg.history.timestamps import iso
from planner.agents import answers as a
from planner.agents.map_context import MapContext
from planner.agents.map_tools import Limit, ThingName

_MAX_CHANGES: Final = 12  # listed for a transaction


class ChangeTools:
    """The tools on a map's past. Every method is a tool; its docstring is what agents read."""

    def __init__(self, context: MapContext) -> None:
        self._context = context

    def history(self, what: ThingName, last: Limit = 10) -> a.HistoryAnswer:
        """The last changes of one thing (object/17, place/1): time, cause and author of each."""
        identity = self._context.identity()
        entries, count = deque[a.Event](maxlen=last), 0
        for entry in self._context.semantic_map.history.events(what):
            count += 1
            entries.append(
                a.Event(
                    sequence=entry.sequence,
                    time=iso(entry.time),
                    kind=entry.cause.kind,
                    untrusted_by=entry.cause.by,
                    untrusted_note=entry.cause.note,
                    untrusted_changes=list(entry.changes[:_MAX_CHANGES]),
                    changes_left_out=max(len(entry.changes) - _MAX_CHANGES, 0),
                )
            )
        return a.HistoryAnswer(map=identity, events=list(entries), left_out=count - len(entries))

    def what_changed(
        self,
        since: Annotated[
            str, Field(max_length=40, description="ISO 8601 (UTC), or #42: after transaction 42")
        ],
        metres: Annotated[float, Field(gt=0, le=1000, description="minimum move")] = FAR,
        limit: Limit = 20,
    ) -> a.Changed:
        """Objects that appeared, are gone, moved or have another name since a moment.

        The moment counts by the time of writing, not of observation. A move exceeds the uncertainty
        of both positions. where_is lists things that departed with their last spot.
        """
        identity, semantic_map = self._context.identity(), self._context.semantic_map
        found = semantic_map.history.compare(since, far=metres)
        return a.Changed(
            map=identity,
            things=[_changed(one, semantic_map.base) for one in found.changes[:limit]],
            left_out=max(len(found.changes) - limit, 0),
            floor_seen=list(found.floor),
        )


def _changed(one: ObjectChange, base: str) -> a.ChangedThing:
    return a.ChangedThing(
        kind=one.kind,
        iri=base + one.iri,
        untrusted_category=one.category,
        place=None if one.place is None else base + one.place,
        was=None if one.was is None else [round(value, 3) for value in one.was],
        now=None if one.now is None else [round(value, 3) for value in one.now],
        moved_metres=None if one.metres is None else round(one.metres, 3),
        untrusted_before=one.before,
        untrusted_after=one.after,
    )
