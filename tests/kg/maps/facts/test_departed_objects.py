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
from kg.serving.opening import create_map
from planner.search.goals.status import status

BASE = "https://example.org/map/"
CUP = f"{BASE}object/1"
ABOUT = f"SELECT ?p ?o WHERE {{ GRAPH graph:map {{ <{CUP}> ?p ?o }} }}"


def cup(semantic_map: SemanticMap) -> ObjectRecord:
    return ObjectRecord(
        iri=CUP,
        category=semantic_map.catalogue.find("cup").iri,
        p_map=np.array([1.0, 2.0, 0.8]),
        confidence=2.7,
        existence=0.9,
        observations=4,
        first_seen=10.0,
        last_seen=20.0,
        labels={semantic_map.catalogue.find("bowl").iri: 0.1},
    )


def departed(semantic_map: SemanticMap, **changed: object) -> DepartedRecord:
    record = DepartedRecord(
        iri=CUP,
        category=semantic_map.catalogue.find("cup").iri,
        p_map=np.array([1.0, 2.0, 0.8]),
        peak=0.96,
        observations=4,
        first_seen=10.0,
        last_seen=20.0,
        found_gone=30.0,
        extent=np.array([0.1, 0.1, 0.15]),
        yaw=0.3,
    )
    return replace(record, **changed)  # type: ignore[arg-type]


def leave(semantic_map: SemanticMap, **changed: object) -> int:
    return semantic_map.apply(
        MapUpdate(removed=(CUP,), departed=(departed(semantic_map, **changed),))
    )


def test_what_left_is_remembered_and_no_object(semantic_map: SemanticMap) -> None:
    semantic_map.apply(MapUpdate(objects=(cup(semantic_map),)))
    leave(semantic_map)
    assert semantic_map.objects() == ()
    (held,) = semantic_map.departed()
    wanted = departed(semantic_map)
    assert np.allclose(held.p_map, wanted.p_map)
    assert held.extent is not None and np.allclose(held.extent, wanted.extent)
    for name in ("iri", "category", "peak", "observations", "first_seen", "found_gone", "yaw"):
        assert getattr(held, name) == getattr(wanted, name)
    (row,) = semantic_map.query("departed").records()
    assert (row["object"], row["label"], row["category"], row["x"]) == (CUP, "cup 1", "cup", 1.0)
    assert len(semantic_map.query("objects", least=0.0).rows) == 0
    assert len(semantic_map.query("whereabouts", object=CUP).rows) == 0
    assert check_map(semantic_map.engine) == []


def test_what_comes_back_is_an_object_and_nothing_else(semantic_map: SemanticMap) -> None:
    semantic_map.apply(MapUpdate(objects=(cup(semantic_map),)))
    before = set(semantic_map.query(ABOUT).rows)
    semantic_map.update(
        f"DELETE {{ <{CUP}> rdfs:label ?l }} INSERT {{ GRAPH graph:map "
        f"{{ <{CUP}> rdfs:label 'mug' }} }} WHERE {{ <{CUP}> rdfs:label ?l }}"
    )
    leave(semantic_map)
    semantic_map.apply(MapUpdate(objects=(cup(semantic_map),)))
    assert semantic_map.departed() == ()
    after = set(semantic_map.query(ABOUT).rows)
    assert {str(o) for _, o in after - before} == {"mug"}  # what people called it stays
    assert check_map(semantic_map.engine) == []


def test_what_is_forgotten_leaves_nothing(semantic_map: SemanticMap) -> None:
    leave(semantic_map)
    semantic_map.apply(MapUpdate(removed=(CUP,)))
    assert semantic_map.departed() == ()
    assert len(semantic_map.query(ABOUT).rows) == 0


def test_what_was_seen_once_may_leave(semantic_map: SemanticMap) -> None:
    semantic_map.apply(MapUpdate(objects=(cup(semantic_map),)))
    leave(semantic_map, observations=1)
    assert semantic_map.departed()[0].observations == 1


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
    semantic_map: SemanticMap, changed: dict[str, object]
) -> None:
    semantic_map.apply(MapUpdate(objects=(cup(semantic_map),)))
    with pytest.raises(InvalidFactError):
        leave(semantic_map, **changed)
    assert [record.iri for record in semantic_map.objects()] == [CUP]


def test_an_update_that_makes_it_an_object_too_is_refused(semantic_map: SemanticMap) -> None:
    leave(semantic_map)
    with pytest.raises(ShapeError, match="no other class"):
        semantic_map.update(f"INSERT DATA {{ GRAPH graph:map {{ <{CUP}> a here:Cup }} }}")


def test_history_why_and_status_say_that_it_left(tmp_path: Path) -> None:
    with create_map(tmp_path / "a.map", base=BASE) as semantic_map:
        semantic_map.apply(MapUpdate(objects=(cup(semantic_map),)))
        leave(semantic_map, found_gone=90.0)
        *_, last = semantic_map.history.events("object/1")
        assert "left where it stood" in last.changes
        said = semantic_map.history.explain("object/1")
        assert "cup 1 left (1, 2, 0.8) m" in said[0].text
        found = status(semantic_map, "object/1")
        assert (found.value, found.proof.split(":")[0]) == ("gone", "left (1.00, 2.00) in no place")
        semantic_map.update(f"DELETE WHERE {{ <{CUP}> ?p ?o }}")
        assert status(semantic_map, "object/1").proof.startswith("left the map by transaction #3")
        with pytest.raises(QueryParameterError):
            status(semantic_map, "object/7")


@pytest.mark.parametrize("scope", [(), ("objects",), ("object/1",)], ids=str)
def test_restoring_brings_back_or_takes_away(tmp_path: Path, scope: tuple[str, ...]) -> None:
    with create_map(tmp_path / "a.map", base=BASE) as semantic_map:
        empty = semantic_map.sequence
        semantic_map.apply(MapUpdate(objects=(cup(semantic_map),)))
        there = semantic_map.sequence
        leave(semantic_map)
        gone = semantic_map.sequence
        semantic_map.restore(there, only=scope)
        assert ([o.iri for o in semantic_map.objects()], semantic_map.departed()) == ([CUP], ())
        semantic_map.restore(gone, only=scope)
        assert (semantic_map.objects(), [d.iri for d in semantic_map.departed()]) == ((), [CUP])
        assert check_map(semantic_map.engine) == []
        semantic_map.restore(empty, only=scope)
        assert (semantic_map.objects(), semantic_map.departed()) == ((), ())
