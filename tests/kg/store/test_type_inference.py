"""Inferred types: every form of a query, states of the past, changes of the ontology, old maps."""

import queue
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import rdflib
from pyoxigraph import Quad, Store

from kg.maps.semantic_map import SemanticMap
from kg.maps.stored_map import StoredMap
from kg.model import vocabulary as v
from kg.model.errors import OntologyError, ProtectedError
from kg.model.records import MapUpdate, ObjectRecord, PlaceRecord
from kg.serving.opening import create_map, in_memory_map, open_map
from kg.serving.workers.local_evaluation import LimitedQueries

BASE = "https://example.org/flat/"
APPLE, CAT = f"{BASE}object/1", f"{BASE}object/2"
PATTERNS = {
    "?o a here:Object": {APPLE, CAT},
    "?o a here:Food": {APPLE},
    "?o a here:Apple": {APPLE},
    "?o here:z 1.0e0 ; rdf:type here:Animal ; here:x ?x": {CAT},
    "?o a here:Apple , here:Object , here:Food": {APPLE},
    "?o a here:Food , here:Animal": set(),
    "VALUES ?c { here:Food } ?o a ?c": {APPLE},
    "BIND(here:Food AS ?c) ?o a ?c": {APPLE},
    "?o a ?c FILTER(?c = here:Food)": {APPLE},
    "?o ?p here:Food FILTER(?p = rdf:type)": {APPLE},
    "here:Food ^a ?o": {APPLE},
    "?o (a|rdf:type) here:Animal": {CAT},
    "GRAPH ?g { ?o a here:Food }": {APPLE},
    "GRAPH graph:inferred { ?o a here:Food }": {APPLE},
    "GRAPH graph:map { ?o a here:Food }": set(),
    "GRAPH graph:map { ?o a ?c } ?c here:isA here:Food": {APPLE},
    "?o a here:Object FILTER NOT EXISTS { ?o a here:Food }": {CAT},
    "?o here:x ?x MINUS { ?o a here:Animal } FILTER EXISTS { ?o a here:Object }": {APPLE},
    "{ SELECT ?o { ?o a ?c ; here:z ?z } GROUP BY ?o HAVING(COUNT(*) = 3) }": {APPLE, CAT},
    "?o a here:Place": {f"{BASE}place/1"},
    "?o a bot:Space": {f"{BASE}place/1"},
}


def thing(semantic_map: SemanticMap, iri: str, label: str) -> ObjectRecord:
    category = semantic_map.catalogue.find(label).iri
    return ObjectRecord(iri, category, np.ones(3), 1.0, 0.8, 1, 0.0, 1e9)


def furnish(flat: SemanticMap) -> None:
    """An apple and a cat in a kitchen."""
    kitchen = flat.catalogue.find("kitchen", "place").iri
    place = PlaceRecord(f"{BASE}place/1", "room", 0, 4, -3, 4.5, 3, {kitchen: 0.8})
    things = thing(flat, APPLE, "apple"), thing(flat, CAT, "cat")
    flat.apply(MapUpdate(objects=things, places=(place,)))


@pytest.fixture
def flat() -> Iterator[StoredMap]:
    with in_memory_map(base=BASE) as made:
        furnish(made)
        yield made


def found(semantic_map: SemanticMap, pattern: str) -> set[str]:
    return {str(row[0]) for row in semantic_map.query(f"SELECT ?o WHERE {{ {pattern} }}").rows}


def inferred(semantic_map: SemanticMap) -> set[tuple[str, str]]:
    quads = semantic_map.engine.quads_for_pattern(None, None, None, v.INFERRED_GRAPH)
    return {(str(q.subject)[1:-1], str(q.object)[1:-1].rpartition("#")[2]) for q in quads}


def test_a_superclass_is_found_in_every_spelling(flat: StoredMap) -> None:
    for pattern, things in PATTERNS.items():
        rows = flat.query(f"SELECT ?o WHERE {{ {pattern} }}").rows
        assert {row[0] for row in rows} == things, pattern
        if "|" not in pattern:
            assert len(rows) == len(things), "each thing answers once"


