"""Causes of errors are named at each door that takes a query."""

import pytest
import requests

from tests.doors.doors import House, RefusedError, answered, command, tool

CASES = (
    ("SELECT ?x { ?x wdt:P31 wd:Q5 }", "the prefix wdt: is not declared"),
    ("SELECT ?x { ?x a Cup }", "did you mean here:Cup?"),
    ("SELECT ?x { ?x a here:Cup", "a } is missing"),
)
ABSENT = (
    ("SELECT ?x { ?x geo:hasGeometry ?g }", "has geo:hasGeometry, though exports may"),
    ("SELECT ?x { ?x here:hasObject ?y }", "states its inverse: write ^here:inPlace"),
    ("SELECT ?x { GRAPH graph:mpa { ?x ?p ?g } }", "no graph graph:mpa"),
    (
        "SELECT ?x { GRAPH graph:map { ?x a here:Food } }",
        "here:Food follows from it in graph:inferred",
    ),
    (
        "SELECT ?x FROM graph:map { { ?x a here:Food } }",
        "here:Food follows from it in graph:inferred",
    ),
)


def _of_python(house: House, sparql: str) -> str:
    return " ".join(house.map.query(sparql).notes)


def _of_get(house: House, sparql: str) -> str:
    answer = answered(requests.get(house.sparql, {"query": sparql}, timeout=120))
    return answer.headers.get("Here-Note", "")


def _of_post(house: House, sparql: str) -> str:
    answer = answered(requests.post(house.sparql, {"query": sparql}, timeout=120))
    return answer.headers.get("Here-Note", "")


def _of_the_command_line(house: House, sparql: str) -> str:
    return command("ask", house.folder, "-e", sparql)


def _of_agents(house: House, sparql: str) -> str:
    return " ".join(tool(house, "ask_sparql", query=sparql)["notes"])


DOORS = (_of_python, _of_get, _of_post, _of_the_command_line, _of_agents)


@pytest.mark.parametrize("door", DOORS)
def test_a_syntax_error_names_its_cause(house: House, door) -> None:  # type: ignore[no-untyped-def]
    for sparql, cause in CASES:
        with pytest.raises(Exception) as refused:
            door(house, sparql)
        assert cause in str(refused.value)


@pytest.mark.parametrize("door", [door for door in DOORS if door is not _of_the_command_line])
def test_what_the_map_lacks_is_told(house: House, door) -> None:  # type: ignore[no-untyped-def]
    for sparql, note in ABSENT:
        assert note in door(house, sparql)
    for sparql in ("?x a here:Cup", "?x a here:Food", "GRAPH graph:map { ?x a here:Cup }"):
        assert door(house, f"SELECT ?x {{ {sparql} }}") == ""


def test_an_update_that_deletes_nothing_says_why(house: House) -> None:
    update = "DELETE DATA { here:Tie here:locatedAt here:Bedroom }"
    headers = {"Content-Type": "application/sparql-update", **house.bearer}
    answer = answered(requests.post(house.sparql, update, headers=headers, timeout=120))
    assert "it is in graph:ontology: write GRAPH graph:ontology" in answer.json()["note"]


def test_a_warning_of_an_ontology_is_in_the_answer(house: House) -> None:
    url = f"{house.server.url}graphs/ontology"
    before = requests.get(url, headers={"Accept": "application/n-triples"}, timeout=120)
    line = (
        "<https://w3id.org/hereabouts#Frisbee> <http://www.w3.org/2002/07/owl#deprecated> "
        '"true"^^<http://www.w3.org/2001/XMLSchema#boolean> .\n'
    )
    headers = {"Content-Type": "application/n-triples", **house.bearer}
    answer = answered(
        requests.put(url, before.text + line, headers=headers, params={}, timeout=120)
    )
    (warning,) = answer.json()["warnings"]
    assert "owl:deprecated is not used" in warning["message"]
    with pytest.raises(RefusedError, match="edit the ontology files and reload them"):
        answered(requests.post(url, line.replace("Frisbee", "Cup"), headers=headers, timeout=120))


def test_a_remote_context_is_refused_in_our_words(house: House) -> None:
    document = '{"@context": "https://schema.org/", "@id": "urn:x", "name": "x"}'
    headers = {"Content-Type": "application/ld+json", **house.bearer}
    for url in ("graphs/ontology", "graphs?graph=urn:mine"):
        with pytest.raises(RefusedError, match="a remote @context is not fetched"):
            answered(requests.put(house.server.url + url, document, headers=headers, timeout=120))
