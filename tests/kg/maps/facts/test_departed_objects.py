"""Objects that left are facts of the map under their own IRIs, and no objects."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from kg.knowledge.ontology.lint import check_map
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import InvalidFactError, QueryParameterError, ShapeError
from kg.model.records import DepartedRecord, MapUpdate, ObjectRecord
from kg.serving.opening import create_map, in_memory_map
from planner.search.goals.status import status

BASE = "http://example.org/lab/"
CUP = f"{BASE}object/1"
ABOUT = f"SELECT ?p ?o WHERE {{ GRAPH graph:map {{ <{CUP}> ?p ?o }} }}"


@pytest.fixture
def chart() -> SemanticMap:
    return in_memory_map(base=BASE)


def cup(chart: SemanticMap) -> ObjectRecord:
    return ObjectRecord(
        iri=CUP,
        category=chart.catalogue.find("cup").iri,
        p_map=np.array([1.0, 2.0, 0.8]),
        confidence=2.7,
        existence=0.9,
        observations=4,
        first_seen=10.0,
        last_seen=20.0,
        labels={chart.catalogue.find("bowl").iri: 0.1},
    )


def departed(chart: SemanticMap, **changed: object) -> DepartedRecord:
    record = DepartedRecord(
        iri=CUP,
        category=chart.catalogue.find("cup").iri,
        p_map=np.array([1.0, 2.0, 0.8]),
        peak=0.96,
        observations=4,
        first_seen=10.0,
        last_seen=20.0,
        found_gone=30.0,
        extent=np.array([0.1, 0.1, 0.15]),
    )
    return replace(record, **changed)  # type: ignore[arg-type]


def leave(chart: SemanticMap, **changed: object) -> int:
    return chart.apply(MapUpdate(removed=(CUP,), departed=(departed(chart, **changed),)))


def test_what_left_is_remembered_and_no_object(chart: SemanticMap) -> None:
    chart.apply(MapUpdate(objects=(cup(chart),)))
    leave(chart)
    assert chart.objects() == ()
    (held,) = chart.departed()
    wanted = departed(chart)
    assert np.allclose(held.p_map, wanted.p_map)
    assert held.extent is not None and np.allclose(held.extent, wanted.extent)
    for name in ("iri", "category", "peak", "observations", "first_seen", "found_gone"):
        assert getattr(held, name) == getattr(wanted, name)
    (row,) = chart.query("departed").records()
    assert (row["object"], row["label"], row["category"], row["x"]) == (CUP, "cup 1", "cup", 1.0)
    assert len(chart.query("objects", least=0.0).rows) == 0
    assert len(chart.query("whereabouts", object=CUP).rows) == 0
    assert check_map(chart.engine) == []


def test_what_comes_back_is_an_object_and_nothing_else(chart: SemanticMap) -> None:
    chart.apply(MapUpdate(objects=(cup(chart),)))
    before = set(chart.query(ABOUT).rows)
    chart.update(
        f"DELETE {{ <{CUP}> rdfs:label ?l }} INSERT {{ GRAPH graph:map "
        f"{{ <{CUP}> rdfs:label 'mug' }} }} WHERE {{ <{CUP}> rdfs:label ?l }}"
    )
    leave(chart)
    chart.apply(MapUpdate(objects=(cup(chart),)))
    assert chart.departed() == ()
    after = set(chart.query(ABOUT).rows)
    assert {str(o) for _, o in after - before} == {"mug"}  # what people called it stays
    assert check_map(chart.engine) == []


def test_what_is_forgotten_leaves_nothing(chart: SemanticMap) -> None:
    leave(chart)
    chart.apply(MapUpdate(removed=(CUP,)))
    assert chart.departed() == ()
    assert len(chart.query(ABOUT).rows) == 0


@pytest.mark.parametrize(
    "changed",
    [
        {"peak": 1.2},
        {"found_gone": 15.0},
        {"observations": 0},
        {"p_map": np.full(3, np.nan)},
        {"extent": np.array([0.1, -0.1, 0.1])},
        {"category": "https://w3id.org/hereabouts#Kitchen"},
        {"iri": f"{BASE}object/2"},
    ],
)
def test_what_is_not_valid_is_refused_and_nothing_written(
    chart: SemanticMap, changed: dict[str, object]
) -> None:
    chart.apply(MapUpdate(objects=(cup(chart),)))
    with pytest.raises(InvalidFactError):
        leave(chart, **changed)
    assert [record.iri for record in chart.objects()] == [CUP]


def test_an_update_that_makes_it_an_object_too_is_refused(chart: SemanticMap) -> None:
    leave(chart)
    with pytest.raises(ShapeError, match="no other class"):
        chart.update(f"INSERT DATA {{ GRAPH graph:map {{ <{CUP}> a here:Cup }} }}")


def test_history_why_and_status_say_that_it_left(tmp_path: Path) -> None:
    with create_map(tmp_path / "a.map", base=BASE) as chart:
        chart.apply(MapUpdate(objects=(cup(chart),)))
        leave(chart)
        *_, last = chart.history.events("object/1")
        assert "left where it stood" in last.changes
        said = chart.history.explain("object/1")
        assert "cup 1 left (1, 2, 0.8) m" in said[0].text
        found = status(chart, "object/1")
        assert (found.value, found.proof.split(":")[0]) == ("gone", "left (1.00, 2.00) in no place")
        chart.update(f"DELETE WHERE {{ <{CUP}> ?p ?o }}")
        assert status(chart, "object/1").proof.startswith("left the map by transaction #3")
        with pytest.raises(QueryParameterError):
            status(chart, "object/7")


@pytest.mark.parametrize("scope", [(), ("objects",), ("object/1",)], ids=str)
def test_restoring_brings_back_or_takes_away(tmp_path: Path, scope: tuple[str, ...]) -> None:
    with create_map(tmp_path / "a.map", base=BASE) as chart:
        empty = chart.sequence
        chart.apply(MapUpdate(objects=(cup(chart),)))
        there = chart.sequence
        leave(chart)
        gone = chart.sequence
        chart.restore(there, only=scope)
        assert ([o.iri for o in chart.objects()], chart.departed()) == ([CUP], ())
        chart.restore(gone, only=scope)
        assert (chart.objects(), [d.iri for d in chart.departed()]) == ((), [CUP])
        assert check_map(chart.engine) == []
        chart.restore(empty, only=scope)
        assert (chart.objects(), chart.departed()) == ((), ())
