"""Syntax errors name the cause, where the parser names what it would have taken instead."""

import pytest

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import QueryError
from kg.serving.opening import in_memory_map


@pytest.fixture(scope="module")
def semantic_map():  # type: ignore[no-untyped-def]
    with in_memory_map() as made:
        yield made


@pytest.mark.parametrize(
    ("sparql", "cause"),
    [
        ("SELECT ?x { ?x wdt:P31 1 }", "PREFIX wdt: <http://www.wikidata.org/prop/direct/>"),
        ("SELECT ?x { ?x a heer:Cup }", "the prefix heer: is not declared; did you mean here:?"),
        ("SELECT ?x { ?x a Cup }", "'Cup' is neither a keyword nor a term; did you mean here:Cup?"),
        ("SELECT ?x { ?x label ?y }", "did you mean rdfs:label?"),
        ("SELECT x { ?x a here:Cup }", "did you mean ?x?"),
        ("SELEC ?x { ?x a here:Cup }", "it begins with 'SELEC'; did you mean SELECT?"),
        ("SELECT ?x { ?x here:x ?y FILTR(?y > 3) }", "did you mean FILTER?"),
        ("SELECT ?x { ?x a here:Cup", "the { at line 1, column 11 is not closed"),
        ("SELECT ?x {\n ?x a here:Cup }}", "the } at line 2, column 17 closes nothing"),
        ("SELECT ?x { FILTER(1 < (2 } }", "is not closed; a ) is missing"),
        ('SELECT ?x { ?x rdfs:label "cup }', "the string that begins at line 1, column 27"),
        ("SELECT ?x { ?x here:x }", "'}' comes too early"),
        ("SELECT ?x { ?x a here:Cup } LIMIT", "the text ends after 'LIMIT'"),
        ("SELECT COUNT(?x) { ?x a here:Cup }", "(COUNT(...) AS ?name)"),
        ("SELECT ?x { ?x a <here:Cup }", "the IRI that begins at line 1, column 18 has a space"),
        (
            "SELECT ?x { FILTER(?x < 3 && ?x = <here:Cup) }",
            "the IRI that begins at line 1, column 35",
        ),
        ("SELECT ?x, ?y { ?x a ?y }", "no commas"),
        ("SELECT (CONCAT('a', 'b') AS ?y) { ?x here:x > 3 }", "a '.', ';' or bracket may be"),
        ("SELECT ?x { ?x here:x ?y FILTER ?y > 3 }", "needs brackets: FILTER(?y ...)"),
        ("SELECT ?x { ?x a here:Cup } ORDER ?x", "after ORDER comes BY"),
        ("SELECT ?x { ?x a ?y OPTIONAL ?x here:x ?z }", "needs braces: OPTIONAL { ?x ... }"),
        ("SELECT ?x { ?x here:x ?y FILTER(?y == 3) }", "by =, and not by =="),
        ("SELECT ?x { ?x here:x ?y FILTER(?y > 3 and ?y < 4) }", "did you mean &&?"),
        ("SELECT ?x ?y { ?x a ?y } GROUP BY ?x", "the SELECT contains a variable that is unbound"),
    ],
)
def test_the_cause_of_a_syntax_error(semantic_map: SemanticMap, sparql: str, cause: str) -> None:
    with pytest.raises(QueryError) as refused:
        semantic_map.query(sparql)
    message = str(refused.value)
    assert cause in message
    assert "does not parse at line" in message
    assert len(message) < 250
    assert "\n" not in message


@pytest.mark.parametrize(
    ("sparql", "cause"),
    [
        ("INSERT DATA { <object/1> a Cup }", "did you mean here:Cup?"),
        ("INSERT DATA { <object/1> wdt:P31 1 }", "the prefix wdt: is not declared"),
        ("INSRT DATA { <object/1> a here:Cup }", "did you mean INSERT?"),
        ("DELETE DATA { <object/1> a here:Cup ", "is not closed; a } is missing"),
    ],
)
def test_the_cause_of_a_syntax_error_of_an_update(semantic_map, sparql, cause):
    with pytest.raises(QueryError) as refused:
        semantic_map.update(sparql)
    assert cause in str(refused.value)
