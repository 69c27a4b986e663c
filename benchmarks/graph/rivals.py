"""The same facts and questions in bare pyoxigraph, plain rdflib and owlready2's SQLite store.

Facts alone, without named graphs, since owlready2 has none; questions that all can parse. Writing
happens as each library wants it: triple by triple, then a save where the store is on disk.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import count
from pathlib import Path

import owlready2
import rdflib
from pyoxigraph import DefaultGraph, NamedNode, Quad, RdfFormat, Store, serialize

from benchmarks.graph.building import Building
from benchmarks.graph.ours import STORE
from benchmarks.graph.timing import Timing, goes_on, measured, timing
from kg.maps.facts.objects_and_places import RecordCodec
from kg.maps.query.evaluation import evaluate
from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.records import MapUpdate
from kg.rdf.literals import cell_of
from kg.rdf.shacl import as_rdflib
from kg.rdf.sparql.lexer import substitute

CHANGING = {v.X, v.Y, v.Z, v.IN_CELL, v.CONFIDENCE, v.EXISTENCE, v.OBSERVATION_COUNT, v.LAST_SEEN}
RAW = "pyoxigraph on disk"
_HERE = Path(__file__).parent


def questions(building: Building, semantic_map: SemanticMap) -> dict[str, str]:
    """operation -> SPARQL, prefixes spelt out, that every store here can parse."""
    cup = NamedNode(semantic_map.catalogue.find("cup").iri)
    cell = NamedNode(cell_of(*building.centre()))
    return {
        "a class": substitute((_HERE / "class.rq").read_text("utf-8"), {"category": cup}),
        "a cell": substitute((_HERE / "cell.rq").read_text("utf-8"), {"cell": cell}),
    }


def ours(semantic_map: SemanticMap, building: Building) -> Iterator[Timing]:
    """The three questions on the map itself."""
    for operation, sparql in questions(building, semantic_map).items():
        run = _counting(lambda text=sparql: evaluate(semantic_map.engine, text).rows)  # type: ignore[misc]
        yield measured(operation, STORE, building.size, run)


def raw_pyoxigraph(semantic_map: SemanticMap, building: Building, folder: Path) -> Iterator[Timing]:
    """The store below a map without the map: no history, checks, types or graphs."""
    store, name = Store(str(folder / f"raw-{building.size}")), RAW
    store.bulk_extend(Quad(*quad.triple) for quad in _facts(semantic_map))
    for operation, sparql in questions(building, semantic_map).items():
        run = _counting(lambda text=sparql: store.query(text))  # type: ignore[misc]
        yield measured(operation, name, building.size, run)
    yield _same_quads(semantic_map, building, folder)
    out, form = folder / "raw.nt", RdfFormat.N_TRIPLES
    dump = partial(store.dump, str(out), form, from_graph=DefaultGraph())
    yield measured("export as N-Triples", name, building.size, lambda: _none(dump()))


def _same_quads(semantic_map: SemanticMap, building: Building, folder: Path) -> Timing:
    """Timing of the quads that the map itself removes and adds for a frame, in their graphs."""
    store, durations = Store(str(folder / f"raw-graphs-{building.size}")), list[float]()
    store.bulk_extend(semantic_map.engine.quads_for_pattern(None, None, None))
    with semantic_map.store.watched() as changes:
        while goes_on(durations):
            semantic_map.apply(building.frame(len(durations)))
            start = time.process_time()
            for quad in changes[-1].removed:
                store.remove(quad)
            for quad in changes[-1].added:
                store.add(quad)
            durations.append(1000 * (time.process_time() - start))
    return timing("update by a frame", RAW, building.size, durations)


def rdflib_memory(semantic_map: SemanticMap, building: Building, folder: Path) -> Iterator[Timing]:
    """Plain rdflib, in memory, with its own SPARQL engine."""
    graph = rdflib.Graph()
    for quad in _facts(semantic_map):
        graph.add(_triple(quad))
    for operation, sparql in questions(building, semantic_map).items():
        run = _counting(lambda text=sparql: graph.query(text))  # type: ignore[misc]
        yield measured(operation, "rdflib in memory", building.size, run)
    yield from _measure("rdflib in memory", graph, semantic_map, building)
    out = str(folder / "rdflib.nt")
    yield measured(
        "export as N-Triples",
        "rdflib in memory",
        building.size,
        lambda: _none(graph.serialize(out, format="nt", encoding="utf-8")),
    )


def owlready_sqlite(
    semantic_map: SemanticMap, building: Building, folder: Path
) -> Iterator[Timing]:
    """owlready2's quad store in an SQLite file, with its own SPARQL engine."""
    store, source = "owlready2 on disk", folder / "facts.nt"
    triples = (quad.triple for quad in _facts(semantic_map))
    source.write_bytes(serialize(triples, format=RdfFormat.N_TRIPLES) or b"")
    world = owlready2.World(filename=str(folder / f"owlready-{building.size}.sqlite3"))
    try:
        ontology = world.get_ontology("https://example.org/facts#")
        with source.open("rb") as facts:
            ontology.load(fileobj=facts, only_local=True)
        world.save()
        for operation, sparql in questions(building, semantic_map).items():
            run = _counting(lambda text=sparql: world.sparql(text))  # type: ignore[misc]
            yield measured(operation, store, building.size, run)
        graph = world.as_rdflib_graph()
        with ontology:
            yield from _measure(
                store, graph.get_context(ontology), semantic_map, building, world.save
            )
        out = str(folder / "owlready.nt")
        yield measured(
            "export as N-Triples",
            store,
            building.size,
            lambda: _none(ontology.save(out, format="ntriples")),
        )
    finally:
        world.close()


def _measure(
    store: str,
    graph: rdflib.Graph,
    semantic_map: SemanticMap,
    building: Building,
    save: Callable[[], object] = lambda: None,
) -> Iterator[Timing]:
    facts = RecordCodec(semantic_map.base, semantic_map.catalogue)
    frames = count()

    def update() -> None:
        for quad in _changing(facts, building.frame(next(frames))):
            subject, predicate, value = _triple(quad)
            graph.remove((subject, predicate, None))
            graph.add((subject, predicate, value))
        save()

    yield measured("update by a frame", store, building.size, update)


def _changing(facts: RecordCodec, update: MapUpdate) -> Iterator[Quad]:
    """Facts of a frame's objects that change with it."""
    for record in update.objects:
        for quad in facts.of_object(record):
            if quad.predicate.value in CHANGING and quad.subject == NamedNode(record.iri):
                yield quad


def _facts(semantic_map: SemanticMap) -> Iterator[Quad]:
    return semantic_map.engine.quads_for_pattern(None, None, None, v.MAP_GRAPH)


def _triple(quad: Quad) -> tuple[rdflib.term.Node, rdflib.term.Node, rdflib.term.Node]:
    return as_rdflib(quad.subject), as_rdflib(quad.predicate), as_rdflib(quad.object)


def _counting(run: Callable[[], object]) -> Callable[[], int]:
    return lambda: len(list(run()))  # type: ignore[call-overload]


def _none(_: object) -> None:
    return None
