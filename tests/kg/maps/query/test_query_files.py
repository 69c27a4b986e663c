"""Questions: the shipped ones answer, parameters are checked, nothing is pasted or reaches out."""

import json
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from kg.maps.query.query_files import ANSWERS, find_query, parse_query_file, shipped_queries
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import QueryError, QueryParameterError, UnknownCategoryError, UnknownQueryError
from kg.model.records import Evidence, MapUpdate, PlaceRecord, RobotRecord
from kg.serving.opening import in_memory_map
from tests.kg.conftest import thing

THINGS = (("chair", 0.5, 0.5), ("chair", 1.5, 0.5), ("banana", 5.5, 0.5), ("apple", -7.0, 2.0))
QUOTES = st.text(st.characters(exclude_categories=["Cs"]), max_size=30)


def build() -> SemanticMap:
    chart = in_memory_map(base="http://example.org/lab/")
    seen = Evidence("frame-7", "run", 100.0, (1, 2, 30, 40), 0.75, "detector")
    objects = tuple(
        thing(
            chart,
            label,
            p_map=np.array([x, y, 1.0]),
            existence=0.9 - 0.1 * number,
            last_seen=100.0,
            observations=4,
            place=chart.place_iri(1) if label == "chair" else None,
            evidence=seen,
        )
        for number, (label, x, y) in enumerate(THINGS)
    )
    office, kitchen = (chart.catalogue.find(name, "place").iri for name in ("office", "kitchen"))
    places = (
        PlaceRecord(chart.place_iri(1), "study", 0, 2, 0, 2, 5, {office: 0.7, kitchen: 0.3}),
        PlaceRecord(chart.place_iri(2), "place 2", 2, 9, 0, 2),
    )
    chart.apply(MapUpdate(objects, (), places, RobotRecord(np.array([3.0, 1, 0]), 0.5, 100.0)))
    return chart


CHART = build()


def column(name: str, question: str, **parameters: object) -> list[object]:
    return [row[name] for row in CHART.query(question, **parameters).records()]


def test_every_shipped_question_says_what_it_is_and_gives_the_columns_it_promises() -> None:
    given_values = {"category": "chair", "place": "study", "object": f"{CHART.base}object/1"}
    given_values |= {"one": f"{CHART.base}object/1", "other": f"{CHART.base}object/2"}
    numbers = {"x": 0, "y": 0, "xmin": 0, "xmax": 1, "ymin": 0, "ymax": 1}
    for question in shipped_queries():
        assert question.summary
        assert question.columns
        assert question.answer in ANSWERS
        assert "ORDER BY" in question.sparql
        values = {**given_values, **numbers}
        named = {p.name: values[p.name] for p in question.parameters if p.default is None}
        assert CHART.query(question.name, **named).columns == question.columns


def test_objects_come_surest_first_with_words_not_only_iris() -> None:
    assert column("label", "objects") == ["chair 1", "chair 2", "banana 3", "apple 4"]
    first = CHART.query("objects").records()[0]
    assert (first["category"], first["place"]) == ("chair", "study")
    assert first["lastSeen"] == datetime.fromtimestamp(100, UTC)


def test_an_object_in_a_place_without_a_name_is_still_found() -> None:
    chart = build()
    lost = replace(chart.objects()[0], place=chart.place_iri(99))
    chart.apply(MapUpdate(objects=(lost,)))
    for question in ("objects", "objects-by-category", "objects-within-radius"):
        values = {"category": "chair", "x": 0, "y": 0, "radius": 3, "least": 0}
        named = {p.name: values[p.name] for p in find_query(question).parameters}
        rows = {row["label"]: row["place"] for row in chart.query(question, **named).records()}
        assert rows["chair 1"] is None
        assert rows["chair 2"] == "study"


def test_improbable_objects_are_listed_and_counted_on_request() -> None:
    chart = build()
    first, *_ = chart.objects("chair")
    chart.apply(MapUpdate(objects=(replace(first, existence=0.49),)))
    for question, parameters in (
        ("objects", {}),
        ("objects-by-category", {"category": "chair"}),
        ("objects-within-radius", {"x": 0, "y": 0}),
        ("objects-in-box", {"xmin": -9, "xmax": 9, "ymin": -9, "ymax": 9}),
        ("objects-in-place", {"place": "study"}),
    ):
        listed = {
            least: {r["object"] for r in chart.query(question, **parameters, **least_).records()}
            for least, least_ in ((None, {}), (0.49, {"least": 0.49}), (0.95, {"least": 0.95}))
        }
        assert listed[None] == listed[0.49] - {first.iri} != listed[0.49]
        assert first.iri not in listed[0.95]
    counts = (chart.query("summary", **least).records() for least in ({}, {"least": 0}))
    assert [{r["category"]: r["count"] for r in rows}["chair"] for rows in counts] == [1, 2]


