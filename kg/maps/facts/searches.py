"""Searches, looks and obstacles: records to facts of graph:map, and back."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final, cast, get_args

from pyoxigraph import Literal, NamedNode, Quad

from kg.model import vocabulary as v
from kg.model.errors import InvalidFactError
from kg.model.records import LookRecord, MapUpdate, ObstacleRecord, SearchRecord, SearchState
from kg.rdf.literals import (
    Properties,
    first,
    iri_node,
    iri_order,
    number_literal,
    properties_of,
    seconds,
    stamp_of,
    subject_quads,
    text_of,
    time_literal,
)
from kg.rdf.quad_store import QuadStore
from kg.store.transactional import TransactionalStore

_PART = NamedNode(v.PART_OF_SEARCH)
_STATES: Final[tuple[str, ...]] = get_args(SearchState)

#: Predicates that the writer owns; it keeps others, which persons wrote.
OWN = {
    *(v.RDF_TYPE.value, v.RDFS_LABEL, v.SEARCH_WORDS, v.SEARCHED_FOR, v.SEARCH_STATE),
    *(v.SEARCH_SECONDS, v.PROV_STARTED_AT, v.PROV_ENDED_AT, v.FOUND, v.PART_OF_SEARCH, v.NUMBER),
    *(v.PROBABILITY_LEFT, v.SOSA_RESULT_TIME, v.X, v.Y, v.HEADING, v.EXTENT, v.GLIMPSES, v.REASON),
}

_Fact = tuple[str, NamedNode | Literal]


def facts_of(update: MapUpdate) -> Iterator[Quad]:
    """Facts of the search, looks and obstacles in `update`.

    Raises InvalidFactError for numbers that are not finite or out of range.
    """
    if update.search is not None:
        yield from subject_quads(update.search.iri, _of_search(update.search))
    for look in update.looks:
        yield from subject_quads(look.iri, _of_look(look))
    for obstacle in update.obstacles:
        yield from subject_quads(obstacle.iri, _of_obstacle(obstacle))


def subjects_of(update: MapUpdate) -> Iterator[str]:
    """IRIs of the search, looks and obstacles in `update`."""
    if update.search is not None:
        yield update.search.iri
    yield from (look.iri for look in update.looks)
    yield from (obstacle.iri for obstacle in update.obstacles)


class SearchRecords:
    """The searches that robots made on the map in `store`, with their looks and obstacles."""

    def __init__(self, store: TransactionalStore) -> None:
        self._store = store

    def all(self) -> tuple[SearchRecord, ...]:
        """All searches, oldest first."""
        engine = self._store.engine
        quads = engine.quads_for_pattern(None, v.RDF_TYPE, NamedNode(v.SEARCH), v.MAP_GRAPH)
        iris = sorted((text_of(quad.subject) for quad in quads), key=iri_order)
        return tuple(_search(iri, properties_of(engine, iri, v.MAP_GRAPH)) for iri in iris)

    def looks(self, search: str) -> tuple[LookRecord, ...]:
        """The looks of the search with IRI `search`, in their order."""
        parts = _parts(self._store.engine, search, v.LOOK)
        found = [_look(iri, search, properties) for iri, properties in parts]
        return tuple(sorted(found, key=lambda look: look.number))

    def obstacles(self, search: str) -> tuple[ObstacleRecord, ...]:
        """The obstacles that the search with IRI `search` met, in order."""
        parts = _parts(self._store.engine, search, v.OBSTACLE)
        found = [_obstacle(iri, search, properties) for iri, properties in parts]
        return tuple(sorted(found, key=lambda obstacle: obstacle.number))


def _of_search(record: SearchRecord) -> Iterator[_Fact]:
    what = f"search {record.iri}"
    if record.state not in _STATES:
        raise InvalidFactError(
            f"{what}: state must be one of {', '.join(_STATES)}, got {record.state}"
        )
    if not record.words or not record.categories:
        raise InvalidFactError(f"{what}: needs the words and categories that are searched for")
    if not 0 <= record.left <= 1:
        raise InvalidFactError(f"{what}: probability left must lie in 0..1, got {record.left}")
    yield v.RDF_TYPE.value, NamedNode(v.SEARCH)
    yield v.RDFS_LABEL, Literal(f"search for {' and '.join(record.words)}")
    yield v.SEARCH_STATE, Literal(record.state)
    yield v.SEARCH_SECONDS, number_literal(record.seconds, f"{what}: seconds", digits=1)
    yield v.PROBABILITY_LEFT, number_literal(record.left, f"{what}: probability left", digits=4)
    yield v.PROV_STARTED_AT, time_literal(record.started, what)
    if record.ended is not None:
        yield v.PROV_ENDED_AT, time_literal(record.ended, what)
    yield from ((v.SEARCH_WORDS, Literal(words)) for words in record.words)
    yield from ((v.SEARCHED_FOR, iri_node(iri, what)) for iri in record.categories)
    yield from ((v.FOUND, iri_node(iri, what)) for iri in record.found)


def _of_look(record: LookRecord) -> Iterator[_Fact]:
    what = f"look {record.iri}"
    yield v.RDF_TYPE.value, NamedNode(v.LOOK)
    yield from _part(record, what)
    yield v.HEADING, number_literal(record.heading, f"{what}: heading", digits=4)
    yield v.EXTENT, number_literal(record.extent, f"{what}: extent", digits=4)
    yield from ((v.SEARCHED_FOR, iri_node(iri, what)) for iri in record.categories)
    yield from ((v.FOUND, iri_node(iri, what)) for iri in record.found)
    if record.glimpses:
        numbers = [n for glimpse in record.glimpses for n in glimpse]
        if not all(map(math.isfinite, numbers)):
            raise InvalidFactError(f"{what}: glimpses must be finite numbers")
        yield v.GLIMPSES, Literal(" ".join(f"{n:.2f}" for n in numbers))


def _of_obstacle(record: ObstacleRecord) -> Iterator[_Fact]:
    what = f"obstacle {record.iri}"
    yield v.RDF_TYPE.value, NamedNode(v.OBSTACLE)
    yield from _part(record, what)
    yield v.REASON, Literal(record.reason)


def _part(record: LookRecord | ObstacleRecord, what: str) -> Iterator[_Fact]:
    yield v.PART_OF_SEARCH, iri_node(record.search, what)
    yield v.NUMBER, Literal(record.number)
    yield v.SOSA_RESULT_TIME, time_literal(record.stamp, what)
    for axis, value in zip((v.X, v.Y), record.position, strict=True):
        yield axis, number_literal(value, f"{what}: position", digits=2)


def _search(iri: str, properties: Properties) -> SearchRecord:
    ended = properties.get(v.PROV_ENDED_AT)
    state = first(properties, v.SEARCH_STATE, "running")
    return SearchRecord(
        iri=iri,
        words=tuple(sorted(properties.get(v.SEARCH_WORDS, ()))),
        categories=tuple(sorted(properties.get(v.SEARCHED_FOR, ()))),
        state=cast(SearchState, state if state in _STATES else "running"),
        started=stamp_of(properties, v.PROV_STARTED_AT),
        ended=seconds(min(ended)) if ended else None,
        seconds=float(first(properties, v.SEARCH_SECONDS, "0")),
        left=float(first(properties, v.PROBABILITY_LEFT, "1")),
        found=tuple(sorted(properties.get(v.FOUND, ()))),
    )


def _look(iri: str, search: str, properties: Properties) -> LookRecord:
    numbers = [float(n) for n in first(properties, v.GLIMPSES, "").split()]
    return LookRecord(
        iri=iri,
        search=search,
        number=int(first(properties, v.NUMBER, "0")),
        stamp=stamp_of(properties, v.SOSA_RESULT_TIME),
        position=_position(properties),
        heading=float(first(properties, v.HEADING, "0")),
        extent=float(first(properties, v.EXTENT, "0")),
        categories=tuple(sorted(properties.get(v.SEARCHED_FOR, ()))),
        found=tuple(sorted(properties.get(v.FOUND, ()))),
        glimpses=tuple(zip(numbers[::3], numbers[1::3], numbers[2::3], strict=True)),
    )


def _obstacle(iri: str, search: str, properties: Properties) -> ObstacleRecord:
    return ObstacleRecord(
        iri=iri,
        search=search,
        number=int(first(properties, v.NUMBER, "0")),
        stamp=stamp_of(properties, v.SOSA_RESULT_TIME),
        position=_position(properties),
        reason=first(properties, v.REASON, ""),
    )


def _parts(engine: QuadStore, search: str, kind: str) -> Iterator[tuple[str, Properties]]:
    for quad in engine.quads_for_pattern(None, _PART, NamedNode(search), v.MAP_GRAPH):
        iri = text_of(quad.subject)
        properties = properties_of(engine, iri, v.MAP_GRAPH)
        if kind in properties.get(v.RDF_TYPE.value, ()):
            yield iri, properties


def _position(properties: Properties) -> tuple[float, float]:
    return float(first(properties, v.X, "0")), float(first(properties, v.Y, "0"))
