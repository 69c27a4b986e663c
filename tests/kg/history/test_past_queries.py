"""Queries of a past state return what they returned when that state was the present one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import pytest
from pyoxigraph import NamedNode, QueryBoolean, Store

from kg.history.replay.point_in_time import PastStates
from kg.history.storage.recovery import attach
from kg.maps.query.query_files import shipped_queries
from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.records import MapUpdate
from kg.model.transactions import Cause
from kg.rdf.sparql.extension_functions import square_root
from kg.serving.opening import create_map
from kg.store.transactional import TransactionalStore

MOMENTS = (0, 21, 23)

SHAPES = (
    "ASK {}",
    "SELECT * {}",
    "SELECT * { ?s ?p ?o }",
    "SELECT ?x { <object/1> here:x ?x }",
    "SELECT ?p ?o { <object/1> ?p ?o }",
    "SELECT ?s ?p { ?s ?p <object/1> }",
    "SELECT ?s ?p { ?s ?p here:Chair }",
    "SELECT ?g (COUNT(*) AS ?n) { GRAPH ?g { ?s ?p ?o } } GROUP BY ?g",
    "SELECT ?g { GRAPH ?g {} }",
    "SELECT ?g { GRAPH ?g { OPTIONAL { ?s here:x ?x } } }",
    "SELECT ?g { GRAPH ?g { SELECT (COUNT(*) AS ?n) { ?s here:x ?x } } }",
    "SELECT ?g { GRAPH ?g { ?s here:x ?x } }",
    "SELECT ?g { GRAPH ?g { ?s here:x ?x { SELECT ?y { OPTIONAL { ?q here:y ?y } } } } }",
    "SELECT * { GRAPH ?g { BIND(EXISTS { {} MINUS { ?s here:x ?x } } AS ?e) ?s here:y ?y } }",
    "SELECT ?g { GRAPH ?g { { ?s here:x ?x } UNION { FILTER(true) } } }",
    "SELECT * { GRAPH graph:map { OPTIONAL { ?s <urn:no> ?x } } }",
    "SELECT * { GRAPH graph:map { GRAPH graph:dataset { ?s a ?x } } }",
    "SELECT ?s { GRAPH <urn:nowhere> { ?s here:x ?x } }",
    "SELECT ?s ?o { ?s here:isA* ?o }",
    "SELECT ?o { here:Chair rdfs:subClassOf* ?o }",
    "SELECT ?s { ?s here:isA? here:Chair }",
    "SELECT ?o { here:Chair <urn:no>* ?o }",
    "SELECT ?s { ?s <urn:no>? 'nobody says so' }",
    "SELECT ?s ?o { ?s (here:x|here:inPlace/rdfs:label)? ?o }",
    "SELECT ?s ?o { ?s !(here:x|here:y) ?o }",
    "SELECT ?s ?o { ?s !here:x ?o FILTER(isIRI(?o)) }",
    "SELECT ?s ?o { ?s here:inPlace/rdfs:label ?o }",
    "SELECT ?s ?o { ?s ^here:inPlace|here:hasBelief ?o }",
    "SELECT ?s ?o { ?s here:inPlace/(here:hasBelief/here:ofCategory)+ ?o }",
    "SELECT ?s ?o { ?s a/here:isA* ?o }",
    "SELECT ?s ?o { ?s (here:inPlace|here:hasBelief/here:ofCategory)+ ?o }",
    "SELECT ?s { ?s (here:isA*)+ here:Chair }",
    "SELECT ?s ?o { ?s (here:isA*)+ ?o }",
    "SELECT ?s ?o { ?s here:isA*/here:isA ?o }",
    "DESCRIBE <object/1>",
    "DESCRIBE ?s { ?s a here:Chair }",
    "CONSTRUCT WHERE { ?s here:x ?x }",
    "CONSTRUCT { ?s ?p ?x } WHERE { ?s here:x ?x . BIND(here:z AS ?p) }",
    "SELECT ?s { ?s here:x ?x FILTER NOT EXISTS { ?s here:inPlace ?y } }",
    "SELECT ?s { ?s here:x ?x FILTER(EXISTS { ?s ?p 'chair 1' } || ?x > 1) }",
    "SELECT (EXISTS { ?any a here:Chair } AS ?there) {}",
    "SELECT ?s { ?s here:x ?x } ORDER BY (EXISTS { ?s here:y ?y }) ?s",
    "SELECT ?s { ?s here:x ?x MINUS { ?s a here:Place } }",
    "SELECT ?s { ?s here:x ?x MINUS { ?s ?p 'place 1' } }",
    "SELECT ?s ?l { { SELECT DISTINCT ?s { ?s here:x ?x } ORDER BY ?s LIMIT 2 } ?s rdfs:label ?l }",
    "SELECT ?s { ?s here:x ?x . VALUES ?x { 1.01e0 2.01e0 1.0 } }",
    "SELECT ?s ?p ?o { VALUES ?p { here:x } ?s ?p ?o }",
    "SELECT ?s { ?s here:x 1.5, 2e0; here:y -1 ; . ?s a here:Chair }",
    "SELECT ?s { [] here:inPlace ?s }",
    "SELECT ?s { ?s here:inPlace [ rdfs:label 'place 1' ; here:hasBelief [] ] }",
    "SELECT ?s { [ here:x ?x ] . ?s here:y ?x }",
    "SELECT ?s { ?s here:x ?x FILTER(?x<?y&&?y>1) } # { ?s ?p ?o }",
    "SELECT ?s{?s here:x ?a;here:y ?b.FILTER(?a<?b)?s ?p ?o.FILTER(?b>?a)}",
    'SELECT ?s { ?s rdfs:label \'a } { ?s ?p ?o\' , """x " } """ }',
    "SELECT ?s { ?s rdfs:label ?l FILTER(REGEX(?l, '[{(]chair') || ?l = 'chair 1'@en) }",
    "SELECT ?s { ?s here:x ?x FILTER(EXISTS { ?s <urn:no> ?y }<true#>||'''\n"
    " || EXISTS { ?s here:inPlace ?p } #'''\n) }",
    "SELECT ?s { ?s here:x ?x FILTER(BOUND(?y) || <<(?s?x'>')>> = 1"
    " || EXISTS { ?s here:inPlace ?p } #'\n) }",
    "CONSTRUCT { ?s ?p <<(?s?p'>')>> } WHERE { ?s ?p ?q } #' } WHERE { ?s here:x ?x }",
    "SELECT ?s { VALUES ?v { '''a' } ?s here:inPlace ?p } #\\q''' } ?s here:x ?x }",
    "SELECT ?s { (1 ?s) rdf:rest ?r }",
    "SELECT ?l { ?l rdf:first ?m ; rdf:rest () }",
    "PREFIX h: <https://w3id.org/hereabouts#> SELECT ?s { ?s h:x ?x ; h:inPlace/a h:Place }",
    "PREFIX here: <urn:other/> SELECT ?s { ?s here:x ?x }",
    "BASE <https://w3id.org/> SELECT ?s { ?s <hereabouts#x> ?x }",
    "SELECT ?s { ?s <https://w3id.org/./hereabouts#x> ?x }",
    "SELECT ?s { ?s \\u0068ere:x ?x }",
    "SELECT (COUNT(DISTINCT *) AS ?n) { ?s here:x ?x } HAVING (COUNT(*) > 1)",
    "SELECT ?k (COUNT(*) AS ?n) { ?s a ?k } GROUP BY ?k HAVING (EXISTS { ?k here:isA ?a })",
    "SELECT ?s FROM graph:map { ?s here:lastSeen ?t }",
    "SELECT ?s ?g FROM NAMED graph:dataset { GRAPH ?g { ?s here:framesApplied ?n } }",
    "SELECT ?n { graph:dataset here:sequence ?n }",
    "SELECT ?n { ?d here:sequence ?n }",
    "SELECT ?s { ?s here:x ?x } VALUES ?s { <https://example.org/flat/object/1> }",
    "select ?s where { ?s A ?x }",
    "SELECT ?s { ?s here:x ?x",
    "SELECT ?s { ?s here:y ?y . OPTIONAL { ?s here:inPlace ?p . OPTIONAL { ?q here:x ?y } } }",
    "SELECT ?s { ?s nobody:knows ?x }",
    "SELECT ?s { ?s a here:Place, bot:Space ; here:viewCount ?n FILTER(?n IN (1, 2, 3)) }",
    "SELECT ?g ?t { GRAPH ?g { ?s a ?t } { ?s here:x ?x } UNION { ?s here:belief ?b } }",
)
# patterns about places whose answers depend on objects too
PLACE = "?o a here:Place"
OTHERS = "?o here:confidence ?c"
NARROWED = (
    f"{PLACE} OPTIONAL {{ {OTHERS} }}",
    f"{PLACE} OPTIONAL {{ ?q a here:Robot OPTIONAL {{ {OTHERS} }} }}",
    f"{PLACE} OPTIONAL {{ ?q a here:Robot MINUS {{ {OTHERS} }} }}",
    f"{PLACE} OPTIONAL {{ ?q a here:Robot FILTER NOT EXISTS {{ {OTHERS} }} }}",
    f"{PLACE} OPTIONAL {{ ?q a here:Robot {{ SELECT (COUNT(*) AS ?n) {{ {OTHERS} }} }} }}",
    f"{PLACE} }} GRAPH graph:map {{ ?q a here:Robot OPTIONAL {{ {OTHERS} }}",
    f"?q a here:Robot OPTIONAL {{ {OTHERS} }} }} GRAPH graph:map {{ {PLACE}",
    f"?q a here:Robot OPTIONAL {{ {OTHERS} }} {PLACE}",
    f"?q a here:Robot OPTIONAL {{ {OTHERS} }} {{ {PLACE} }}",
    f"{{ {PLACE} }} UNION {{ {OTHERS} }} ?o here:x ?x",
    f"{PLACE} {{ SELECT ?q ?p {{ ?o here:confidence ?q ; here:inPlace ?p }} }}",
    f"{PLACE} . ?q a here:Robot MINUS {{ ?q here:x ?any OPTIONAL {{ {OTHERS} }} }}",
    f"{PLACE} FILTER NOT EXISTS {{ ?q here:confidence ?c }}",
    f"{PLACE} }} OPTIONAL {{ {OTHERS} OPTIONAL {{ ?o rdfs:label ?l }}",
    f"{PLACE} }} GRAPH graph:commonsense {{ ?k here:isA here:Object }} GRAPH graph:map {{ ?q a ?k",
    "?o a ?k } GRAPH graph:commonsense { ?k here:isA here:Place } GRAPH graph:map { ?o here:x ?x",
    "?o here:inPlace ?p OPTIONAL { VALUES ?p { <urn:no> } }",
    "?o here:inPlace ?p VALUES ?p { UNDEF <urn:no> }",
    "?o here:inPlace ?p VALUES ?p { <urn:no> <place/1> } VALUES ?p { here:Chair <place/1> }",
    "?o here:inPlace ?p VALUES (?p ?o) { (<place/1> <object/1>) }",
    "?o here:inPlace ?p { VALUES ?p { <urn:no> } } UNION { ?o here:x ?x }",
)