def test_rdflib_binds_a_class_whatever_is_selected(flat: StoredMap) -> None:
    bindings = {"c": rdflib.URIRef(v.HERE + "Food")}
    for columns in ("?o", "?o ?c", "*"):
        rows = flat.dataset.query(f"SELECT {columns} {{ ?o a ?c }}", initBindings=bindings)
        assert {str(row["o"]) for row in rows} == {APPLE}  # type: ignore[index, call-overload]


def test_isolated_workers_answer_alike(flat: StoredMap) -> None:
    with LimitedQueries(flat, seconds=60.0) as limited:
        for pattern, things in PATTERNS.items():
            rows = limited.ask(f"SELECT ?o WHERE {{ {pattern} }}").rows
            assert {row[0] for row in rows} == things, pattern


def test_types_follow_the_class_and_the_existence_of_a_thing(flat: StoredMap) -> None:
    flat.assertions.add(APPLE, "category", "cup", by="ann")
    assert inferred(flat) & {(APPLE, "Food"), (APPLE, "Object")} == {(APPLE, "Object")}
    flat.assertions.retract(APPLE, "category")
    assert (APPLE, "Food") in inferred(flat)
    flat.apply(MapUpdate(removed=(APPLE,)))
    assert not {one for one in inferred(flat) if one[0] == APPLE}


def test_types_follow_the_ontology_and_a_past_state_has_those_of_its_time(flat: StoredMap) -> None:
    before = flat.sequence
    under = "here:Apple rdfs:subClassOf here:Electronics"
    flat.update(f"INSERT DATA {{ GRAPH graph:ontology {{ {under} }} }}", allow=("ontology",))
    assert found(flat, "?o a here:Electronics") == {APPLE}
    flat.update(
        "DELETE DATA { GRAPH graph:ontology { here:Apple rdfs:subClassOf here:Food } }",
        allow=("ontology",),
    )
    assert found(flat, "?o a here:Food") == set()
    with flat.at(f"#{before}") as then:
        assert found(then, "?o a here:Food") == {APPLE}
        assert found(then, "?o a here:Electronics") == set()
    flat.restore(f"#{before}", confirmed=True)
    assert found(flat, "?o a here:Food") == {APPLE}
    assert found(flat, "?o a here:Electronics") == set()


def test_the_history_records_no_inferred_type(flat: StoredMap) -> None:
    log = flat.history.log
    recorded = b"\n".join(log.facts(log.last))
    assert b"Apple" in recorded
    assert v.INFERRED_GRAPH.value.encode() not in recorded
    for change in flat.history.changes(0):
        assert v.INFERRED_GRAPH not in {q.graph_name for q in (*change.added, *change.removed)}


def test_a_class_is_no_individual(flat: StoredMap) -> None:
    flat.update(
        "INSERT DATA { GRAPH graph:ontology { here:Apple a here:Chair } }", allow=("ontology",)
    )
    assert found(flat, "?o a here:Object") == {APPLE, CAT}


def test_a_class_of_very_many_superclasses_is_refused(flat: StoredMap) -> None:
    above = " , ".join(f"<urn:c:{n}>" for n in range(120))
    update = f"INSERT DATA {{ GRAPH graph:ontology {{ here:Apple rdfs:subClassOf {above} }} }}"
    with pytest.raises(OntologyError, match="100 superclasses a class"):
        flat.update(update, allow=("ontology",))


UPDATES = {
    "DELETE DATA { <object/1> a here:Food }": "since it is here:Apple",
    "DELETE DATA { GRAPH graph:inferred { <object/1> a here:Food } }": "since it is here:Apple",
    "CLEAR GRAPH graph:inferred": "is inferred to be",
    "INSERT DATA { GRAPH graph:inferred { <object/2> a here:Food } }": "state here:Food",
}


def test_inferred_types_cannot_be_written(flat: StoredMap) -> None:
    before, types = flat.sequence, inferred(flat)
    for text, message in UPDATES.items():
        with pytest.raises(ProtectedError, match=message):
            flat.update(text, by="ann", confirmed=True)
    assert (flat.sequence, inferred(flat)) == (before, types)


WHOLE = {
    "DELETE WHERE { GRAPH ?g { <object/1> ?p ?o } }": set[str](),
    "DELETE { <object/1> ?p ?o } WHERE { <object/1> ?p ?o }": set[str](),
    "DELETE { ?o a ?c } INSERT { ?o a here:Cup } WHERE { ?o a ?c FILTER(?o = <object/1>) }": {
        "Object"
    },
}


