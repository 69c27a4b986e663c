"""What is refused before a query is parsed, in whatever disguise."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyoxigraph import Store

from kg.model.errors import QueryRefusedError
from kg.rdf.sparql.lexer import keywords_of
from kg.rdf.sparql.update_parser import operations
from kg.rdf.sparql.vetting import MAX_DEPTH, MAX_LENGTH, check_length, vet

EVIL = "<http://127.0.0.1:9/sparql>"


def refused(sparql: str, services: tuple[str, ...] = ()) -> str:
    with pytest.raises(QueryRefusedError) as caught:
        vet(sparql, services=services)
    return str(caught.value)


DISGUISES = [
    f"SELECT * {{SERVICE {EVIL} {{?s ?p ?o}}}}",
    f"SELECT * {{sErViCe{EVIL}{{?s ?p ?o}}}}",
    f"SELECT * {{SERVICE SILENT {EVIL} {{?s ?p ?o}}}}",
    f"SELECT * {{SERVICE # {{ }}\n  # silent\n {EVIL} #x\n {{?s ?p ?o}}}}",
    "SELECT * {BIND(<http://x/> AS ?e) SERVICE ?e {?s ?p ?o}}",
    "SELECT * {BIND(<http://x/> AS ?e) SERVICE$e{?s ?p ?o}}",
    "PREFIX a: <http://x/> SELECT * {SERVICE a:b {?s ?p ?o}}",
    "PREFIX : <http://x/> SELECT * {SERVICE:{?s ?p ?o}}",
    "PREFIX service: <http://x/> SELECT * {SERVICE service:service {?s ?p ?o}}",
    f"SELECT * {{\\u0053ERVICE {EVIL} {{?s ?p ?o}}}}",
    f"SELECT * {{SER\\U00000056ICE {EVIL} {{?s ?p ?o}}}}",
    f"SELECT * {{FILTER EXISTS {{SERVICE {EVIL} {{?s ?p ?o}}}}}}",
    f"SELECT * {{FILTER(?x<1)SERVICE {EVIL}#>\n{{?s ?p ?o}}}}",
    "SELECT * {FILTER(?x<1)SERVICE:a#>\n{?s ?p ?o}}",
    f"SELECT * {{BIND('''it's \"\"\"''' AS ?x) SERVICE {EVIL} {{?s ?p ?o}} BIND('\"\"\"' AS ?y)}}",
    f"SELECT * {{BIND('\\\\' AS ?x) SERVICE {EVIL} {{?s ?p ?o}} BIND('x' AS ?y)}}",
    f"CONSTRUCT WHERE {{?s ?p ?o . SERVICE {EVIL} {{?s ?p ?o}}}}",
    f"SELECT * {{SERVICE\f{EVIL} {{?s ?p ?o}}}}",
]


@pytest.mark.parametrize("sparql", DISGUISES)
def test_service_is_refused_in_disguise(sparql: str) -> None:
    assert "SERVICE" in refused(sparql)


GAP = st.text(" \t\r\n", min_size=1, max_size=4) | st.from_regex(
    r" #[a-z{}<>'\"]{0,8}\n", fullmatch=True
)


@given(st.lists(st.booleans(), min_size=7, max_size=7), GAP, GAP, st.booleans())
def test_service_is_refused_in_any_case_and_spacing(upper, before, after, silent):
    word = "".join(c.upper() if up else c for c, up in zip("service", upper, strict=True))
    middle = f"SILENT{before}" if silent else ""
    refused(f"ASK {{{word}{before}{middle}{EVIL}{after}{{?s ?p ?o}}}}")


def test_the_word_service_is_no_crime() -> None:
    vet("SELECT ?service WHERE { BIND('SERVICE <x>' AS ?service) # SERVICE\n }")
    vet('SELECT ?service {?service <urn:service> "the service of SERVICE"} # SERVICE')
    vet("PREFIX service: <urn:x> SELECT $service {service:service service:of ?service}")


def test_an_allowed_endpoint_may_be_named_and_no_other_beside_it() -> None:
    good = "http://ok/"
    vet("SELECT * {SERVICE <http://ok/> {?s ?p ?o}}", services=(good,))
    assert good in refused(f"SELECT * {{SERVICE <http://ok/> {{}} SERVICE {EVIL} {{}}}}", (good,))
    refused("SELECT * {BIND(<http://ok/> AS ?e) SERVICE ?e {}}", (good,))
    refused("BASE <http://evil/> SELECT * {SERVICE <http:/> {}}", (good,))
    swallowed = f'SELECT * {{BIND("service <http://ok/> #" AS ?x) SERVICE {EVIL}\n{{?s ?p ?o}}}}'
    refused(swallowed, (good,))
    refused('SELECT * {?s ?p "a"@service}', (good,))  # may be a keyword to the engine


@pytest.mark.parametrize(
    "sparql",
    [
        *("LOAD <file:///etc/passwd>", "# SELECT\nPREFIX a: <urn:a> insert data {a:a a:a a:a}"),
        *("BASE <urn:x> DELETE WHERE {?s ?p ?o}", "DROP ALL", "CLEAR SILENT DEFAULT"),
        *("\\u004COAD <http://x/>", "WITH <urn:own> DELETE {?s ?p ?o} WHERE {?s ?p ?o}"),
    ],
)
def test_updates_do_not_pass_the_door_of_queries(sparql: str) -> None:
    assert "update" in refused(sparql)


@pytest.mark.parametrize(("opening", "closing"), ["{}", "()", "[]"])
def test_brackets_nest_so_deep_and_no_deeper(opening: str, closing: str) -> None:
    vet("ASK " + opening * MAX_DEPTH + closing * MAX_DEPTH)
    assert "nest" in refused("ASK " + opening * (MAX_DEPTH + 1) + closing * (MAX_DEPTH + 1))


def test_brackets_in_strings_and_side_by_side_do_not_nest() -> None:
    vet("ASK {" + "{?s ?p '{{{('} " * 500 + "}")


def test_long_queries_are_refused() -> None:
    check_length("x" * MAX_LENGTH)
    with pytest.raises(QueryRefusedError, match=r"200,000 characters, got 200,001"):
        check_length("x" * (MAX_LENGTH + 1))


@given(st.text(max_size=200))
def test_any_text_is_vetted_or_refused(sparql: str) -> None:
    try:
        vet(sparql)
    except QueryRefusedError as error:
        assert str(error)


def test_no_long_string_begins_where_the_engine_sees_none() -> None:
    # \\q is no escape, so the engine reads two short strings and what stands behind them
    query = "ASK { VALUES ?x { '''a' } GRAPH <urn:own> { ?s ?p ?o } } #\\q'''"
    assert list(keywords_of(query)) == ["ASK", "VALUES", "GRAPH"]
    assert Store().query(query) is not None
    update = "DELETE { } WHERE { VALUES ?x { '''a' } }; CLEAR ALL #\\q'''"
    assert [operation.verb for operation in operations(update)] == ["MODIFY", "CLEAR"]


@pytest.mark.parametrize("text", [r"a\"b", r"a\\", r"\u0041", r"\t\'", "it's"])
def test_strings_end_where_the_engine_ends_them(text: str) -> None:
    query = f'ASK {{ ?s ?p "{text}" }}'
    assert list(keywords_of(query)) == ["ASK"]
    assert not Store().query(query)
