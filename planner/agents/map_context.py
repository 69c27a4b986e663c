"""The context that all tools share: the open map, its identity, names of things, times."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime

from kg.history.timestamps import iso
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import QueryParameterError, UnknownCategoryError
from planner.agents.answers import MapIdentity
from planner.freespace.planning_map import Row
from planner.search.goals.candidate_queries import map_time


@dataclass(frozen=True, slots=True)
class MapContext:
    """An open map and the author of changes; without an `author` it is only read."""

    semantic_map: SemanticMap
    author: Callable[[], str] | None = None
    max_listed: int = 50  # categories and places of a description

    @property
    def writable(self) -> bool:
        """Whether there are tools that write."""
        return self.author is not None

    def identity(self) -> MapIdentity:
        """The map and its state; taken first, so that an answer is never older than this state."""
        return MapIdentity(
            untrusted_title=self.semantic_map.description.title,
            base=self.semantic_map.base,
            sequence=self.semantic_map.sequence,
            time=iso(map_time(self.semantic_map)),
        )

    def is_thing(self, what: str) -> bool:
        """Whether a text names one object rather than a kind or a place."""
        return self.iri(what).startswith(f"{self.semantic_map.base}object/")

    def iri(self, what: str) -> str:
        """The IRI that ``object/17`` is short for."""
        return what if "://" in what else self.semantic_map.base + what

    def place(self, text: str) -> str:
        """IRI of a place by its label, number or IRI, or by a category that one place alone has.

        Raises QueryParameterError, which lists the places, for none or several.
        """
        try:
            return self.semantic_map.resolve("place", text)
        except QueryParameterError as error:
            try:
                believed = self.semantic_map.places(text)
            except UnknownCategoryError:
                raise error from None
            if len(believed) > 1:
                iris = ", ".join(place.iri for place in believed)
                raise QueryParameterError(
                    f"several places have the category {text!r}; give one of {iris}"
                ) from None
            if not believed:
                raise
            return believed[0].iri


def time_or_none(value: object) -> str | None:
    """A time as ISO 8601 in UTC; None for other values."""
    return iso(value.astimezone(UTC).timestamp()) if isinstance(value, datetime) else None


def number_or_none(row: Row, column: str) -> float | None:
    """The number in a column of a row, or None."""
    value = row.get(column)
    return round(float(value), 6) if isinstance(value, int | float) else None