States = dict[int, Store]


@pytest.fixture(scope="module")
def written_then(
    tmp_path_factory: pytest.TempPathFactory, frame: Callable[..., MapUpdate]
) -> Iterator[tuple[SemanticMap, States]]:
    """A map that frames and people wrote, its ontology too, and copies made at some moments."""
    copies: States = {}
    folder = tmp_path_factory.mktemp("past")
    with create_map(folder / "flat.map", base="https://example.org/flat/") as made:

        def copy(*_: object) -> None:
            if made.sequence in MOMENTS:
                copies[made.sequence] = Store()
                copies[made.sequence].extend(made.engine)

        copy()
        made.subscriptions.listen(copy)
        for number in range(18):
            made.apply(frame(number))
        known = "{ GRAPH graph:commonsense { here:Cup here:isA here:Chair } }"
        made.update(f"INSERT DATA {known}", allow=("commonsense",))
        made.assertions.add("object/1", "label", "my chair", by="ann")
        made.apply(MapUpdate(removed=(f"{made.base}object/2",)))
        made.update(f"DELETE DATA {known}", allow=("commonsense",))
        made.apply(frame(22))
        yield made, copies


@pytest.fixture(scope="module")
def alike(written_then: tuple[SemanticMap, States]) -> Callable[[str], None]:
    """Callable: compares the answers of past states with those of the copies."""
    semantic_map, copies = written_then
    assert copies.keys() == {*MOMENTS}
    past = {number: semantic_map.at(number).engine for number in MOMENTS}

    def compare(sparql: str) -> None:
        for number, state in copies.items():
            for union in (True, False):
                expected = answer(state, sparql, union=union)
                assert answer(past[number], sparql, union=union) == expected, (number, sparql)

    return compare


