"""SPARQL Update worked out to quads, against what the engine does with the same text."""

import hashlib
from collections import Counter

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyoxigraph import BlankNode, DefaultGraph, Quad, RdfFormat, Store, parse

from kg.maps.update.change_draft import ChangeDraft
from kg.maps.update.execution import evaluate_update
from kg.model import vocabulary as v
from kg.model.errors import QueryError
from kg.store.transactional import TransactionalStore

START = """
@prefix e: <urn:e:> .
e:g { e:a e:p e:b , 1 , "x"@en . e:b e:p e:c . e:b e:q _:n . _:n e:p 1.0 }
e:h { e:a e:q e:b . e:c e:p "1"^^e:t , 01 }
e:i { e:a e:p e:a }
"""
PREFIX = "PREFIX e: <urn:e:>\n"
UPDATES = (
    "INSERT DATA { GRAPH e:g { e:n e:p 01 , 1.0 , 1e0 , 'it\\'s' , \"a;b{\" , e:a } }",
    "INSERT DATA { e:n e:p _:x . _:x e:p _:x , [ e:q ( 1 2 ) ] }",
    "DELETE DATA { GRAPH e:g { e:a e:p 1 , 2 } GRAPH e:h { e:a e:q e:b } }",
    "DELETE WHERE { GRAPH e:g { ?s e:p ?o } }",
    "DELETE WHERE { GRAPH ?g { e:a ?p ?o } }",
    "DELETE WHERE { GRAPH e:g { ?s ?p ?o . ?o ?q ?r } GRAPH e:h { ?s ?t ?o } }",
    "WITH e:g DELETE { ?s e:p ?o } INSERT { ?s e:q ?o } WHERE { ?s e:p ?o }",
    "WITH e:g INSERT { ?o ?p ?s } WHERE { ?s ?p ?o }",  # literals as subjects are left out
    "WITH e:g INSERT { ?s ?o ?p } WHERE { ?s ?p ?o }",  # and as predicates
    # and as graphs
    "WITH e:g INSERT { GRAPH ?o { ?s ?p ?o } } WHERE { ?s ?p ?o FILTER(!isBlank(?o)) }",
    "WITH e:g DELETE { ?s e:p ?o } INSERT { ?s e:p ?o } WHERE { ?s e:p ?o }",
    "WITH e:g INSERT { _:n e:of ?s ; e:at _:m } WHERE { ?s e:p ?o }",  # fresh for each solution
    "WITH e:g INSERT { [] e:of _:k . _:k e:p ?missing } WHERE { ?s e:p ?o }",
    "WITH e:h DELETE { ?s ?p ?o } WHERE { GRAPH e:g { ?s ?x ?y } ?s ?p ?o }",
    "INSERT { GRAPH e:j { ?s ?p ?o } } USING e:g USING e:h WHERE { ?s ?p ?o }",
    "INSERT { GRAPH e:j { ?s ?p ?g } } USING NAMED e:h WHERE { GRAPH ?g { ?s ?p ?o } }",
    "WITH e:i INSERT { ?s ?p ?g } USING e:g USING NAMED e:h WHERE { ?s ?p ?o GRAPH ?g {?s ?q ?r} }",
    "WITH e:g DELETE { ?s ?p ?o } INSERT { ?s ?p ?n } WHERE { ?s ?p ?o "
    "FILTER(isNumeric(?o) && ?o<2) BIND(?o+1 AS ?n) }",
    "WITH e:g INSERT { e:t e:is ?n } WHERE { SELECT (COUNT(*) AS ?n) WHERE { ?s ?p ?o } }",
    "WITH e:g INSERT { e:t e:is e:there } WHERE { e:a e:p e:b }",
    "WITH e:g INSERT { e:t e:is e:there } WHERE { e:a e:p e:nothing }",
    "INSERT { GRAPH e:g { e:t e:p ?x } } WHERE { VALUES ?x { 1 UNDEF e:a } }",
    "WITH e:g DELETE { ?s $p ?o } WHERE { $s ?p $o # a comment; with } braces {\n }",
    "CLEAR GRAPH e:g",
    "CLEAR NAMED",
    "DROP ALL",
    "DROP SILENT GRAPH e:nowhere",
    "COPY GRAPH e:g TO GRAPH e:h",
    "MOVE e:g TO e:new",
    "ADD e:g TO e:h",
    "COPY e:g TO e:g",
    "CREATE GRAPH e:new",
    "INSERT DATA { GRAPH e:g { e:n e:p 1 } }; WITH e:g DELETE { ?s e:p 1 } WHERE { ?s e:p 1 }",
    "COPY e:g TO e:j; DELETE WHERE { GRAPH e:g { ?s ?p ?o } }; "
    "WITH e:j INSERT { GRAPH e:g { ?o e:back ?s } } WHERE { ?s ?p ?o }; CLEAR GRAPH e:j;",
    "INSERT DATA { GRAPH e:g { _:x e:p e:z } }; WITH e:g INSERT { ?s e:q ?o } WHERE { ?s e:p ?o }",
    "INSERT DATA { }",
    "",
)


