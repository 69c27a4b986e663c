"""Object filters: by category, by place, near a point or near another object.

The most selective index (cells, place, category) gives the candidates, and each is checked against
all criteria. So the cost depends on the number of candidates, not on the size of the map.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from pyoxigraph import NamedNode

from kg.maps.facts.objects_and_places import RecordCodec
from kg.model import vocabulary as v
from kg.model.errors import QueryParameterError
from kg.model.records import ObjectRecord, PlaceRecord, likeliest
from kg.rdf.literals import cells_of_disc
from kg.rdf.quad_store import QuadStore, subcategories


def select_objects(
    engine: QuadStore,
    facts: RecordCodec,
    category: str | None,
    place: str | None,
    near: tuple[float, float] | str | None,
    radius: float,
) -> tuple[ObjectRecord, ...]:
    """Objects that match, nearest first where `near` is given, else oldest first.

    `category` and `place` are IRIs. Raises QueryParameterError for an invalid `near`.
    """
    if category is None and place is None and near is None:
        return facts.objects(engine)
    kinds = None if category is None else subcategories(engine, category)
    centre = None if near is None else _centre(engine, facts, near, radius)
    cells = None if centre is None else cells_of_disc(*centre, radius)
    candidates: set[str] = set()
    for predicate, value in _lookups(engine, kinds, place, cells):
        found = engine.quads_for_pattern(None, NamedNode(predicate), NamedNode(value), v.MAP_GRAPH)
        candidates.update(q.subject.value for q in found if isinstance(q.subject, NamedNode))
    if isinstance(near, str):
        candidates.discard(near)
    records = [
        record
        for record in facts.some_objects(engine, candidates)
        if (record.category != v.UNNAMED_THING if kinds is None else record.category in kinds)
        and (place is None or record.place == place)
    ]
    if centre is None:
        return tuple(records)
    by_distance = [(math.dist(record.p_map[:2], centre), record) for record in records]
    by_distance.sort(key=lambda pair: pair[0])
    return tuple(record for distance, record in by_distance if distance <= radius)


def _lookups(
    engine: QuadStore,
    kinds: frozenset[str] | None,
    place: str | None,
    cells: tuple[str, ...] | None,
) -> Iterator[tuple[str, str]]:
    """Predicates and values that find all matches, by the most selective of the criteria."""
    if cells is not None:
        yield from ((v.IN_CELL, cell) for cell in cells)
    elif place is not None:
        yield v.IN_PLACE, place
    else:  # objects have the types of their categories alone
        classes = subcategories(engine, v.OBJECT) if kinds is None else kinds
        yield from ((v.RDF_TYPE.value, category) for category in classes)


def _centre(
    engine: QuadStore, facts: RecordCodec, near: tuple[float, float] | str, radius: float
) -> tuple[float, float]:
    if isinstance(near, str):
        found = facts.some_objects(engine, [near])
        if not found:
            raise QueryParameterError(f"near: no object {near!r} in this map")
        near = float(found[0].p_map[0]), float(found[0].p_map[1])
    try:
        x, y = map(float, tuple(near)[:2])
    except (TypeError, ValueError):
        x = y = math.nan
    if not (math.isfinite(x) and math.isfinite(y) and 0 <= radius < math.inf):
        raise QueryParameterError(
            f"near must be finite (x, y) with a radius of 0 m or more, got {near}, {radius}"
        )
    return x, y


def is_believed(place: PlaceRecord, kinds: frozenset[str] | None, min_belief: float | None) -> bool:
    """Whether a place's most probable category is in `kinds` (None: any).

    With `min_belief`: whether any category in `kinds` has at least that probability.
    """
    if min_belief is not None:
        held = [b for kind, b in place.beliefs.items() if kinds is None or kind in kinds]
        return any(belief >= min_belief for belief in held)
    top = likeliest(place.beliefs)
    return top is not None and (kinds is None or top in kinds)
