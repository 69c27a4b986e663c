"""A networkx graph of a map: objects, their places, and their neighbours."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from kg.knowledge.ontology.catalogue import Catalogue
from kg.model.records import ObjectRecord, PlaceRecord
from kg.rdf.literals import shown

if TYPE_CHECKING:
    import networkx as nx


def network(
    objects: Iterable[ObjectRecord],
    places: Iterable[PlaceRecord],
    catalogue: Catalogue,
    near: float,
) -> nx.Graph[str]:
    """Nodes are IRIs of objects and places; edges carry ``relation``: "in" or "near".

    Nodes carry ``kind`` ("object" or "place"), ``label`` (category, or name of the place), x and y
    [m]; an object its existence, a near edge its ``distance`` [m], at most `near`.
    """
    import networkx as nx  # takes longer to import than most commands take

    objects = tuple(objects)
    graph: nx.Graph[str] = nx.Graph()
    for place in places:
        x, y = place.area.centre
        graph.add_node(place.iri, kind="place", label=shown(place.label), x=x, y=y)
    for record in objects:
        x, y = float(record.p_map[0]), float(record.p_map[1])
        label = shown(catalogue.label(record.category))
        graph.add_node(record.iri, kind="object", label=label, x=x, y=y, existence=record.existence)
        if record.place is not None and record.place in graph:
            graph.add_edge(record.iri, record.place, relation="in")
    for one, other, distance in _pairs(objects, near):
        graph.add_edge(one, other, relation="near", distance=distance)
    return graph


def _pairs(objects: tuple[ObjectRecord, ...], near: float) -> Iterator[tuple[str, str, float]]:
    """Pairs of objects within `near` [m] over the floor, found by squares of that side."""
    squares: dict[tuple[int, int], list[ObjectRecord]] = defaultdict(list)
    for record in objects:
        x, y = math.floor(record.p_map[0] / near), math.floor(record.p_map[1] / near)
        around = [(x + i, y + j) for i in (-1, 0, 1) for j in (-1, 0, 1)]
        for other in (other for square in around for other in squares.get(square, ())):
            distance = float(math.dist(record.p_map[:2], other.p_map[:2]))
            if distance <= near:
                yield other.iri, record.iri, distance
        squares[x, y].append(record)
