"""Tokens of SPARQL, and orders of results."""

import random
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyoxigraph import BlankNode, Literal, NamedNode, Quad, QuerySolutions, Store

from kg.maps.query.evaluation import Value
from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.errors import QueryRefusedError
from kg.rdf.sparql.engine_gaps import with_total_order
from kg.rdf.sparql.lexer import keywords_of, replace_tokens, substitute, tokens_of
from kg.rdf.sparql.update_parser import with_graphs
from kg.rdf.sparql.vetting import vet
from kg.serving.opening import in_memory_map
from kg.serving.workers.pool import QueryPool
from kg.serving.workers.updates import UpdateRequest, update_map

SYNTAX = st.text(st.sampled_from("aA0:_?$@<>'\"\\\\#\n{}()[];.-% \u00e9\u3001u"), max_size=60)


@given(SYNTAX | st.text(max_size=60))
def test_tokens_are_in_order_and_only_white_space_and_comments_lie_between(sparql: str) -> None:
    end = 0
    for token in tokens_of(sparql):
        between = sparql[end : token.start].strip()
        assert not between or between.startswith("#")
        assert sparql[token.start : token.end] == token.text
        end = token.end


@given(SYNTAX)
def test_a_text_of_ascii_has_the_same_tokens_within_a_text_beyond_ascii(sparql: str) -> None:
    text = sparql.encode("ascii", "ignore").decode()
    alone = [(token.kind, token.text) for token in tokens_of(text)]
    both = [(token.kind, token.text) for token in tokens_of(f"\u20ac \n{text}")]
    assert both[1:] == alone


@given(SYNTAX)
def test_replacing_no_token_leaves_the_text_as_it_is(sparql: str) -> None:
    assert replace_tokens(sparql, lambda _: None) == sparql


def test_clauses_of_an_update_are_found_behind_what_is_no_long_string() -> None:
    update = "DELETE { } WHERE { VALUES ?x { '''a' } } #\\q'''"
    assert with_graphs(update, ["urn:g"], []).startswith("DELETE { } USING <urn:g> WHERE")


def test_variables_end_where_the_engine_ends_them() -> None:
    text = "SELECT * { BIND($\u00e9\u00b7 AS ?x) }"
    given = substitute(text, {"\u00e9\u00b7": Literal("x")})
    assert given == 'SELECT * { BIND("x" AS ?x) }'
    assert Store().query(text) is not None
    assert list(keywords_of(text)) == ["SELECT", "BIND", "AS"]


@pytest.mark.parametrize("quote", ["\\u0022", "\\U00000022"])
def test_nesting_behind_an_escaped_quote_is_counted_as_the_engine_reads_it(quote: str) -> None:
    deep = "(" * 400 + "1" + ")" * 400
    with pytest.raises(QueryRefusedError, match="nest"):
        vet(f'ASK {{ BIND("{quote}" AS ?y) BIND({deep} AS ?x) }}')


MIXED = "SELECT ?o { GRAPH <urn:g> { ?s ?p ?o } } ORDER BY STR(?p) ?o"


def mixed(seed: int) -> list[Literal | NamedNode | BlankNode]:
    """Values of all kinds over which the engine's comparison is no order."""
    values: list[Literal | NamedNode | BlankNode] = []
    for number in range(40):
        values += [Literal(number), Literal(f"{number}a"), Literal(number / 3)]
        values += [Literal(str(number)), Literal(f"{number}", language="en")]
        values += [NamedNode(f"urn:{number}"), BlankNode()]
        values += [Literal(f"P{number}D", datatype=NamedNode(v.XSD + "duration"))]
        values += [Literal(f"P{number + 1}M", datatype=NamedNode(v.XSD + "duration"))]
    for day in range(1, 28):
        for form in ("2020-01-{:02}T00:00:00", "2020-01-{:02}T03:00:00Z", "2020-01-{:02}"):
            kind = "dateTime" if "T" in form else "date"
            values.append(Literal(form.format(day), datatype=NamedNode(v.XSD + kind)))
    values += [Literal(float("nan")), Literal(float("inf")), Literal(True), Literal(False)]
    random.Random(seed).shuffle(values)
    return values


