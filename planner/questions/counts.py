"""Counts and sizes in words: objects by category, things without a name, boxes of things."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kg.knowledge.ontology.catalogue import Catalogue
from kg.maps.semantic_map import SemanticMap
from planner.freespace.planning_map import Row
from planner.search.goals.search_goals import with_article

NAMED: Final = 8  # kinds of things, things, or places, in a sentence


def counted_kinds(rows: Iterable[Row], catalogue: Catalogue) -> str:
    """``a bed, 3 x book``: objects by category, the most frequent first."""
    counts = Counter(str(row["category"]) for row in rows).most_common()
    named = [
        with_article(kind, catalogue) if n == 1 else f"{n} x {kind}" for kind, n in counts[:NAMED]
    ]
    return _listed(named, sum(n for _, n in counts[NAMED:]))


def counted(rows: Sequence[Row]) -> str:
    """``1 object``, ``3 objects``."""
    return f"{len(rows)} object{'' if len(rows) == 1 else 's'}"


def counted_unnamed(semantic_map: SemanticMap, place: str | None = None) -> str:
    """``3 things without a name``: those of a place (an IRI) or of the map; "" where none is.

    Those of a map are also counted by place, if they are in several.
    """
    found = semantic_map.query("unnamed-things").records()
    where = [
        (row["label"] or row["place"] or "no place", int(str(row["count"])))
        for row in found
        if place in (None, row["place"])
    ]
    total = sum(n for _, n in where)
    if not total:
        return ""
    text = f"{total} thing{'s' if total > 1 else ''} without a name"
    if len(where) == 1:
        return text
    named = [f"{n} in {label}" for label, n in where[:NAMED]]
    return f"{text} ({_listed(named, sum(n for _, n in where[NAMED:]))})"


def sized(label: str, extent: NDArray[np.float64] | None, above_floor: float) -> str:
    """Height of a thing's top, and its box, (3,) [m] of what was seen, centred `above_floor`."""
    if extent is None:
        return f"The size of {label} is not known"
    wide, deep, high = max(extent[:2]), min(extent[:2]), extent[2]
    return (
        f"The top of {label} is {above_floor + high / 2:.2f} m above the floor; the part that was "
        f"seen is {wide:.2f} m wide, {deep:.2f} m deep and {high:.2f} m high"
    )


def _listed(named: list[str], rest: int) -> str:
    return ", ".join(named) + (f" and {rest} more" if rest else "")
