"""Searches, looks and obstacles: records to facts of graph:map, and back."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final, cast, get_args

from pyoxigraph import Literal, NamedNode, Quad

from kg.model import vocabulary as v
from kg.model.errors import InvalidFactError
from kg.model.records import LookRecord, ObstacleRecord, SearchRecord, SearchState
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

_Fact = tuple[str, NamedNode | Literal]


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
        return tuple(
            _look(part, found) for part, found in _parts(self._store.engine, search, v.LOOK)
        )

    def obstacles(self, search: str) -> tuple[ObstacleRecord, ...]:
        """The obstacles that the search with IRI `search` met, in order."""
        parts = _parts(self._store.engine, search, v.OBSTACLE)
        return tuple(
            ObstacleRecord(*part, reason=first(found, v.REASON, "")) for part, found in parts
        )


def facts_of_search(record: SearchRecord) -> list[Quad]:
    """Facts of a search; raises InvalidFactError for what is not finite or out of range."""
    return subject_quads(record.iri, _of_search(record))


def facts_of_look(record: LookRecord) -> list[Quad]:
    """Facts of a look; raises as `facts_of_search`."""
    return subject_quads(record.iri, _of_look(record))


def facts_of_obstacle(record: ObstacleRecord) -> list[Quad]:
    """Facts of an obstacle; raises as `facts_of_search`."""
    return subject_quads(record.iri, _of_obstacle(record))


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


#: IRI, IRI of the search, number, time [s] and position (x, y) [m]
_Part = tuple[str, str, int, float, tuple[float, float]]


def _parts(engine: QuadStore, search: str, kind: str) -> list[tuple[_Part, Properties]]:
    """What looks and obstacles of a search have in common, and their properties, by number."""
    found = []
    for quad in engine.quads_for_pattern(None, _PART, NamedNode(search), v.MAP_GRAPH):
        iri = text_of(quad.subject)
        properties = properties_of(engine, iri, v.MAP_GRAPH)
        if kind in properties.get(v.RDF_TYPE.value, ()):
            number = int(first(properties, v.NUMBER, "0"))
            position = float(first(properties, v.X, "0")), float(first(properties, v.Y, "0"))
            stamp = stamp_of(properties, v.SOSA_RESULT_TIME)
            found.append(((iri, search, number, stamp, position), properties))
    return sorted(found, key=lambda one: one[0][2])


def _look(part: _Part, properties: Properties) -> LookRecord:
    numbers = [float(n) for n in first(properties, v.GLIMPSES, "").split()]
    return LookRecord(
        *part,
        heading=float(first(properties, v.HEADING, "0")),
        extent=float(first(properties, v.EXTENT, "0")),
        categories=tuple(sorted(properties.get(v.SEARCHED_FOR, ()))),
        found=tuple(sorted(properties.get(v.FOUND, ()))),
        glimpses=tuple(zip(numbers[::3], numbers[1::3], numbers[2::3], strict=True)),
    )