def start() -> list[Quad]:
    return list(parse(START, format=RdfFormat.TRIG))


def same_up_to_blank_nodes(one: list[Quad], other: list[Quad]) -> bool:
    return coloured(one) == coloured(other)


def coloured(quads: list[Quad]) -> Counter[tuple[str, ...]]:
    """The quads, each blank node by what is said of it, of those in that, and so on.

    Canonical names would tell a little more apart, and take as long as the factorial of how many
    blank nodes are alike.
    """
    colours: dict[BlankNode, str] = {}
    rows, kinds = _with(colours, quads), 0
    while True:
        about: dict[BlankNode, list[str]] = {}
        for quad, row in zip(quads, rows, strict=True):
            for place, term in enumerate((quad.subject, quad.object, quad.graph_name)):
                if isinstance(term, BlankNode):
                    about.setdefault(term, []).append(f"{place} {row}")
        colours = {
            node: hashlib.sha256(repr(sorted(said)).encode()).hexdigest()
            for node, said in about.items()
        }
        rows, before, kinds = _with(colours, quads), kinds, len(set(colours.values()))
        if kinds == before:
            return Counter(rows)


def _with(colours: dict[BlankNode, str], quads: list[Quad]) -> list[tuple[str, ...]]:
    return [
        tuple(
            colours.get(term, "_") if isinstance(term, BlankNode) else str(term)
            for term in (quad.subject, quad.predicate, quad.object, quad.graph_name)
        )
        for quad in quads
    ]


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("_:a e:p 1 . _:a e:p 2", "_:a e:p 1 . _:b e:p 2"),
        ("_:a e:p _:b . _:b e:p _:c", "_:a e:p _:b . _:b e:p _:a"),
        ("_:a e:p _:b . _:b e:p 1 . _:c e:p 1", "_:a e:p _:b . _:b e:p 1 . _:a e:p 1"),
    ],
)
def test_the_comparison_notices_other_blank_nodes(one: str, other: str) -> None:
    renamed = one.replace("_:a", "_:z").replace("_:b", "_:a")
    quads, same, others = (
        list(parse(f"@prefix e: <urn:e:> . {text} .", format=RdfFormat.TRIG))
        for text in (one, renamed, other)
    )
    assert same_up_to_blank_nodes(quads, same[::-1])
    assert not same_up_to_blank_nodes(quads, others)


def by_the_engine(text: str, quads: list[Quad]) -> list[Quad]:
    """What the engine makes of it; its default graph is our graph:map."""
    engine = Store()
    engine.extend(quads)
    engine.update(PREFIX + text)
    graph = v.MAP_GRAPH
    return [
        Quad(q.subject, q.predicate, q.object, graph)
        if isinstance(q.graph_name, DefaultGraph)
        else q
        for q in engine
    ]


def execute_update(store: TransactionalStore, text: str) -> ChangeDraft:
    pending = ChangeDraft(store)
    pending.apply(evaluate_update(store, text))
    return pending


def worked_out(text: str, quads: list[Quad]) -> list[Quad]:
    with TransactionalStore.in_memory(quads) as store:
        before = set(store.engine)
        pending = execute_update(store, PREFIX + text)
        assert set(store.engine) == before  # nothing is written
        assert not before & set(pending.added)
        assert set(pending.removed) <= before
        return list((before - set(pending.removed)) | set(pending.added))


@pytest.mark.parametrize("text", UPDATES)
def test_an_update_is_worked_out_as_the_engine_does_it(text: str) -> None:
    quads = start()
    assert same_up_to_blank_nodes(worked_out(text, quads), by_the_engine(text, quads))


IRIS = st.sampled_from(["e:a", "e:b", "e:c"])
GRAPHS = st.sampled_from(["e:g", "e:h", "e:i"])
PREDICATES = st.sampled_from(["e:p", "e:q"])
VALUES = st.one_of(IRIS, st.sampled_from(["1", "01", "1.0", "'x'", "'x'@en", "'}'", "'<a>;'"]))
VARIABLES = st.sampled_from(["?x", "?y", "?z", "$x"])


def triples(s: st.SearchStrategy, p: st.SearchStrategy, o: st.SearchStrategy, most: int = 3):
    one = st.builds("{} {} {} .".format, s, p, o)
    return st.lists(one, min_size=1, max_size=most).map(" ".join)


def in_graphs(inner: st.SearchStrategy) -> st.SearchStrategy:
    return st.builds("GRAPH {} {{ {} }}".format, GRAPHS, inner)