def test_a_supercategory_finds_what_is_below_it() -> None:
    assert column("label", "objects-by-category", category="food") == ["banana 3", "apple 4"]
    assert column("label", "objects-by-category", category="Chairs") == ["chair 1", "chair 2"]


@settings(max_examples=40)
@given(st.floats(-30, 30), st.floats(-30, 30), st.floats(0, 40) | st.just(1e4), st.booleans())
def test_the_cells_never_change_what_a_distance_finds(x, y, radius, box):
    name = "objects-in-box" if box else "objects-within-radius"
    values: dict[str, object] = {"x": x, "y": y, "radius": radius}
    if box:
        values = {"xmin": x, "xmax": x + radius, "ymin": y, "ymax": y + radius}
    without = replace(find_query(name), cells=())
    assert CHART.query(name, **values) == CHART.query(without, **values)


def test_within_radius_finds_what_is_near_the_nearest_first() -> None:
    rows = CHART.query("objects-within-radius", x=0.0, y=0.0, radius=6.0).records()
    assert [(row["label"], round(float(str(row["distance"])), 2)) for row in rows] == [
        ("chair 1", 0.71),
        ("chair 2", 1.58),
        ("banana 3", 5.52),
    ]
    assert column("label", "objects-within-radius", x=0.5, y=0.5, radius=-3) == []
    assert len(column("label", "objects-within-radius", x=1e308, y=0, radius=1e308)) == len(THINGS)


def test_a_place_is_named_as_people_would() -> None:
    for place in ("study", "STUDY", "http://example.org/lab/place/1"):
        assert column("label", "objects-in-place", place=place) == ["chair 1", "chair 2"]
    assert column("label", "objects-in-place", place=2) == []
    with pytest.raises(QueryParameterError, match="no place is called 'attic'; there are: study"):
        CHART.query("objects-in-place", place="attic")


def test_places_and_their_beliefs() -> None:
    assert column("category", "places") == ["office", None]
    assert column("belief", "place-beliefs") == [0.7, 0.3]
    assert column("category", "places-above-belief", threshold=0.5) == ["office"]


def test_why_an_object_is_in_the_map() -> None:
    (why,) = CHART.query("why-object", object=f"{CHART.base}object/3").records()
    assert (why["category"], why["frame"], why["box"], why["score"]) == (
        "banana",
        "frame-7",
        "1 2 30 40",
        0.75,
    )


def test_summary_and_robot() -> None:
    assert column("category", "summary") == ["chair", "apple", "banana"]
    assert column("count", "summary") == [2, 1, 1]
    (robot,) = CHART.query("robot").records()
    assert (robot["x"], robot["heading"], robot["place"]) == (3.0, 0.5, "place 2")


@pytest.mark.parametrize(
    ("question", "parameters", "error", "reason"),
    [
        ("placesof", {}, UnknownQueryError, "no query 'placesof'; did you mean places"),
        ("objects-within-radius", {"x": 1}, QueryParameterError, "needs y"),
        (
            "objects-within-radius",
            {"x": 1, "y": 1, "radius": "two"},
            QueryParameterError,
            "radius must be a number, got 'two'",
        ),
        ("objects-within-radius", {"x": "nan", "y": 1}, QueryParameterError, "x must be a number"),
        ("objects-within-radius", {"x": True, "y": 1}, QueryParameterError, "x must be a number"),
        ("objects-within-radius", {"x": 10**400, "y": 1}, QueryParameterError, "x must be a num"),
        ("whereabouts", {"object": "\ud800"}, QueryParameterError, "nothing is called"),
        ("objects-in-place", {"place": "\ud800"}, QueryParameterError, "called"),
        (
            "objects-by-category",
            {"categry": "chair"},
            QueryParameterError,
            "no parameter 'categry'; it takes: category, least; did you mean",
        ),
        ("objects-by-category", {"category": "bananna"}, UnknownCategoryError, "banana"),
        ("robot", {"x": 1}, QueryParameterError, "takes none"),
        ("why-object", {"object": "not an iri"}, QueryParameterError, "must be an IRI"),
    ],
)
def test_wrong_questions_are_answered_with_what_would_have_worked(
    question: str, parameters: dict[str, object], error: type[Exception], reason: str
) -> None:
    with pytest.raises(error, match=reason) as caught:
        CHART.query(question, **parameters)
    assert "\n" not in str(caught.value)


@example("sosa")  # the name of a prefix alone is a text
@example("here")
@given(QUOTES)
def test_text_reaches_the_query_as_a_value_never_as_sparql(text: str) -> None:
    assert CHART.query("SELECT ($given AS ?back) WHERE { }", given=text).rows == ((text,),)