@pytest.mark.parametrize("direction", ["", "DESC"])
def test_any_mixture_is_sorted_by_kind_and_within_numbers_by_value(direction: str) -> None:
    query = with_total_order(f"SELECT ?o {{ ?s ?p ?o }} ORDER BY STR(?p) {direction}(?o)")
    for seed in range(3):
        store, values = Store(), mixed(seed)
        store.extend(Quad(NamedNode("urn:s"), NamedNode("urn:p"), value) for value in values)
        solutions = store.query(query)
        assert isinstance(solutions, QuerySolutions)
        found = [solution["o"] for solution in solutions]
        if direction:
            found.reverse()
        assert len(found) == len(set(values))
        kinds = [(BlankNode, NamedNode, Literal).index(type(term)) for term in found]
        assert kinds == sorted(kinds)
        numeric = {v.XSD + name for name in ("integer", "double")}
        numbers = [
            float(t.value) for t in found if isinstance(t, Literal) and t.datatype.value in numeric
        ]
        finite = [number for number in numbers if number == number]
        assert len(finite) == len(numbers) - 1
        assert finite == sorted(finite)


@pytest.mark.parametrize(
    "sparql",
    [
        "SELECT * { ?s ?p ?o } ORDER BY",
        "SELECT * { ?s ?p ?o } ORDER BY EXISTS { ?s ?p ?o }",
        "SELECT * { ?s ?p 'ORDER BY ?o' } # ORDER BY ?o",
        "SELECT ?order ?by { ?order ?by ?o }",
    ],
)
def test_what_has_no_key_that_is_understood_stays_as_it_is(sparql: str) -> None:
    assert with_total_order(sparql) == sparql


@pytest.mark.parametrize(
    "tail",
    [
        "ORDER BY ?o",
        "order by desc(?o) asc(?s) LIMIT 7",
        "ORDER BY STR(?o) (?o + 1) <http://www.w3.org/2001/XMLSchema#string>(?o) xsd:string(?s)",
        "GROUP BY ?s ?p ?o ORDER BY COUNT(?s) ?o",
        "ORDER BY ?o OFFSET 3 VALUES ?s { UNDEF }",
        "ORDER BY #c ?p\n?o # }",
    ],
)
def test_keys_of_every_form_are_answered_as_without_the_rewriting(tail: str) -> None:
    store, prefix = Store(), f"PREFIX xsd: <{v.XSD}> "
    for number in range(9):
        store.add(Quad(NamedNode(f"urn:{number % 4}"), NamedNode("urn:p"), Literal(number)))
    sparql = f"{prefix}SELECT ?s ?p ?o {{ {{ SELECT * {{ ?s ?p ?o }} ORDER BY ?o }} }} {tail}"
    rewritten = with_total_order(sparql)
    assert rewritten != sparql
    assert [str(row) for row in store.query(rewritten)] == [str(row) for row in store.query(sparql)]


@pytest.fixture(scope="module")
def home() -> Iterator[SemanticMap]:
    made = in_memory_map()
    values = " , ".join(str(value) for value in mixed(1) if isinstance(value, Literal | NamedNode))
    made.update(f"INSERT DATA {{ GRAPH <urn:g> {{ <urn:s> <urn:p> {values} }} }}")
    with made:
        yield made


def test_a_users_process_survives_the_question_and_has_its_answer(home: SemanticMap) -> None:
    rows: list[Value] = [row[0] for row in home.query(MIXED).rows]
    assert len(rows) > 300


def test_a_worker_answers_it_and_an_update_with_it_is_applied(home: SemanticMap) -> None:
    count = len(home.query(MIXED).rows)
    with QueryPool(home, workers=1, timeout=60) as pool:
        body = pool.run(MIXED, accept="text/csv", at_least=home.sequence).body
        assert body.count(b"\n") == count + 1
        update = f"INSERT {{ GRAPH <urn:h> {{ <urn:s> <urn:q> ?o }} }} WHERE {{ {MIXED} }}"
        change = update_map(pool, home, UpdateRequest(update), by=None)
    assert change is not None
    assert len(change.added) == count
