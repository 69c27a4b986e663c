"""Objects that left or moved, and beliefs about labels."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from kg.knowledge.ontology.catalogue import Catalogue
from kg.knowledge.ontology.lint import check_map
from kg.knowledge.ontology.loading import load_ontologies
from kg.maps.facts.coordinate_frames import moved
from kg.maps.facts.objects_and_places import RecordCodec
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import InvalidFactError, QueryParameterError, ShapeError
from kg.model.records import DepartedRecord, MapUpdate, ObjectRecord
from kg.model.transactions import ChangeSet
from kg.serving.client.update_codec import update_from_json, update_to_json
from kg.serving.opening import create_map
from planner.search.goals.status import status
from tests.kg.conftest import thing

BASE = "https://example.org/map/"
CUP = f"{BASE}object/1"
ABOUT = f"SELECT ?p ?o WHERE {{ GRAPH graph:map {{ <{CUP}> ?p ?o }} }}"


def cup(semantic_map: SemanticMap) -> ObjectRecord:
    bowl = semantic_map.catalogue.find("bowl").iri
    return thing(semantic_map, iri=CUP, existence=0.9, observations=4, labels={bowl: 0.1})


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


def test_what_is_not_valid_is_refused_and_nothing_written(semantic_map: SemanticMap) -> None:
    semantic_map.apply(MapUpdate(objects=(cup(semantic_map),)))
    for changed in (
        {"peak": 1.2},
        {"found_gone": 15.0},
        {"observations": 0},
        {"p_map": np.full(3, np.nan)},
        {"extent": np.array([0.1, -0.1, 0.1])},
        {"category": "https://w3id.org/hereabouts#Kitchen"},
        {"iri": f"{BASE}object/2"},
    ):
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


MOVED_BASE = "http://example.org/lab/"


@pytest.mark.parametrize("degrees", [0, 30, 90, 145, -170])
def test_a_box_turns_with_its_map(degrees: float) -> None:
    facts = RecordCodec(MOVED_BASE, Catalogue.from_quads(load_ontologies().quads))
    kind = facts.catalogue.find("dining table", "object").iri
    where, extent = np.array([1.0, 2.0, 0.4]), np.array([1.2, 0.8, 0.8])
    table = ObjectRecord(
        MOVED_BASE + "object/1", kind, where, 1.0, 0.9, 3, 0.0, 1.0, extent=extent, yaw=0.3
    )
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    T = np.array([[c, -s, 0, 4], [s, c, 0, -2], [0, 0, 1, 0], [0, 0, 0, 1]])
    (seen,) = facts.objects_among(moved(facts.of_object(table), T, MOVED_BASE + "crs"))
    assert table.footprint is not None and seen.footprint is not None
    wanted = shapely.Polygon(table.footprint @ T[:2, :2].T + T[:2, 3])
    assert wanted.symmetric_difference(shapely.Polygon(seen.footprint)).area < 0.01


def iri(semantic_map: SemanticMap, label: str) -> str:
    return semantic_map.catalogue.find(label).iri


def write(semantic_map: SemanticMap, **labels: float) -> ChangeSet | None:
    alternatives = {iri(semantic_map, label): p for label, p in labels.items()}
    record = thing(semantic_map, iri=CUP, existence=0.6, labels=alternatives)
    return semantic_map.apply(MapUpdate(objects=(record,)))


def labels(semantic_map: SemanticMap) -> dict[str, float]:
    (record,) = semantic_map.perceived.objects((CUP,))
    return {semantic_map.catalogue.label(category): p for category, p in record.labels.items()}


def count(semantic_map: SemanticMap) -> int:
    text = "SELECT ?n WHERE { ?n here:labelProbability ?p }"
    return len(semantic_map.query(text).rows)


def test_the_most_probable_alternatives_are_kept_in_steps(semantic_map: SemanticMap) -> None:
    write(semantic_map, bowl=0.22, vase=0.11, bottle=0.07, book=0.06, knife=0.04)
    assert labels(semantic_map) == {"bowl": 0.2, "vase": 0.1, "bottle": 0.05}
    write(semantic_map, bowl=0.22, knife=0.04)
    assert labels(semantic_map) == {"bowl": 0.2}
    assert check_map(semantic_map.engine) == []


def test_only_what_changes_is_written(semantic_map: SemanticMap) -> None:
    write(semantic_map, bowl=0.21)
    assert write(semantic_map, bowl=0.19) is None
    assert len(write(semantic_map, bowl=0.26) or ()) == 2
    assert len(write(semantic_map) or ()) == 4
    assert count(semantic_map) == 0


def test_an_object_that_leaves_takes_them_along(semantic_map: SemanticMap) -> None:
    write(semantic_map, bowl=0.2)
    semantic_map.apply(MapUpdate(removed=(CUP,)))
    assert count(semantic_map) == 0
    write(semantic_map, bowl=0.2)
    semantic_map.update(f"DELETE WHERE {{ <{CUP}> ?p ?o }}", by="ann", confirmed=True)
    assert count(semantic_map) == 0


def test_people_are_right_about_the_class(semantic_map: SemanticMap) -> None:
    write(semantic_map, bowl=0.3)
    semantic_map.assertions.add(CUP, "category", "vase", by="ann")
    write(semantic_map, bowl=0.3)
    assert count(semantic_map) == 0
    assert semantic_map.catalogue.label(semantic_map.objects()[0].category) == "vase"
    semantic_map.assertions.retract(CUP, "category", by="ann")
    write(semantic_map, bowl=0.3)
    assert labels(semantic_map) == {"bowl": 0.3}


def test_a_class_written_in_sparql_leaves_none(semantic_map: SemanticMap) -> None:
    write(semantic_map, bowl=0.3)
    semantic_map.update(
        f"DELETE DATA {{ <{CUP}> a here:Cup }} ; INSERT DATA {{ <{CUP}> a here:Vase }}", by="ann"
    )
    assert count(semantic_map) == 0
    assert check_map(semantic_map.engine) == []


def test_they_travel_over_the_wire_and_through_the_past(semantic_map: SemanticMap) -> None:
    write(semantic_map, bowl=0.3)
    update = MapUpdate(objects=semantic_map.objects())
    assert update_from_json(update_to_json(update)).objects[0].labels == update.objects[0].labels
    before = semantic_map.sequence
    write(semantic_map)
    semantic_map.restore(before, only=("object/1",), by="ann")
    assert labels(semantic_map) == {"bowl": 0.3}


def test_what_is_no_kind_of_object_is_refused(semantic_map: SemanticMap) -> None:
    for labels, message in (({"kitchen": 0.3}, "places"), ({"bowl": 1.2}, "label belief")):
        with pytest.raises(InvalidFactError, match=message):
            write(semantic_map, **labels)
    write(semantic_map, bowl=0.3)
    node = "<object/1/label/Bowl>"
    with pytest.raises(ShapeError, match="labelProbability"):
        semantic_map.update(f"DELETE WHERE {{ {node} here:labelProbability ?p }}", by="ann")


def test_it_can_be_asked_for_and_explained(semantic_map: SemanticMap) -> None:
    write(semantic_map, bowl=0.3, vase=0.1)
    rows = [
        (row["category"], row["other"], row["probability"])
        for row in semantic_map.query("may-be").records()
    ]
    assert rows == [("cup", "bowl", 0.3), ("cup", "vase", 0.1)]
    (reason,) = semantic_map.history.explain("object/1")
    texts = [step.text for step in reason.because]
    assert "may also be bowl (30 %)" in texts


def test_the_size_speaks_for_and_against_names(semantic_map: SemanticMap) -> None:
    write(semantic_map, bowl=0.3, banana=0.1)
    assert "the size" not in explained(semantic_map), "it has none yet"
    record = semantic_map.perceived.objects((CUP,))[0]
    sides = np.array([0.1, 0.3, 0.2])
    semantic_map.apply(MapUpdate(objects=(replace(record, extent=sides),)))
    text = explained(semantic_map)
    assert "against a cup: 0.30 x 0.20 x 0.10 m, the largest have 0.18 x 0.14 x 0.13 m" in text
    assert "the size fits a bowl: 0.30 x 0.20 x 0.10 m" in text
    assert text.index("(30 %)") < text.index("fits a bowl") < text.index("(10 %)")


def explained(semantic_map: SemanticMap) -> str:
    (reason,) = semantic_map.history.explain("object/1")
    return "\n".join(step.text for _, step in reason.walk())
