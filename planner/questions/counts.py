"""Counts of what a map holds, in words: objects by category, and things without a name."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Final

from kg.maps.semantic_map import SemanticMap
from planner.freespace.planning_map import Row
from planner.search.goals.search_goals import with_article

NAMED: Final = 8  # kinds of things, things, or places, in a sentence


def counted_kinds(rows: Iterable[Row]) -> str:
    """``a bed, 3 x book``: objects by category, the most frequent first."""
    counts = Counter(str(row["category"]) for row in rows).most_common()
    named = [with_article(kind) if n == 1 else f"{n} x {kind}" for kind, n in counts[:NAMED]]
    return _listed(named, sum(n for _, n in counts[NAMED:]))


def counted_unnamed(semantic_map: SemanticMap, place: str | None = None) -> str:
    """``3 things without a name``: those of a place (an IRI) or of the map; "" where none is.

    Those of a map are also counted by place, if they are in several.
    """
    where = Counter(
        thing.place for thing in semantic_map.unnamed_things() if place in (None, thing.place)
    ).most_common()
    total = sum(n for _, n in where)
    if not total:
        return ""
    text = f"{total} thing{'s' if total > 1 else ''} without a name"
    if len(where) == 1:
        return text
    labels = {one.iri: one.label or one.iri for one in semantic_map.places()}
    named = [f"{n} in {labels.get(iri or '', 'no place')}" for iri, n in where[:NAMED]]
    return f"{text} ({_listed(named, sum(n for _, n in where[NAMED:]))})"


def _listed(named: list[str], rest: int) -> str:
    return ", ".join(named) + (f" and {rest} more" if rest else "")
