"""What a query reads, on the safe side: no commit that changes its answer is ever skipped."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyoxigraph import NamedNode, Quad, Store

from kg import vocabulary as v
from kg.server.feeds.query_dependencies import ANYTHING, reads_of

TERMS = [NamedNode(f"https://example.org/{name}") for name in "abcd"]
PREDICATES = [NamedNode(v.X), NamedNode(v.Y), NamedNode(v.RDFS_LABEL), NamedNode(v.RDF_TYPE)]
GRAPH = NamedNode(v.MAP_GRAPH)
QUERIES = [
    "SELECT * { ?s here:x ?o }",
    "SELECT * { GRAPH ?g { ?s here:x ?o } OPTIONAL { ?s here:y ?p } }",
    "SELECT * { ?s here:x ?o MINUS { ?s here:y ?p } }",
    "SELECT * { ?s here:x ?o FILTER NOT EXISTS { ?s rdfs:label ?l } }",
    "SELECT * { ?s here:x ?o FILTER EXISTS { ?s a <https://example.org/a> } }",
    "SELECT (COUNT(*) AS ?n) { { ?s here:x ?o } UNION { ?s here:y ?o } }",
    "SELECT * { { SELECT ?s { ?s here:x ?o } GROUP BY ?s HAVING(COUNT(?o) > 1) } ?s a ?class }",
    "SELECT * { ?s here:x/here:y ?o }",
    "SELECT * { ?s here:x* ?o }",
    "SELECT * { ?s (here:x|^here:y)+ ?o }",
    "SELECT * { ?s !here:x ?o }",
    "SELECT * { ?s ?p ?o }",
    "ASK { ?s a <https://example.org/a> }",
    "SELECT * { ?s here:x ?o BIND(EXISTS { ?o here:y ?z } AS ?has) }",
    "SELECT ?s (EXISTS { ?s here:y ?z } AS ?has) { ?s here:x ?o }",
    "SELECT * { GRAPH ?g { } }",
    "SELECT * { ?s here:x ?o } ORDER BY EXISTS { ?s rdfs:label ?z } LIMIT 2",
]
quads = st.builds(
    Quad,
    st.sampled_from(TERMS),
    st.sampled_from(PREDICATES),
    st.sampled_from(TERMS),
    st.just(GRAPH),
)


def answer(store: Store, query: str) -> object:
    found = store.query(query, prefixes=v.PREFIXES, use_default_graph_as_union=True)
    return bool(found) if query.startswith("ASK") else sorted(map(str, found))  # type: ignore[arg-type]


@pytest.mark.parametrize("query", QUERIES)
@settings(max_examples=40, deadline=None)
@given(before=st.sets(quads, max_size=8), change=st.sets(quads, min_size=1, max_size=3))
def test_skipped_commit_never_changes_the_answer(
    query: str, before: set[Quad], change: set[Quad]
) -> None:
    store = Store()
    store.extend(before)
    first = answer(store, query)
    for quad in change:
        if quad in store:
            store.remove(quad)
        else:
            store.add(quad)
    if not reads_of(query).concern(change):
        assert answer(store, query) == first


def test_skipping_happens_at_all() -> None:
    reads = reads_of("SELECT * { ?s a here:Cup ; here:x ?x }")
    assert reads.predicates == {v.X}
    assert reads.classes == {v.HERE + "Cup"}
    a, b = TERMS[:2]
    assert not reads.concern([Quad(a, NamedNode(v.Y), b, GRAPH)])
    assert not reads.concern([Quad(a, NamedNode(v.RDF_TYPE), b, GRAPH)])
    assert reads.concern([Quad(a, NamedNode(v.X), b, GRAPH)])


@pytest.mark.parametrize(
    "query",
    ["", "nothing", "ASK " + "{" * 500, f"ASK {{ FILTER({'(' * 30}1{')' * 30}) }}"],
)
def test_text_that_tells_nothing_reads_anything(query: str) -> None:
    assert reads_of(query) == ANYTHING
