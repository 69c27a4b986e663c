"""The SPARQL 1.1 Protocol's update operation, case by case as its specification has them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from conftest import Served


MAP = "https://w3id.org/hereabouts/graph/map"
ASSERTIONS = "https://example.org/graphs/notes"
CUP = "<https://example.org/maps/flat/object/1>"
NOTE = f'INSERT DATA {{ GRAPH graph:map {{ {CUP} rdfs:comment "chipped" }} }}'
NOTES = f"SELECT ?note ?g WHERE {{ GRAPH ?g {{ {CUP} rdfs:comment ?note }} }} ORDER BY ?g ?note"


def test_update_tells_what_it_changed_and_is_one_commit_in_its_writers_name(served: Served) -> None:
    heard = []
    served.map.subscriptions.listen(heard.append)
    told = served.write(NOTE)
    assert told.json() == {"sequence": served.map.sequence, "added": 1, "removed": 0}
    (change,) = heard
    assert change.cause.kind == "update"
    assert change.cause.by == "ann"
    again = served.write(NOTE)
    assert again.json() == {"sequence": served.map.sequence, "added": 0, "removed": 0}
    assert len(heard) == 1


def test_update_without_graph_writes_graph_map(served: Served) -> None:
    served.write(f'INSERT DATA {{ {CUP} rdfs:comment "chipped" }}')
    assert served.rows(NOTES) == [{"note": "chipped", "g": MAP}]


def copy_comments(served: Served, update: str, **given: str | list[str]) -> object:
    return served.post("sparql", data={"update": update, **given}, headers=served.bearer())


@pytest.fixture
def noted(served: Served) -> Served:
    """The cup has a comment in graph:map and another in graph:assertions."""
    for graph, note in ((MAP, "perceived"), (ASSERTIONS, "asserted")):
        done = served.write(f'INSERT DATA {{ GRAPH <{graph}> {{ {CUP} rdfs:comment "{note}" }} }}')
        assert done.status_code == 200, done.text
    return served


COPY = (
    f"INSERT {{ GRAPH graph:map {{ {CUP} rdfs:label ?note }} }} WHERE {{ ?s rdfs:comment ?note }}"
)


def labels(served: Served) -> set[str]:
    query = f"SELECT ?label WHERE {{ GRAPH graph:map {{ {CUP} rdfs:label ?label }} }}"
    return {row["label"] for row in served.rows(query)} - {"cup 1"}


def test_using_and_using_named_together(noted: Served) -> None:
    update = (
        f"INSERT {{ GRAPH graph:map {{ {CUP} rdfs:label ?both }} }} WHERE {{ {CUP} rdfs:comment ?a "
        f". GRAPH ?g {{ {CUP} rdfs:comment ?b }} BIND(CONCAT(?a, '+', ?b) AS ?both) }}"
    )
    given = {"using-graph-uri": MAP, "using-named-graph-uri": ASSERTIONS}
    copy_comments(noted, update, **given)
    assert labels(noted) == {"perceived+asserted"}


def test_using_reaches_delete_where_and_every_operation(noted: Served) -> None:
    update = (
        f"# WHERE\nDELETE WHERE {{ {CUP} rdfs:label ?where }} ;\n"
        f"DELETE {{ GRAPH <https://example.org/graphs/notes> {{ ?s rdfs:comment ?note }} }} "
        f"WHERE {{ ?s rdfs:comment ?note }}"
    )
    answer = copy_comments(noted, update, **{"using-graph-uri": ASSERTIONS})
    assert answer.status_code == 200, answer.text
    assert noted.rows(NOTES) == [{"note": "perceived", "g": MAP}]


@pytest.mark.parametrize("clause", ["USING", "USING NAMED", "WITH"])
def test_graphs_named_twice_over_are_a_conflict(noted: Served, clause: str) -> None:
    if clause == "WITH":
        update = f"WITH graph:map {COPY}"
    else:
        update = COPY.replace("WHERE", f"{clause} graph:map WHERE")
    answer = copy_comments(noted, update, **{"using-graph-uri": ASSERTIONS})
    assert answer.status_code == 400
    assert "USING" in answer.text
    assert labels(noted) == set()


def test_base_of_an_update_resolves_its_iris(served: Served) -> None:
    update = f'BASE <{CUP[1:-2]}> INSERT DATA {{ GRAPH graph:map {{ <1> rdfs:comment "based" }} }}'
    assert served.write(update).status_code == 200
    assert served.rows(NOTES) == [{"note": "based", "g": MAP}]


def refused(served: Served, status: int, answer: object) -> None:
    assert answer.status_code == status, answer.text  # type: ignore[attr-defined]
    assert answer.text.count("\n") == 1  # type: ignore[attr-defined]
    assert served.rows(NOTES) == []


def test_a_time_that_cannot_be_compared_is_refused_in_words(served: Served) -> None:
    before = served.map.sequence
    answer = served.write(
        f"DELETE {{ {CUP} here:lastSeen ?t }} "
        f'INSERT {{ {CUP} here:lastSeen "-0044-03-15T00:00:00Z"^^xsd:dateTime }} '
        f"WHERE {{ {CUP} here:lastSeen ?t }}"
    )
    assert answer.status_code == 422
    assert "times of the years 1 to 9999 work" in answer.text
    assert served.map.sequence == before


def test_query_and_update_in_one_form_are_refused(lasting: Served) -> None:
    both = {"update": NOTE, "query": "ASK {}"}
    refused(lasting, 400, lasting.post("sparql", data=both, headers=lasting.bearer()))


@pytest.mark.parametrize("update", ["INSERT nothing", "INSERT DATA { ?s ?p ?o }", "SELECT * {}"])
def test_update_that_does_not_parse_is_refused(lasting: Served, update: str) -> None:
    refused(lasting, 400, lasting.write(update))


@pytest.mark.parametrize(
    "update",
    [
        "LOAD <http://127.0.0.1:1/> INTO GRAPH graph:map",
        "LOAD SILENT <file:///etc/passwd> INTO GRAPH graph:map",
        "INSERT { ?s ?p ?o } WHERE { SERVICE <http://127.0.0.1:1/> { ?s ?p ?o } }",
    ],
)
def test_update_that_reaches_out_is_refused(lasting: Served, update: str) -> None:
    before = lasting.map.sequence
    assert lasting.write(update).status_code in (400, 403)
    assert lasting.map.sequence == before


@pytest.mark.parametrize(
    "authorization",
    [
        "Bearer a-token-of-the-tests-012",
        "Bearer ",
        "Basic YTpi",
        "a-token-of-the-tests-0123",
        "Bearer \xff",
    ],
)
def test_update_with_a_wrong_token_is_unauthorised(lasting: Served, authorization: str) -> None:
    headers = {"Authorization": authorization.encode("latin-1")}
    answer = lasting.post("sparql", data={"update": NOTE}, headers=headers)
    refused(lasting, 401, answer)
    assert "a-token" not in answer.text
