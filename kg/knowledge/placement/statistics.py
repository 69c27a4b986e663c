"""Room statistics: how many rooms of a kind were searched, and how many held an object."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final
from urllib.parse import quote

from pyoxigraph import Literal, NamedNode, Quad

from kg.model import vocabulary as v
from kg.model.errors import OntologyError

_CLASS: Final = NamedNode(v.ROOM_STATISTICS)


@dataclass(frozen=True, slots=True, order=True)
class RoomStatistics:
    """Room statistics of one pair: of `rooms` rooms, `rooms_with` held the object."""

    source: str  # name of the data set
    place: str  # IRI of the kind of place
    object: str  # IRI of the kind of object
    rooms: int  # >= 1
    rooms_with: int  # 0..rooms
    license: str = ""  # IRI of the licence of the counts; "": unknown

    @property
    def iri(self) -> str:
        """The IRI of the node in graph:ontology."""
        return "/".join((v.STATISTICS + _name(self.source), _name(self.place), _name(self.object)))


def _name(text: str) -> str:
    return quote(text.removeprefix(v.HERE).removeprefix(v.ROOM_TYPE), safe="")


def statistics_quads(found: Iterable[RoomStatistics]) -> Iterator[Quad]:
    """Quads of graph:ontology for room statistics."""
    for one in found:
        node = NamedNode(one.iri)
        yield Quad(node, v.RDF_TYPE, _CLASS, v.ONTOLOGY_GRAPH)
        yield _quad(node, v.STATISTICS_OBJECT, NamedNode(one.object))
        yield _quad(node, v.STATISTICS_PLACE, NamedNode(one.place))
        yield _quad(node, v.ROOM_COUNT, Literal(one.rooms))
        yield _quad(node, v.ROOMS_WITH_OBJECT, Literal(one.rooms_with))
        yield _quad(node, v.DCT_SOURCE, Literal(one.source))
        if one.license:
            yield _quad(node, v.DCT_LICENSE, NamedNode(one.license))


def _quad(node: NamedNode, predicate: str, value: NamedNode | Literal) -> Quad:
    return Quad(node, NamedNode(predicate), value, v.ONTOLOGY_GRAPH)


def statistics(quads: Iterable[Quad]) -> tuple[RoomStatistics, ...]:
    """The statistics in an ontology's quads, sorted.

    Raises:
        OntologyError: a node lacks a part, or has more rooms with the object than rooms.
    """
    properties: dict[object, dict[str, str]] = defaultdict(dict)
    nodes: dict[object, None] = {}
    for q in quads:
        if q.predicate == v.RDF_TYPE and q.object == _CLASS:
            nodes[q.subject] = None
        elif isinstance(q.object, NamedNode | Literal) and q.predicate.value in _PARTS:
            properties[q.subject][q.predicate.value] = q.object.value
    return tuple(sorted(_statistics(node, properties[node]) for node in nodes))


_PARTS: Final = frozenset(
    {
        *(v.STATISTICS_OBJECT, v.STATISTICS_PLACE, v.ROOM_COUNT, v.ROOMS_WITH_OBJECT),
        *(v.DCT_SOURCE, v.DCT_LICENSE),
    }
)


def _statistics(node: object, properties: dict[str, str]) -> RoomStatistics:
    try:
        one = RoomStatistics(
            properties.get(v.DCT_SOURCE, "unknown"),
            properties[v.STATISTICS_PLACE],
            properties[v.STATISTICS_OBJECT],
            int(properties[v.ROOM_COUNT]),
            int(properties[v.ROOMS_WITH_OBJECT]),
            properties.get(v.DCT_LICENSE, ""),
        )
    except (KeyError, ValueError) as error:
        raise OntologyError(
            f"{node} needs a here:statisticsObject, a here:statisticsPlace, and integers "
            f"here:roomCount and here:roomsWithObject ({error})"
        ) from None
    if not 0 <= one.rooms_with <= one.rooms or one.rooms < 1:
        raise OntologyError(
            f"{node} needs 1 or more here:roomCount and no more here:roomsWithObject than that, "
            f"has {one.rooms} and {one.rooms_with}"
        )
    return one


def is_iri(text: str) -> bool:
    """Whether a text is an absolute IRI."""
    try:
        NamedNode(text)
    except ValueError:
        return False
    return ":" in text