def test_dollars_in_strings_comments_and_iris_are_left_alone() -> None:
    table = CHART.query(
        "SELECT ?a ?b WHERE { # costs $x\n BIND('$x' AS ?a) BIND(<http://e.org/$x#$x> AS ?b) }"
    )
    assert table.rows == (("$x", "http://e.org/$x#$x"),)


@pytest.mark.parametrize(
    "sparql",
    [
        "SELECT * WHERE { service silent <http://127.0.0.1:9/> { ?s ?p ?o } }",
        "SELECT * WHERE { \\u0053ERVICE <http://127.0.0.1:9/> { ?s ?p ?o } }",
    ],
)
def test_a_question_cannot_reach_out(sparql: str) -> None:
    with pytest.raises(QueryError, match="SERVICE is refused"):
        CHART.query(sparql)


@pytest.mark.parametrize(
    "sparql",
    [
        "DELETE WHERE { ?s ?p ?o }",
        "PREFIX a: <urn:a> INSERT DATA { a: a: a: }",
        "CLEAR GRAPH <urn:g>",
    ],
)
def test_a_question_cannot_write(sparql: str) -> None:
    before = set(CHART.engine)
    with pytest.raises(QueryError, match="is an update"):
        CHART.query(sparql)
    assert set(CHART.engine) == before


def test_bad_sparql_is_one_line_with_its_position() -> None:
    with pytest.raises(QueryError, match="line 2, column 6") as caught:
        CHART.query("SELECT ?s WHERE {\n ?s }")
    assert "\n" not in str(caught.value)


def test_answers_as_json_csv_and_turtle() -> None:
    table = CHART.query("SELECT ?l ?x WHERE { ?o a here:Banana ; rdfs:label ?l ; here:x ?x }")
    assert json.loads(table.serialise("json")) == [{"l": "banana 3", "x": 5.5}]
    assert table.serialise("csv") == "l,x\nbanana 3,5.5\n"
    with pytest.raises(QueryError, match="choose json or csv"):
        table.serialise("ttl")
    with pytest.raises(QueryError, match="json, csv, ttl"):
        table.serialise("xml")
    built = CHART.query("CONSTRUCT { ?o a here:Fruit } WHERE { ?o a here:Banana }")
    assert "a here:Fruit ." in built.serialise("ttl")
    assert built.columns == ("subject", "predicate", "object")
    assert json.loads(CHART.query("ASK { ?o a here:Banana }").to_json()) == [{"answer": True}]
    times = CHART.query("SELECT (MAX(?t) AS ?last) WHERE { ?o here:lastSeen ?t }")
    assert json.loads(times.to_json()) == [{"last": "1970-01-01T00:01:40Z"}]


def test_a_query_file_of_ones_own(tmp_path: Path) -> None:
    path = tmp_path / "heavy-use.rq"
    path.write_text(
        "#+ summary: Objects seen at least so often\n"
        "#+ parameters:\n"
        "#+   least (integer = 4): observations\n"
        "#+ columns: label\n"
        "SELECT ?label WHERE { ?o here:observationCount ?n ; rdfs:label ?label "
        "FILTER(?n >= $least) } ORDER BY ?label\n"
    )
    assert len(CHART.query(path).rows) == 4
    assert CHART.query(path, least="5").rows == ()
    with pytest.raises(QueryParameterError, match="whole number"):
        CHART.query(path, least=4.5)
    with pytest.raises(QueryError, match="cannot read"):
        CHART.query(tmp_path / "none.rq")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("#+ summary: x\nSELECT ?s WHERE { ?s ?p $o }", r"\$o has neither"),
        ("#+ parameters:\n#+   q (iri): x\nSELECT ?s WHERE { ?s ?p ?o }", "declared but"),
        ("#+ parameters:\n#+   o (number): x\nSELECT ?s WHERE { ?s ?p $o }", "no type 'number'"),
        ("#+ nonsense\nSELECT ?s WHERE { ?s ?p ?o }", "line 1 is no header line"),
        ("#+ answer: quick\nSELECT ?s WHERE { ?s ?p ?o }", "a lookup, a listing or a survey"),
        ("#+ cells: disc x y r\nSELECT ?s WHERE { ?s ?p ?o }", "cells must be"),
    ],
)
def test_a_malformed_query_file_says_where(text: str, reason: str) -> None:
    with pytest.raises(QueryError, match=reason):
        parse_query_file(text, "mine")


def test_a_header_that_promises_other_columns_is_found(tmp_path: Path) -> None:
    path = tmp_path / "mine.rq"
    path.write_text("#+ columns: a, b\nSELECT ?a WHERE { BIND(1 AS ?a) }")
    with pytest.raises(QueryError, match="promises the columns a, b, the query gives a"):
        CHART.query(path)
