"""Maps made up of many objects, a writer beside readers, and percentiles of times."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

import numpy as np
from pyoxigraph import Literal, NamedNode, Quad

from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.transactions import Cause

RUNAWAY: Final = "SELECT (SUM(STRLEN(STR(?a))) AS ?n) {?a ?b ?c. ?d ?e ?f. ?g ?h ?i}"
ASK: Final = "ASK {here:Kitchen here:isA here:Place}"
_RATE: Final = 30.0  # commits a second of a writer


def fill(semantic_map: SemanticMap, objects: int) -> None:
    """Load so many objects of 15 triples each."""
    semantic_map.engine.bulk_extend(_objects(objects))  # type: ignore[attr-defined]
    semantic_map.store.flush()


def _objects(count: int) -> Iterator[Quad]:
    kinds = [NamedNode(v.HERE + name) for name in ("Chair", "Cup", "Book", "Laptop")]
    generator = np.random.default_rng(1)
    for number in range(count):
        thing = NamedNode(f"urn:object:{number}")
        yield Quad(thing, v.RDF_TYPE, kinds[number % len(kinds)], v.MAP_GRAPH)
        for name, value in zip("xyzabcdefghijk", generator.random(14), strict=True):
            yield Quad(thing, NamedNode(v.HERE + name), Literal(float(value)), v.MAP_GRAPH)


def commit(semantic_map: SemanticMap, number: int) -> None:
    """Write one fact of an object."""
    quad = Quad(
        NamedNode(f"urn:object:{number % 20}"), NamedNode(v.X), Literal(number / 7), v.MAP_GRAPH
    )
    semantic_map.store.commit([], [quad], Cause("update"))


@contextmanager
def writer(semantic_map: SemanticMap) -> Iterator[tuple[list[float], dict[int, float]]]:
    """30 commits a second meanwhile; gives their durations [s], and sequence -> moment [s]."""
    spent, moments, stop = list[float](), dict[int, float](), threading.Event()

    def write() -> None:
        while not stop.wait(1 / _RATE):
            spent.append(seconds(lambda: commit(semantic_map, 1000 + len(spent))))
            moments[semantic_map.sequence] = time.monotonic()

    thread = threading.Thread(target=write)
    thread.start()
    try:
        yield spent, moments
    finally:
        stop.set()
        thread.join()


def seconds(act: Callable[[], object]) -> float:
    """The time that an act takes [s]."""
    begun = time.perf_counter()
    act()
    return time.perf_counter() - begun


def milliseconds(times: list[float], *percentiles: int) -> list[float]:
    """Percentiles of times [s], in milliseconds."""
    return [float(p) for p in np.percentile(times, percentiles) * 1000]
