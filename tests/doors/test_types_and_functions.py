"""Superclasses and extension functions give the same answer at every door and in every spelling."""

import pytest

from kg.model import vocabulary as v
from kg.rdf.sparql.engine_gaps import FUNCTIONS
from tests.doors.doors import READING, UPDATING, House, RefusedError

BANANA, CUP, BED = "object/1", "object/2", "object/3"
#: each must match; a conjunction, since every door costs seconds
SPELLINGS = (
    *("?thing a here:Food", "VALUES ?c1 { here:Food } ?thing a ?c1"),
    *("?thing a ?c2 FILTER(?c2 = here:Food)", "BIND(here:Food AS ?c3) ?thing a ?c3"),
    *("here:Food ^a ?thing", "?thing (a|rdf:type) here:Food"),
    "VALUES ?c4 { here:Food } ?thing a/rdfs:subClassOf* ?c4",
    *("FILTER EXISTS { ?thing a here:Food }", "GRAPH ?g { ?thing a here:Food }"),
    "{ SELECT ?thing { ?thing a here:Food } GROUP BY ?thing HAVING(COUNT(*) = 1) }",
)
#: what only the things match that have none of the spellings
NEGATIVE = (
    "?thing here:existence ?e MINUS { ?thing a here:Food } "
    "FILTER NOT EXISTS { ?thing a ?d . VALUES ?d { here:Food } }"
)
AREA = '"POLYGON ((0 0, 4 0, 4 2, 0 2, 0 0))"^^geo:wktLiteral'
CALLS = {
    v.MATH_SQRT: (f"?thing here:x ?x FILTER(<{v.MATH_SQRT}>(?x * ?x) > 2.5)", {CUP, BED, "robot"}),
    v.GEOF_SF_WITHIN: (
        "?thing here:existence ?e ; here:x ?x ; here:y ?y FILTER(geof:sfWithin(STRDT(CONCAT("
        f'"POINT (", STR(?x), " ", STR(?y), ")"), geo:wktLiteral), {AREA}))',
        {CUP},
    ),
}


def found(house: House, door: str, pattern: str) -> set[str]:
    return {thing.removeprefix(house.map.base) for thing in READING[door](house, pattern)}


@pytest.mark.parametrize("door", READING)
def test_a_superclass_is_found_in_every_spelling(house: House, door: str) -> None:
    assert found(house, door, " ".join(f"{{ {one} }}" for one in SPELLINGS[:7])) == {BANANA}
    assert found(house, door, f"{SPELLINGS[0]} . {' '.join(SPELLINGS[7:])}") == {BANANA}
    assert found(house, door, NEGATIVE) == {CUP, BED}


@pytest.mark.parametrize("door", READING)
@pytest.mark.parametrize("function", [str(name.value) for name in FUNCTIONS])
def test_a_function_answers_at_every_door(house: House, door: str, function: str) -> None:
    pattern, expected = CALLS[function]
    assert found(house, door, pattern) & {BANANA, CUP, BED} == expected & {BANANA, CUP, BED}


@pytest.mark.parametrize("door", UPDATING)
def test_an_inferred_type_cannot_be_deleted(house: House, door: str) -> None:
    silent = door == "SPARQLUpdateStore"  # which hides the body of a refusal
    with pytest.raises(
        RefusedError, match=None if silent else "here:Banana: delete or change that"
    ):
        UPDATING[door](house, f"DELETE DATA {{ <{house.map.base}{BANANA}> a here:Food }}")
    with pytest.raises(RefusedError, match=None if silent else "may not write graph:inferred"):
        text = f"GRAPH graph:inferred {{ <{house.map.base}{CUP}> a here:Food }}"
        UPDATING[door](house, f"INSERT DATA {{ {text} }}")
