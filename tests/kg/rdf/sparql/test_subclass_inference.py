"""A class in a query stands for its subclasses, wherever a map is queried."""

from __future__ import annotations

import queue
from collections.abc import Iterator

import numpy as np
import pytest

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import QueryError
from kg.model.records import MapUpdate, ObjectRecord, PlaceRecord
from kg.rdf.sparql.subclass_inference import superclasses_of, with_subclasses
from kg.serving.opening import in_memory_map
from kg.serving.workers.limited_queries import LimitedQueries

BASE = "https://example.org/flat/"
APPLE, CAT = f"{BASE}object/1", f"{BASE}object/2"
PATTERNS = {
    "?o a here:Object": {APPLE, CAT},
    "?o a here:Food": {APPLE},
    "?o a here:Apple": {APPLE},
    "?o here:z 1.0e0 ; rdf:type here:Animal ; here:x ?x": {CAT},
    "?o a <https://w3id.org/hereabouts#Food>": {APPLE},
    "?o a # a comment\n here:Food": {APPLE},
    "?o a here:Object , here:Food": {APPLE},
    "?o a here:Apple , here:Object , here:Food": {APPLE},
    "?o a here:Food , here:Animal": set(),
    "?o a ?kind1 . FILTER(?kind1 = here:Apple) GRAPH graph:map { ?o a here:Food }": {APPLE},
    "GRAPH graph:map { ?o a here:Object ; here:x ?x }": {APPLE, CAT},
    "GRAPH ?g { ?o a here:Object , here:Animal ; here:x ?x }": {CAT},
    "?o a here:Object FILTER NOT EXISTS { ?o a here:Food }": {CAT},
    "?o here:x ?x MINUS { ?o a here:Animal } FILTER EXISTS { ?o a here:Object }": {APPLE},
    "{ SELECT ?o { ?o a here:Food } }": {APPLE},
    "{ ?o a here:Food } UNION { ?o a here:Animal }": {APPLE, CAT},
    "?o a/rdfs:subClassOf* here:Food": {APPLE},
    "?o here:x ?x ; a ?c . ?c rdfs:subClassOf* here:Food": {APPLE},
    '?o rdfs:label "x a here:Object"': set(),
    "?o a here:Place": {f"{BASE}place/1"},
    "?o a bot:Space": {f"{BASE}place/1"},
}


@pytest.fixture(scope="module")
def flat() -> Iterator[SemanticMap]:
    """An apple and a cat in a kitchen."""
    with in_memory_map(base=BASE) as flat:
        objects = [
            ObjectRecord(iri, flat.catalogue.find(label).iri, np.ones(3), 1.0, 0.8, 1, 0.0, 1e9)
            for iri, label in ((APPLE, "apple"), (CAT, "cat"))
        ]
        kitchen = flat.catalogue.find("kitchen", "place").iri
        place = PlaceRecord(f"{BASE}place/1", "room", 0, 4, -3, 4.5, 3, {kitchen: 0.8})
        flat.apply(MapUpdate(objects=tuple(objects), places=(place,)))
        yield flat


@pytest.mark.parametrize("pattern", PATTERNS)
def test_each_thing_answers_once(flat: SemanticMap, pattern: str) -> None:
    rows = flat.query(f"SELECT ?o WHERE {{ {pattern} }}").rows
    assert sorted(str(row[0]) for row in rows) == sorted(PATTERNS[pattern])


def test_isolated_workers_answer_alike(flat: SemanticMap) -> None:
    with LimitedQueries(flat, seconds=60.0) as limited:
        for pattern, things in PATTERNS.items():
            rows = limited.ask(f"SELECT ?o WHERE {{ {pattern} }}").rows
            assert {row[0] for row in rows} == things, pattern


@pytest.mark.parametrize(
    ("query", "triples"),
    [
        ("CONSTRUCT WHERE { ?o a here:Food }", {"Food"}),
        ("CONSTRUCT { ?o a here:Object } WHERE { ?o a here:Food }", {"Object"}),
        (
            "PREFIX h: <https://w3id.org/hereabouts#> CONSTRUCT { ?o a ?c } { ?o a h:Food, ?c }",
            {"Apple"},
        ),
    ],
)
def test_a_template_is_written_as_it_stands(
    flat: SemanticMap, query: str, triples: set[str]
) -> None:
    rows = flat.query(query).rows
    assert {row[0] for row in rows} == {APPLE}
    assert {str(row[2]).rpartition("#")[2] for row in rows} == triples


@pytest.mark.parametrize(
    "query",
    [
        "SELECT ?o { ?o a here:Apple }",
        "SELECT ?o { ?o a here:Place , bot:Space }",
        "SELECT ?o ?c { ?o a ?c . ?c here:isA here:Food }",
        "SELECT ?o FROM graph:map { ?o a here:Food }",
        "SELECT ?o { SERVICE <urn:x> { ?o a here:Food } }",
        "SELECT ?o { ?o ^a here:Food }",
        "SELECT ?o { ?o a/rdfs:subClassOf* here:Food }",
    ],
)
def test_what_needs_no_inference_is_left_as_it_is(flat: SemanticMap, query: str) -> None:
    assert with_subclasses(query, superclasses_of(flat.engine)) == query


def test_what_does_not_parse_is_reported_where_it_stands(flat: SemanticMap) -> None:
    query = "SELECT ?o { ?o a here:Food ; here:x ?x . ! }"
    with pytest.raises(QueryError, match="line 1, column 45"):
        flat.query(query)


def test_an_update_changes_what_its_pattern_states(flat: SemanticMap) -> None:
    """A class of an update is the stated one: no update reaches more than it names."""
    assert flat.update("DELETE { ?o here:z 1.0e0 } WHERE { ?o a here:Food }", by="ann") is None


def test_a_subscription_reports_subclasses(flat: SemanticMap) -> None:
    added: queue.SimpleQueue[set[object]] = queue.SimpleQueue()
    stop = flat.subscriptions.on(
        "SELECT ?o { ?o a here:Electronics }",
        lambda new, _: added.put({row[0] for row in new.rows}),
    )
    laptop = ObjectRecord(
        f"{BASE}object/3", flat.catalogue.find("laptop").iri, np.ones(3), 1.0, 0.8, 1, 0.0, 1e9
    )
    flat.apply(MapUpdate(objects=(laptop,)))
    assert added.get(timeout=120) == {laptop.iri}
    stop()
    flat.apply(MapUpdate(removed=(laptop.iri,)))
