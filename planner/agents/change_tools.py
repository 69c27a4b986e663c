"""Tools about changes: the transactions of one thing, and the objects that moved."""

from __future__ import annotations

from collections import deque
from typing import Annotated, Final

from pydantic import Field

from kg.history.timestamps import iso
from planner.agents import answers as a
from planner.agents.map_context import MapContext
from planner.agents.map_tools import Limit, ThingName, thing
from planner.search.goals.moves import FAR, moved_things

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

    def what_moved(
        self,
        since: Annotated[
            str, Field(max_length=40, description="ISO 8601 (UTC), or #42: after transaction 42")
        ],
        metres: Annotated[float, Field(gt=0, le=1000, description="minimum distance")] = FAR,
        limit: Limit = 20,
    ) -> a.Moved:
        """Objects that moved since a moment, with both positions, the farthest first.

        The moment counts by the time of writing, not of observation. An object that left and was
        not found elsewhere is not listed here; where_is lists it as departed.
        """
        identity, semantic_map = self._context.identity(), self._context.semantic_map
        moved = moved_things(semantic_map, since, far=metres)
        rows = {row["object"]: row for row in semantic_map.query("objects").records()}
        return a.Moved(
            map=identity,
            things=[
                a.MovedThing(
                    **thing(rows[one.iri]).model_dump(),
                    was=[round(float(value), 3) for value in one.was],
                    moved_metres=round(one.metres, 3),
                )
                for one in moved[:limit]
                if one.iri in rows
            ],
            left_out=max(len(moved) - limit, 0),
        )