def answer(engine: Any, sparql: str, *, union: bool) -> object:
    asked = {
        "base_iri": "https://example.org/flat/",
        "prefixes": v.PREFIXES,
        "custom_functions": {NamedNode(v.MATH_SQRT): square_root},
    }
    try:
        found = engine.query(sparql, **asked, use_default_graph_as_union=union)
        return bool(found) if isinstance(found, QueryBoolean) else sorted(map(str, found))
    except (SyntaxError, ValueError) as error:
        return str(error)


@pytest.mark.parametrize("sparql", SHAPES)
def test_queries_of_many_shapes(alike: Callable[[str], None], sparql: str) -> None:
    alike(sparql)


@pytest.mark.parametrize("pattern", NARROWED)
def test_queries_about_a_few_things(alike: Callable[[str], None], pattern: str) -> None:
    alike(f"SELECT * {{ GRAPH graph:map {{ {pattern} }} }}")
    alike(f"SELECT * {{ {{ {pattern} }} }}")


def shipped() -> dict[str, str]:
    given = {"double": 1.0, "integer": 2, "string": "chair"}
    terms = {"category": v.HERE + "Chair", "place": "https://example.org/flat/place/1"}
    iri = "https://example.org/flat/object/1"
    return {
        question.name: question.bind(
            {p.name: p.default or given.get(p.type, p.type) for p in question.parameters},
            lambda kind, text: terms.get(kind, iri),
        )
        for question in shipped_queries()
    }