DATA = in_graphs(triples(IRIS, PREDICATES, VALUES))
PATTERN = triples(
    st.one_of(IRIS, VARIABLES), st.one_of(PREDICATES, VARIABLES), st.one_of(VALUES, VARIABLES)
)
FRESH = triples(
    st.one_of(IRIS, VARIABLES, st.just("_:f")), PREDICATES, st.one_of(VARIABLES, st.just("_:f"))
)
EXTRA = st.sampled_from(["", "FILTER(?x != ?y)", "BIND(STR(?y) AS ?z)", "OPTIONAL { ?x e:p ?z }"])
OPERATION = st.one_of(
    st.builds("INSERT DATA {{ {} }}".format, DATA),
    st.builds("DELETE DATA {{ {} }}".format, DATA),
    st.builds("DELETE WHERE {{ {} }}".format, in_graphs(PATTERN)),
    st.builds(
        "WITH {} DELETE {{ {} }} INSERT {{ {} }} WHERE {{ ?x ?q ?y . {} }}".format,
        GRAPHS,
        PATTERN,
        FRESH,
        EXTRA,
    ),
    st.builds(
        "INSERT {{ GRAPH {} {{ {} }} }} USING {} USING NAMED {} "
        "WHERE {{ {} GRAPH ?z {{ ?x ?q ?y }} }}".format,
        GRAPHS,
        FRESH,
        GRAPHS,
        GRAPHS,
        triples(VARIABLES, PREDICATES, VARIABLES, most=1),
    ),
    st.builds("{} SILENT GRAPH {}".format, st.sampled_from(["CLEAR", "DROP"]), GRAPHS),
    st.builds(
        "{} SILENT {} TO {}".format, st.sampled_from(["ADD", "COPY", "MOVE"]), GRAPHS, GRAPHS
    ),
)


@settings(max_examples=60, deadline=None)
@given(st.lists(OPERATION, min_size=1, max_size=4).map(" ;\n".join))
def test_any_update_is_worked_out_as_the_engine_does_it(text: str) -> None:
    quads = [q for q in start() if not q.predicate.value.endswith("q")]
    assert same_up_to_blank_nodes(worked_out(text, quads), by_the_engine(text, quads))


def test_what_names_no_graph_is_of_the_map_and_reads_everything() -> None:
    found = worked_out("INSERT { ?s e:seen ?o } WHERE { ?s e:q ?o FILTER(isIRI(?o)) }", start())
    seen = [q for q in found if q.predicate.value == "urn:e:seen"]
    assert [(q.subject.value, q.graph_name.value) for q in seen] == [("urn:e:a", v.MAP_GRAPH.value)]


def test_each_operation_may_declare_prefixes_of_its_own() -> None:
    text = (
        "INSERT DATA { GRAPH e:g { e:n e:p 1 } } ; PREFIX e: <urn:other:> BASE <http://b/> "
        "INSERT DATA { GRAPH e:g { e:n <c> 1 } }"
    )
    names = {(q.subject.value, q.predicate.value) for q in worked_out(text, [])}
    assert names == {("urn:e:n", "urn:e:p"), ("urn:other:n", "http://b/c")}


def test_on_disk_operations_see_each_other_and_leave_nothing_behind(tmp_path) -> None:
    text = "COPY e:g TO e:j; WITH e:j DELETE { ?s ?p ?o } WHERE { ?s ?p ?o FILTER(isIRI(?o)) }"
    with TransactionalStore.create(tmp_path / "a.map", start()) as store:
        held = sorted(path.name for path in (tmp_path / "a.map").iterdir())
        pending = execute_update(store, PREFIX + text)
        assert sorted(path.name for path in (tmp_path / "a.map").iterdir()) == held
    assert len(pending.added) == 4
    assert not pending.removed


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("LOAD <http://localhost/x>", "LOAD is refused"),
        ("load silent e:x into graph e:g", "LOAD is refused"),
        ("INSERT DATA {}; LOAD # <\n <file:///etc/passwd>", "LOAD is refused"),
        ("INSERT DATA {}; \\u004cOAD <http://localhost/x>", "LOAD is refused"),
        ("INSERT { ?s ?p ?o } WHERE { SERVICE <http://x/> { ?s ?p ?o } }", "SERVICE is refused"),
        ("SELECT * WHERE { ?s ?p ?o }", "SELECT is no operation of an update"),
        ("INSERT DATA { e:a e:b 1 }\n oops", "line 3, column"),
        ("INSERT DATA {} ;\nDELETE DATA { _:a e:p 1 }", "line 3"),
        ("DELETE { _:a e:p 1 } WHERE {}", "does not parse"),
        ("INSERT DATA { ?x e:p 1 }", "does not parse"),
        ("FROBNICATE e:x", "FROBNICATE is no operation"),
        ("CLEAR GRAPH e:nowhere", "no graph of this map"),
        ("CREATE GRAPH e:g", "is a graph already"),
        ("MOVE e:nowhere TO e:g", "there is no graph"),
        ("CLEAR ALL ALL", "does not parse"),
        ("INSERT { e:a e:b 1 } WHERE { ", "does not parse"),
        ("INSERT DATA { \ud800 }", "no Unicode"),
        ("\udcff\udcfe", "no Unicode"),
        ("\udcff", "no Unicode"),
    ],
)
def test_what_cannot_be_worked_out_is_refused_in_one_line(text: str, said: str) -> None:
    with pytest.raises(QueryError) as refused:
        worked_out(text, start())
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)
