"""One question, several maps: folders and servers alike, and some of them away."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kg.errors import GraphError, QueryError, UnknownCategoryError
from kg.fleet import Fleet, merged
from kg.questions import Table, find_question, shipped_questions
from kg.records import MapUpdate, ObjectRecord
from kg.semantic_map import SemanticMap
from kg.sparql_text import tail_of
from planner.commands import main


def fill(semantic_map: SemanticMap, *existences: float) -> None:
    cup = semantic_map.catalogue.find("cup").iri
    objects = tuple(
        ObjectRecord(
            semantic_map.new_object_iri(), cup, np.array([n, 0.0, 0.0]), 1.0, share, 1, 0.0, 0.0
        )
        for n, share in enumerate(existences)
    )
    semantic_map.apply(MapUpdate(objects=objects))


@pytest.fixture
def folder(tmp_path: Path) -> str:
    path = tmp_path / "north.map"
    with SemanticMap.create(path, base="https://example.org/north/") as semantic_map:
        fill(semantic_map, 0.9, 0.3)
    return str(path)


@pytest.fixture
def server(sparql_server: str) -> str:
    with SemanticMap.create(sparql_server, base="https://example.org/south/") as semantic_map:
        fill(semantic_map, 0.6, 0.8)
    return sparql_server


@pytest.fixture
def fleet(folder: str, server: str) -> Iterator[Fleet]:
    with Fleet([folder, server]) as made:
        yield made


def test_rows_say_whose_they_are_and_keep_the_order_over_all(
    fleet: Fleet, folder: str, server: str
) -> None:
    answer = fleet.query("objects-by-category", category="cup")
    got = [(row["member"], row["existence"]) for row in answer.table.records()]
    assert got == [(folder, 0.9), (server, 0.8), (server, 0.6), (folder, 0.3)]
    assert answer.failures == {}


def test_limit_holds_over_all(fleet: Fleet, folder: str, server: str) -> None:
    text = "SELECT ?e { ?o a here:Cup ; here:existence ?e } ORDER BY DESC(?e) LIMIT 2"
    assert fleet.query(text).table.rows == ((folder, 0.9), (server, 0.8))
    with pytest.raises(QueryError, match="OFFSET"):
        fleet.query(text + " OFFSET 1")


def test_counts_are_each_members_own(fleet: Fleet, folder: str, server: str) -> None:
    table = fleet.query("summary").table
    assert sorted((row["member"], row["count"]) for row in table.records()) == sorted(
        [(folder, 2), (server, 2)]
    )


def test_what_one_map_says_is_bound_in_the_others(fleet: Fleet, folder: str, server: str) -> None:
    first = fleet.query("SELECT ?o { ?o a here:Cup ; here:existence ?e FILTER(?e > 0.7) }").table
    assert len(first.rows) == 2
    again = fleet.bound(first, "SELECT ?o ?e { ?o here:existence ?e } ORDER BY ?e").table
    assert [row[0::2] for row in again.rows] == [(server, 0.8), (folder, 0.9)]
    values = Table(("member", "e"), ((folder, 0.3), (server, 0.6), (folder, 0.3), (folder, None)))
    found = fleet.bound(
        values, "SELECT ?o ?e { ?o here:existence ?e FILTER(?e < 0.7) } ORDER BY ?e"
    )
    # a row without a value binds nothing: it matches whatever there is
    assert sorted(row[2] for row in found.table.rows) == [0.3, 0.3, 0.6, 0.6]
    harmless = Table(("x",), (('"} DROP ALL #',), ("urn:a> <b",)))
    assert fleet.bound(harmless, "SELECT ?x { ?o rdfs:label ?x }").table.rows == ()


def test_binding_too_much_or_nothing_is_refused(fleet: Fleet) -> None:
    many = Table(("x",), tuple((n,) for n in range(2001)))
    for rows in (many, Table(("member",), (("a",),))):
        with pytest.raises(QueryError, match="2,000 rows"):
            fleet.bound(rows, "SELECT ?x { ?o here:x ?x }")


def test_who_is_away_is_named_and_the_others_answer(folder: str, tmp_path: Path) -> None:
    away, gone = "http://127.0.0.1:9", str(tmp_path / "gone.map")
    with Fleet([away, folder, gone]) as fleet:
        answer = fleet.query("objects")
        assert {row["member"] for row in answer.table.records()} == {folder}
        assert "no server answers" in answer.failures[away]
        assert "no map at" in answer.failures[gone]
        # a member that comes back is a member again
        with SemanticMap.create(gone) as back:
            fill(back, 0.5)
        assert len(fleet.query("objects").table.rows) == 3


def test_when_all_are_away_there_is_no_answer() -> None:
    with Fleet(["http://127.0.0.1:9"]) as fleet, pytest.raises(GraphError, match="no member"):
        fleet.query("objects")


def test_a_question_wrong_for_all_is_one_error(fleet: Fleet) -> None:
    with pytest.raises(QueryError, match="line 1, column 17"):
        fleet.query("SELECT * WHERE {")
    with pytest.raises(UnknownCategoryError, match="did you mean banana"):
        fleet.query("located-at", category="bananna")


def test_a_fleet_needs_members_each_once(folder: str) -> None:
    for members in ([], [folder, folder]):
        with pytest.raises(GraphError, match="each once"):
            Fleet(members)


def test_the_command_asks_all_and_fails_where_one_does_not_answer(
    folder: str, server: str, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ["ask", "--member", folder, "--member", server, "summary", "--format", "json"]
    assert main(asked) == 0
    assert {row["member"] for row in json.loads(capsys.readouterr().out)} == {folder, server}

    assert main([*asked, "--member", "http://127.0.0.1:9"]) == 1
    out, err = capsys.readouterr()
    assert len(json.loads(out)) == 2
    assert "no answer from http://127.0.0.1:9" in err


def test_map_and_members_together_are_wrong_usage(folder: str) -> None:
    for words in (
        ["ask", folder, "summary", "--member", folder],
        ["ask", "-e", "ASK {}"],
        ["ask", "--member", folder],
    ):
        with pytest.raises(SystemExit) as stopped:
            main(words)
        assert stopped.value.code == 2


@pytest.mark.parametrize("question", shipped_questions(), ids=lambda question: question.name)
def test_every_shipped_question_is_ordered_by_what_it_selects(question: object) -> None:
    from kg.questions import Question

    assert isinstance(question, Question)
    order = tail_of(question.sparql).order
    assert order.upper().startswith("ORDER BY")
    import re

    if question.name not in ("robot", "why-object"):  # a row a map
        assert set(re.findall(r"\?(\w+)", order)) <= set(question.columns)


@pytest.mark.parametrize(
    ("sparql", "order", "limit", "offset"),
    [
        ("SELECT * { ?s ?p ?o }", "", None, False),
        ("SELECT * { ?s ?p ?o } order by ?s LIMIT 3 OFFSET 2", "order by ?s", 3, True),
        ("SELECT * { { SELECT * { ?a ?b ?c } ORDER BY ?a LIMIT 1 } } LIMIT 7", "", 7, False),
        ('SELECT * { ?s ?p "} LIMIT 9" } # LIMIT 8\nLIMIT 4 OFFSET 0', "", 4, False),
        ("SELECT ?limit { ?s ?p ?limit } ORDER BY ?limit", "ORDER BY ?limit", None, False),
        ("SELECT * { } ORDER BY STRLEN(STR(?a)) ?b VALUES ?x { 1 }", None, None, False),
    ],
)
def test_the_tail_of_a_query_is_read(
    sparql: str, order: str | None, limit: int | None, offset: bool
) -> None:
    tail = tail_of(sparql)
    assert (tail.limit, tail.offset) == (limit, offset)
    assert tail.order == ("ORDER BY STRLEN(STR(?a)) ?b" if order is None else order)


VALUES = st.one_of(st.none(), st.integers(-99, 99), st.floats(-9, 9, allow_nan=False))


@given(st.lists(st.lists(VALUES, max_size=6), min_size=2, max_size=3))
def test_merging_loses_no_row_and_sorts_as_one_map_would(lists: list[list[float | None]]) -> None:
    tables = {f"m{n}": Table(("x",), tuple((x,) for x in xs)) for n, xs in enumerate(lists)}
    rows = merged(tables, "ORDER BY ?x", None).rows
    assert sorted(map(str, rows)) == sorted(
        str((name, *row)) for name, table in tables.items() for row in table.rows
    )
    keys = [-1e9 if x is None else float(x) for _, x in rows]  # type: ignore[arg-type]
    assert keys == sorted(keys)


def test_text_that_looks_like_a_query_does_no_harm() -> None:
    rows = (('"} ASK {',), ("\\",), ("a\nb",))
    tables = {"one": Table(("x",), rows), "two": Table(("x",), ())}
    assert {row[1] for row in merged(tables, "ORDER BY ?x", None).rows} == {row[0] for row in rows}


def test_the_shipped_radius_question_orders_by_distance() -> None:
    assert (
        tail_of(find_question("objects-within-radius").sparql).order == "ORDER BY ?distance ?object"
    )


def test_sparql_text_goes_to_members_too(capsys: pytest.CaptureFixture[str], folder: str) -> None:
    run: Callable[[list[str]], int] = main
    assert run(["ask", "--member", folder, "-e", "ASK { ?o a here:Cup }"]) == 0
    assert "yes" in capsys.readouterr().out