@pytest.mark.parametrize("name", shipped())
def test_shipped_questions(alike: Callable[[str], None], name: str) -> None:
    alike(shipped()[name])


def test_a_state_asked_again_is_the_cached_one_and_the_last_ones_are_kept() -> None:
    node, causes = NamedNode("urn:a"), Cause("update")
    with TransactionalStore.in_memory([]) as store:
        log = attach(store, None, "urn:flat/")
        for number in range(4):
            text = f'INSERT DATA {{ GRAPH <urn:g> {{ <urn:a> <urn:b> "{number}" }} }}'
            scratch = Store()
            scratch.update(text)
            store.commit([], scratch, causes)
        states = PastStates(capacity=8)  # facts: state N has N, and its number

        def at(number: int) -> Store:
            return states.at(log, store.engine, number)

        third = at(3)
        assert len(list(third.quads_for_pattern(node, None, None))) == 3
        assert at(3) is third
        second = at(2)
        assert (at(3) is third, at(2) is second) == (True, True)
        at(1)  # 2 + 3 + 4 facts are more than 8: the one asked longest ago goes
        assert (at(2) is second, at(3) is third) == (True, False)


def test_a_state_that_is_withdrawn_is_not_cached() -> None:
    states = PastStates()
    with TransactionalStore.in_memory([]) as store:
        log = attach(store, None, "urn:flat/")
        scratch = Store()
        scratch.update('INSERT DATA { GRAPH <urn:g> { <urn:a> <urn:b> "refused" } }')
        change = store.commit([], scratch, Cause("update"))
        assert change is not None
        number = change.sequence + 1
        log.append(replace(change, sequence=number, removed=tuple(scratch), added=()))
        assert len(states.at(log, store.engine, number)) == 1  # its number
        log.withdraw(number)
        scratch.update('INSERT DATA { GRAPH <urn:g> { <urn:a> <urn:b> "accepted" } }')
        store.commit([], scratch, Cause("update"))
        assert len(states.at(log, store.engine, number)) == 3
