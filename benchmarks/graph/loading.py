"""A furnished map of any size on disk, loaded as a whole instead of through its writer."""

from __future__ import annotations

from itertools import islice
from pathlib import Path
from typing import Final

from pyoxigraph import Literal, NamedNode, Quad

from benchmarks.graph.building import BASE, Building
from kg.history.storage.maintenance import FILE
from kg.maps.facts.objects_and_places import RecordCodec
from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.serving.opening import create_map, open_map
from kg.store.transactional import TransactionalStore

PIECE: Final = 200_000  # quads loaded at once; the engine holds them in memory several times over


def furnished(path: Path, size: int, seed: int = 0) -> tuple[SemanticMap, Building]:
    """A new map at `path` of a building of `size` objects, open for writing, and that building.

    It says what `Building.furnish` makes a map say, but for the number of transactions: the history
    begins with all of it.
    """
    with create_map(path, base=BASE) as semantic_map:
        catalogue = semantic_map.catalogue
    (path / FILE).unlink()
    building = Building(size, catalogue, seed)
    with TransactionalStore.open(path) as store:
        quads = building.quads(RecordCodec(BASE, catalogue))
        while piece := tuple(islice(quads, PIECE)):
            store.native.bulk_extend(piece)
        _count_up(store, size + 1)
        store.native.optimize()
    return open_map(path), building


def _count_up(store: TransactionalStore, number: int) -> None:
    graph, base = v.DATASET_GRAPH, NamedNode(BASE)
    predicate = NamedNode(v.NEXT_OBJECT)
    for quad in tuple(store.engine.quads_for_pattern(base, predicate, None, graph)):
        store.native.remove(quad)
    store.native.add(Quad(base, predicate, Literal(number), graph))
