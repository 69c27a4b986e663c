"""What a query cannot see changes nothing: it is answered alike with it and without it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyoxigraph import Literal, NamedNode, Quad, QueryBoolean, Store

from kg import vocabulary as v
from kg.commits import Cause
from kg.engine import Engine
from kg.functions import square_root
from kg.history.log import Log
from kg.history.moment import SINGLY, Moment
from kg.history.past import quads_at
from kg.history.recovery import attach
from kg.patterns import EVERYTHING, Among, Narrow, Pattern, Seen
from kg.questions import shipped_questions
from kg.records import MapUpdate
from kg.seen import seen_by
from kg.semantic_map import SemanticMap
from kg.store import MapStore

MOMENTS = (0, 21, 23)
HERE_X, TYPE = NamedNode(v.X), NamedNode(v.RDF_TYPE)
GRAPH = NamedNode(v.MAP_GRAPH)

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
# where a place is asked for, objects matter still: each of these is answered otherwise without them
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


@pytest.fixture(scope="module")
def remembered(
    tmp_path_factory: pytest.TempPathFactory, frame: Callable[..., MapUpdate]
) -> Iterator[SemanticMap]:
    """A map that was written by frames and by people, its ontology too."""
    folder = tmp_path_factory.mktemp("seen")
    with SemanticMap.create(folder / "flat.map", base="https://example.org/flat/") as made:
        for number in range(18):
            made.apply(frame(number))
        known = "{ GRAPH graph:commonsense { here:Cup here:isA here:Chair } }"
        made.update(f"INSERT DATA {known}", allow=("commonsense",))
        made.assert_("object/1", "label", "my chair", by="ann")
        made.apply(MapUpdate(removed=(f"{made.base}object/2",)))
        made.update(f"DELETE DATA {known}", allow=("commonsense",))
        made.apply(frame(22))
        yield made


@pytest.fixture(scope="module")
def states(remembered: SemanticMap) -> dict[int, Store]:
    """All that it said at some moments."""
    return {n: whole(remembered.history, remembered.engine, n) for n in MOMENTS}


@pytest.fixture(scope="module")
def alike(remembered: SemanticMap, states: dict[int, Store]) -> Callable[[str], None]:
    """Asks a query of these moments, made for it alone, and of all that was said."""
    everything = {number: made(remembered, number) for number in MOMENTS}

    def ask(sparql: str) -> None:
        sees_all = EVERYTHING in seen_by(sparql, v.PREFIXES, remembered.base).whole
        for number, state in states.items():
            # the moment for what sees everything is the same for all queries
            moment = everything[number] if sees_all else made(remembered, number)
            for union in (True, False):
                expected = answer(state, sparql, union=union)
                assert answer(moment, sparql, union=union) == expected, (number, sparql)

    return ask


def made(semantic_map: SemanticMap, number: int) -> Moment:
    return Moment(semantic_map.history, lambda: semantic_map.engine, number)


def whole(log: Log, engine: Engine, number: int) -> Store:
    store = Store()
    store.extend(quads_at(log, engine, number))
    return store


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
@pytest.mark.parametrize("graph", ["GRAPH graph:map", ""])
def test_queries_about_a_few_things(alike: Callable[[str], None], pattern: str, graph: str) -> None:
    sparql = f"SELECT * {{ GRAPH graph:map {{ {pattern} }} }}"
    alike(sparql.replace("GRAPH graph:map", graph))


def test_a_moment_is_asked_one_thing_after_another(
    remembered: SemanticMap, states: dict[int, Store]
) -> None:
    asked = [f"SELECT * {{ GRAPH graph:map {{ {pattern} }} }}" for pattern in NARROWED]
    few = [sparql for sparql in asked if EVERYTHING not in seen_by(sparql, v.PREFIXES).whole]
    assert len(few) > len(asked) / 2
    for number, state in states.items():
        moment = made(remembered, number)
        for sparql in few:
            found = answer(moment, sparql, union=True)
            assert found == answer(state, sparql, union=True), (number, sparql)


def shipped() -> dict[str, str]:
    given = {"double": 1.0, "integer": 2, "string": "chair"}
    terms = {"category": v.HERE + "Chair", "place": "https://example.org/flat/place/1"}
    iri = "https://example.org/flat/object/1"
    return {
        question.name: question.bind(
            {p.name: p.default or given.get(p.type, p.type) for p in question.parameters},
            lambda kind, text: terms.get(kind, iri),
        )
        for question in shipped_questions()
    }


@pytest.mark.parametrize("name", shipped())
def test_shipped_questions(alike: Callable[[str], None], name: str) -> None:
    sparql = shipped()[name]
    alike(sparql)
    if name != "graph-sizes":
        assert EVERYTHING not in seen_by(sparql, v.PREFIXES).whole


_nodes = st.sampled_from(
    ["?a", "?b", "?c", "here:Chair", "<object/1>", "1.01e0", "[]", "graph:map"]
)
_steps = st.sampled_from(
    [
        *("here:x", "here:inPlace", "a", "rdfs:label", "here:isA", "?p", "^here:inPlace"),
        *("(here:x|here:y)", "here:inPlace/rdfs:label", "!here:x", "here:isA?", "here:isA*"),
        *(
            "(a|here:isA)+",
            "(here:isA*)+",
            "(^here:inPlace/here:inPlace)+",
            "a/here:isA*",
            "(here:isA*|here:x)",
            "^here:isA?/rdfs:label",
        ),
    ]
)
_triples = st.tuples(st.sampled_from(["?a", "?b", "<object/1>", "[]"]), _steps, _nodes).map(
    lambda parts: " ".join(parts) + " ."
)


def _around(groups: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    forms = [
        "{{ {} }}",
        "OPTIONAL {{ {} }}",
        "MINUS {{ {} }}",
        "FILTER EXISTS {{ {} }}",
        "FILTER (NOT EXISTS {{ {} }} && 1 < 2)",
        "GRAPH graph:map {{ {} }}",
        "GRAPH ?g {{ {} }}",
        "{{ SELECT ?a {{ {} }} }}",
        "{{ SELECT (COUNT(*) AS ?n) {{ {} }} }}",
        "{{ ?a here:x ?b }} UNION {{ {} }}",
        "GRAPH graph:map {{ ?a a here:Chair . {} }}",
        "GRAPH graph:map {{ ?b a ?c }} GRAPH graph:commonsense {{ ?c here:isA here:Chair }} {}",
        "GRAPH graph:map {{ ?a here:inPlace ?b OPTIONAL {{ {} }} }} VALUES ?b {{ <place/1> }}",
        "VALUES ?c {{ here:Chair graph:map }} {} OPTIONAL {{ ?a here:x ?b }}",
    ]
    one = st.tuples(st.sampled_from(forms), groups).map(lambda two: two[0].format(two[1]))
    return st.lists(one | _triples, max_size=2).map(" ".join)


# what it finds is counted and not listed: three patterns that share nothing have many solutions
queries = st.tuples(
    st.sampled_from(["ASK", "SELECT (COUNT(*) AS ?all) (COUNT(DISTINCT ?a) AS ?as) WHERE"]),
    st.recursive(_triples, _around, max_leaves=3),
).map(lambda parts: f"{parts[0]} {{ {parts[1]} }}")


@pytest.fixture(scope="module")
def small() -> Iterator[tuple[Log, MapStore]]:
    """A few facts, some of them of common sense, and what became of them."""
    here, flat = v.HERE, "https://example.org/flat/"
    one, other, place = (NamedNode(f"{flat}{name}") for name in ("object/1", "object/2", "place/1"))
    chair, things = NamedNode(here + "Chair"), NamedNode(v.OBJECT)
    known, assertions = NamedNode(v.COMMONSENSE_GRAPH), NamedNode(v.ASSERTIONS_GRAPH)
    isa, inside = NamedNode(v.IS_A), NamedNode(v.IN_PLACE)
    first = {Quad(chair, isa, chair, known), Quad(chair, isa, things, known)}
    more = {Quad(thing, TYPE, chair, GRAPH) for thing in (one, other)}
    more |= {Quad(one, HERE_X, Literal(x), GRAPH) for x in (1.01, 2.0)}
    more |= {Quad(one, inside, place, GRAPH), Quad(place, NamedNode(v.RDFS_LABEL), one, GRAPH)}
    last = {Quad(other, HERE_X, Literal(1.01), assertions), Quad(things, isa, things, known)}
    with MapStore.in_memory(first) as store:
        log = attach(store, None, flat)
        store.commit((), more, Cause("update"))
        store.commit({*list(more)[:2], *list(first)[:1]}, last, Cause("update"))
        store.commit(last, first, Cause("update"))
        yield log, store


@settings(max_examples=200, deadline=None)
@given(queries, st.integers(0, 3), st.booleans())
def test_queries_that_nobody_thought_of(
    small: tuple[Log, MapStore], sparql: str, number: int, union: bool
) -> None:
    log, store = small
    moment, state = Moment(log, lambda: store.engine, number), whole(log, store.engine, number)
    assert answer(moment, sparql, union=union) == answer(state, sparql, union=union)


def test_what_is_asked_of_few_facts_sees_few() -> None:
    asked = """SELECT ?x { GRAPH graph:map {
      <object/17> here:x ?x ; a here:Chair . ?o (^here:y|here:z)+ ?s
    } }"""
    thing = NamedNode("https://example.org/flat/object/17")
    assert seen_by(asked, v.PREFIXES, "https://example.org/flat/").whole == {
        Pattern(thing, HERE_X, None, GRAPH),
        Pattern(thing, TYPE, NamedNode(v.HERE + "Chair"), GRAPH),
        Pattern(None, NamedNode(v.Y), None, GRAPH),
        Pattern(None, NamedNode(v.Z), None, GRAPH),
    }


def test_relative_names_are_of_a_folder_alone() -> None:
    asked, folder = "ASK { <s> <urn:p> 1 }", "https://example.org/flat/"
    assert seen_by(asked, base=folder).whole == {
        Pattern(NamedNode(f"{folder}s"), NamedNode("urn:p"))
    }
    for other in (None, "https://example.org/flat", "https://example.org/flat?of=/"):
        assert seen_by(asked, base=other).whole == {Pattern(None, NamedNode("urn:p"))}


def test_what_is_asked_of_a_few_things_sees_nothing_of_the_others() -> None:
    asked = """SELECT * {
      VALUES ?cell { <urn:one> <urn:other> }
      GRAPH graph:map { ?o here:inCell ?cell ; a ?kind OPTIONAL { ?o here:x ?x } }
      GRAPH graph:commonsense { ?kind here:isA here:Object }
      OPTIONAL { ?o here:y ?y . ?near here:z ?z OPTIONAL { ?o here:heading ?h } }
    }"""
    cell, kinds = NamedNode(v.IN_CELL), NamedNode(v.COMMONSENSE_GRAPH)
    above = Pattern(None, NamedNode(v.IS_A), NamedNode(v.OBJECT), kinds)
    cells = frozenset((NamedNode("urn:one"), NamedNode("urn:other")))
    among = frozenset(
        (Among(cell, GRAPH, cells, None), Among(TYPE, GRAPH, frozenset(), above)),
    )
    seen = seen_by(asked, v.PREFIXES)
    assert seen.narrow == {
        Narrow(Pattern(None, cell, None, GRAPH), among),
        Narrow(Pattern(None, TYPE, None, GRAPH), among),
        Narrow(Pattern(None, HERE_X, None, GRAPH), among),
        Narrow(Pattern(None, NamedNode(v.Y)), among),
    }
    assert seen.whole == {
        above,
        Pattern(None, NamedNode(v.Z)),
        Pattern(None, NamedNode(v.HEADING)),
    }
    assert seen_by("ASK {}") == Seen(frozenset())


@pytest.mark.parametrize(
    "sparql",
    [
        "SELECT * { ?s ?p ?o }",
        "SELECT * { ?s !<urn:p> ?o }",
        "SELECT * { ?s <urn:p>* ?o }",
        "SELECT * { GRAPH ?g {} }",
        "SELECT * { GRAPH <urn:g> { [ <urn:p>* ?o ] } }",
        "DESCRIBE <urn:s>",
        "ASK { SERVICE <urn:there> { ?s <urn:p> ?o } }",
        "ASK { ?s <urn:p> ?o LATERAL { ?o <urn:p> ?q } }",
        "ASK { << ?s <urn:p> ?o >> <urn:q> ?r }",
        "ASK { ?s <urn:p> ?o {| <urn:q> ?r |} }",
        "ASK { ?s \\u003curn:p> ?o }",
        "ASK { ?s none:p ?o }",
        "PREFIX rel: <> ASK { ?s rel:urn:p ?o }",
        "ASK { ?s <urn:p> ?o FILTER(?o<?a&&?b>?c) }",
        "ASK { " + "{ " * 2000 + "}" * 2001,
        "ASK { ?s <urn:p> ?o } #" + "x" * 200_000,
        "not SPARQL",
    ],
)
def test_what_is_not_understood_sees_everything(sparql: str) -> None:
    assert EVERYTHING in seen_by(sparql).whole


def test_a_moment_is_read_as_a_store(remembered: SemanticMap, states: dict[int, Store]) -> None:
    log, engine = remembered.history, remembered.engine
    for number, state in states.items():
        moment = Moment(log, lambda: engine, number)
        for quad in list(state)[::50]:
            assert quad in moment
            assert Quad(*quad.triple, NamedNode("urn:no")) not in moment
        for terms in ((None, HERE_X, None, None), (None, None, None, GRAPH), (None, TYPE, None)):
            assert set(moment.quads_for_pattern(*terms)) == set(state.quads_for_pattern(*terms))
        assert set(moment) == set(state)


def test_what_was_not_asked_for_is_not_made(remembered: SemanticMap) -> None:
    moment = Moment(remembered.history, lambda: remembered.engine, 19)
    asked = "SELECT ?x { GRAPH graph:map { <object/1> here:x ?x } }"
    assert len(list(moment.query(asked, prefixes=v.PREFIXES, base_iri=remembered.base))) == 1
    assert len(moment) == 1
    for number in range(SINGLY + 1):
        nobody = NamedNode(f"{remembered.base}object/{number}")
        list(moment.quads_for_pattern(nobody, HERE_X, None, GRAPH))
    assert len(moment) > 1, "who looks at one after the other is given them all"