@pytest.mark.parametrize("text", WHOLE)
def test_a_thing_that_changes_takes_its_inferred_types_along(flat: StoredMap, text: str) -> None:
    flat.update(text, by="ann")
    assert {kind for iri, kind in inferred(flat) if iri == APPLE} == WHOLE[text]


def test_a_later_operation_of_an_update_sees_the_types_of_an_earlier_one(flat: StoredMap) -> None:
    flat.update(
        "DELETE DATA { <object/2> a here:Cat } ; INSERT DATA { <object/2> a here:Banana } ; "
        "INSERT { ?o <urn:edible> true } WHERE { ?o a here:Food }",
        by="ann",
    )
    assert found(flat, "?o <urn:edible> true") == {APPLE, CAT}


def test_a_subscription_reports_subclasses(flat: StoredMap) -> None:
    added: queue.SimpleQueue[set[object]] = queue.SimpleQueue()
    stop = flat.subscriptions.on(
        "SELECT ?o { VALUES ?c { here:Electronics } ?o a ?c }",
        lambda new, _: added.put({row[0] for row in new.rows}),
    )
    laptop = thing(flat, f"{BASE}object/3", "laptop")
    flat.apply(MapUpdate(objects=(laptop,)))
    assert added.get(timeout=120) == {laptop.iri}
    stop()


def test_an_ontology_is_inferred_from_even_where_individuals_are_in_it(flat: StoredMap) -> None:
    mug = "<urn:mug> a owl:NamedIndividual , here:Cup"
    flat.update(f"INSERT DATA {{ GRAPH graph:ontology {{ {mug} }} }}", allow=("ontology",))
    assert found(flat, "?o a here:Object") == {APPLE, CAT, "urn:mug"}


def test_a_reloaded_class_that_is_an_individual_too_is_no_thing(flat: StoredMap) -> None:
    text = (
        "PREFIX ex: <urn:k:> INSERT DATA { ex:K a owl:Class , here:Food ; "
        'rdfs:subClassOf here:Food , here:Object ; rdfs:label "kumquat" ; rdfs:comment "One." }'
    )
    store = Store()
    store.update(text, prefixes=v.PREFIXES)
    added = [Quad(q.subject, q.predicate, q.object, v.ONTOLOGY_GRAPH) for q in store]
    flat.ontology.replace((*flat.ontology.quads(), *added))
    assert flat.catalogue.find("kumquat").iri == "urn:k:K"
    assert found(flat, "?o a here:Food") == {APPLE}


def test_an_inferred_type_is_explained_by_the_class(flat: StoredMap) -> None:
    (reason,) = flat.history.explain("object/1 a here:Food")
    assert reason.because[0].kind == "rule"
    assert reason.because[1].text.endswith(" is an apple")


@pytest.fixture
def old(tmp_path: Path) -> Path:
    """A map as an earlier version wrote it: without inferred types."""
    with create_map(tmp_path / "old.map", base=BASE) as made:
        furnish(made)
    store = Store(str(tmp_path / "old.map" / "store"))
    store.remove_graph(v.INFERRED_GRAPH)
    store.flush()
    del store
    return tmp_path / "old.map"


def test_an_old_map_answers_right_to_a_reader_and_is_not_written(old: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in old.rglob("*") if path.is_file()}
    with open_map(old, read_only=True) as reader:
        assert found(reader, "VALUES ?c { here:Food } ?o a ?c") == {APPLE}
        with LimitedQueries(reader, seconds=60.0) as limited:
            assert len(limited.ask("SELECT ?o { ?o a here:Food }").rows) == 1
        assert reader.sequence == 1
    after = {path: path.stat().st_mtime_ns for path in old.rglob("*") if path.is_file()}
    data = {path for path in before if path.suffix in (".sst", ".log", ".sqlite")}
    assert {path: after.get(path) for path in data} == {path: before[path] for path in data}


def test_an_old_map_is_completed_by_its_writer_without_a_transaction(old: Path) -> None:
    with open_map(old) as writer:
        assert found(writer, "?o a here:Food") == {APPLE}
        assert writer.sequence == 1
    with open_map(old, read_only=True) as reader:
        assert reader.store.on_disk
        assert found(reader, "?o a here:Food") == {APPLE}
