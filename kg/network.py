"""A map as a networkx graph: who stands where, and who stands beside whom."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator

import networkx as nx

from kg.categories import Catalogue
from kg.characters import shown
from kg.records import ObjectRecord, PlaceRecord


def network(
    objects: Iterable[ObjectRecord],
    places: Iterable[PlaceRecord],
    catalogue: Catalogue,
    near: float,
) -> nx.Graph[str]:
    """Nodes are IRIs of objects and places; edges say ``relation``: "in", or "near".

    Nodes carry ``kind`` ("object" or "place"), ``label`` (category, or name of the place), x and y
    [m]; an object its existence, a near edge its ``distance`` [m], at most `near`.
    """
    objects = tuple(objects)
    graph: nx.Graph[str] = nx.Graph()
    for place in places:
        middle = {"x": (place.xmin + place.xmax) / 2, "y": (place.ymin + place.ymax) / 2}
        graph.add_node(place.iri, kind="place", label=shown(place.label), **middle)
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
    """Pairs of objects within `near` [m] over the floor; only neighbouring squares are compared."""
    squares: dict[tuple[int, int], list[ObjectRecord]] = defaultdict(list)
    for record in objects:
        x, y = math.floor(record.p_map[0] / near), math.floor(record.p_map[1] / near)
        around = [(x + i, y + j) for i in (-1, 0, 1) for j in (-1, 0, 1)]
        for other in (other for square in around for other in squares.get(square, ())):
            distance = float(math.dist(record.p_map[:2], other.p_map[:2]))
            if distance <= near:
                yield other.iri, record.iri, distance
        squares[x, y].append(record)
