"""What else an object may be is a fact of the map, beside the class it has."""

from __future__ import annotations

import numpy as np
import pytest

from kg.knowledge.ontology.lint import check_map
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import InvalidFactError, ShapeError
from kg.model.records import MapUpdate, ObjectRecord
from kg.model.transactions import ChangeSet
from kg.serving.client.update_codec import update_from_json, update_to_json
from kg.serving.opening import in_memory_map

BASE = "http://example.org/lab/"
CUP = f"{BASE}object/1"


@pytest.fixture
def chart() -> SemanticMap:
    return in_memory_map(base=BASE)


def iri(chart: SemanticMap, label: str) -> str:
    return chart.catalogue.find(label).iri


def write(chart: SemanticMap, **labels: float) -> ChangeSet | None:
    record = ObjectRecord(
        iri=CUP,
        category=iri(chart, "cup"),
        p_map=np.zeros(3),
        confidence=1.0,
        existence=0.6,
        observations=1,
        first_seen=10.0,
        last_seen=10.0,
        labels={iri(chart, label): p for label, p in labels.items()},
    )
    return chart.apply(MapUpdate(objects=(record,)))


def labels(chart: SemanticMap) -> dict[str, float]:
    (record,) = chart.perceived.objects((CUP,))
    return {chart.catalogue.label(category): p for category, p in record.labels.items()}


def count(chart: SemanticMap) -> int:
    text = "SELECT ?n WHERE { ?n here:labelProbability ?p }"
    return len(chart.query(text).rows)


def test_the_most_probable_alternatives_are_kept_in_steps(chart: SemanticMap) -> None:
    write(chart, bowl=0.22, vase=0.11, bottle=0.07, book=0.06, knife=0.04)
    assert labels(chart) == {"bowl": 0.2, "vase": 0.1, "bottle": 0.05}
    assert check_map(chart.engine) == []


def test_only_what_changes_is_written(chart: SemanticMap) -> None:
    write(chart, bowl=0.21)
    assert write(chart, bowl=0.19) is None
    assert len(write(chart, bowl=0.26) or ()) == 2
    assert len(write(chart) or ()) == 4
    assert count(chart) == 0


def test_an_object_that_leaves_takes_them_along(chart: SemanticMap) -> None:
    write(chart, bowl=0.2)
    chart.apply(MapUpdate(removed=(CUP,)))
    assert count(chart) == 0
    write(chart, bowl=0.2)
    chart.update(f"DELETE WHERE {{ <{CUP}> ?p ?o }}", by="ann", confirmed=True)
    assert count(chart) == 0


def test_people_are_right_about_the_class(chart: SemanticMap) -> None:
    write(chart, bowl=0.3)
    chart.assertions.add(CUP, "category", "vase", by="ann")
    write(chart, bowl=0.3)
    assert count(chart) == 0
    assert chart.catalogue.label(chart.objects()[0].category) == "vase"
    chart.assertions.retract(CUP, "category", by="ann")
    write(chart, bowl=0.3)
    assert labels(chart) == {"bowl": 0.3}


def test_a_class_written_in_sparql_leaves_none(chart: SemanticMap) -> None:
    write(chart, bowl=0.3)
    chart.update(
        f"DELETE DATA {{ <{CUP}> a here:Cup }} ; INSERT DATA {{ <{CUP}> a here:Vase }}", by="ann"
    )
    assert count(chart) == 0
    assert check_map(chart.engine) == []


def test_they_travel_over_the_wire_and_through_the_past(chart: SemanticMap) -> None:
    write(chart, bowl=0.3)
    update = MapUpdate(objects=chart.objects())
    assert update_from_json(update_to_json(update)).objects[0].labels == update.objects[0].labels
    before = chart.sequence
    write(chart)
    chart.restore(before, only=("object/1",), by="ann")
    assert labels(chart) == {"bowl": 0.3}


@pytest.mark.parametrize("share", [-0.1, 1.2, float("nan")])
def test_what_is_no_probability_is_refused(chart: SemanticMap, share: float) -> None:
    with pytest.raises(InvalidFactError, match="label belief"):
        write(chart, bowl=share)


def test_what_is_no_kind_of_object_is_refused(chart: SemanticMap) -> None:
    with pytest.raises(InvalidFactError, match="places"):
        write(chart, kitchen=0.3)
    write(chart, bowl=0.3)
    node = "<object/1/label/Bowl>"
    with pytest.raises(ShapeError, match="labelProbability"):
        chart.update(
            f"DELETE WHERE {{ {node} here:labelProbability ?p }}",
            by="ann",
        )


def test_it_can_be_asked_for_and_explained(chart: SemanticMap) -> None:
    write(chart, bowl=0.3, vase=0.1)
    rows = [
        (row["category"], row["other"], row["probability"])
        for row in chart.query("may-be").records()
    ]
    assert rows == [("cup", "bowl", 0.3), ("cup", "vase", 0.1)]
    (reason,) = chart.history.explain("object/1")
    texts = [step.text for step in reason.because]
    assert "may also be here:Bowl, probability 0.3" in texts
