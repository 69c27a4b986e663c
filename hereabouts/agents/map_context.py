"""The context that all tools share: the open map, its identity, names of things, times."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass

from hereabouts.agents.answers import MapState
from hereabouts.agents.plain_values import LABEL, clock, escaped
from kg.maps.semantic_map import SemanticMap
from planner.freespace.planning_map import Row
from planner.search.goals.known_objects import map_time
from planner.search.goals.place_names import titles_by_label


@dataclass(frozen=True, slots=True)
class MapContext:
    """An open map and the author of changes; without an `author` it is only read."""

    semantic_map: SemanticMap
    author: Callable[[], str] | None = None

    @property
    def writable(self) -> bool:
        """Whether there are tools that write."""
        return self.author is not None

    def state(self) -> MapState:
        """The state of the map; taken first, so that an answer is never older than it."""
        return state_of(self.semantic_map)

    def at(self, when: str | None) -> AbstractContextManager[SemanticMap]:
        """The map now, or at a past moment (`instant`)."""
        return nullcontext(self.semantic_map) if when is None else self.semantic_map.at(when)

    def place_titles(self) -> dict[str, str]:
        """Titles of places by their labels, as answers have them for people."""
        titles = titles_by_label(self.semantic_map)
        return {escaped(label, LABEL): escaped(title, LABEL) for label, title in titles.items()}


def state_of(semantic_map: SemanticMap) -> MapState:
    """The number of the last transaction of a map, and the time of its latest observation."""
    return MapState(sequence=semantic_map.sequence, time=clock(map_time(semantic_map)))


def number_or_none(row: Row, column: str) -> float | None:
    """The number in a column of a row, or None."""
    value = row.get(column)
    return round(float(value), 6) if isinstance(value, int | float) else None
