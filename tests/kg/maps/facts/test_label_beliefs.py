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

BASE = "https://example.org/map/"
CUP = f"{BASE}object/1"


def iri(semantic_map: SemanticMap, label: str) -> str:
    return semantic_map.catalogue.find(label).iri


def write(semantic_map: SemanticMap, **labels: float) -> ChangeSet | None:
    record = ObjectRecord(
        iri=CUP,
        category=iri(semantic_map, "cup"),
        p_map=np.zeros(3),
        confidence=1.0,
        existence=0.6,
        observations=1,
        first_seen=10.0,
        last_seen=10.0,
        labels={iri(semantic_map, label): p for label, p in labels.items()},
    )
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


@pytest.mark.parametrize("share", [-0.1, 1.2, float("nan")])
def test_what_is_no_probability_is_refused(semantic_map: SemanticMap, share: float) -> None:
    with pytest.raises(InvalidFactError, match="label belief"):
        write(semantic_map, bowl=share)


def test_what_is_no_kind_of_object_is_refused(semantic_map: SemanticMap) -> None:
    with pytest.raises(InvalidFactError, match="places"):
        write(semantic_map, kitchen=0.3)
    write(semantic_map, bowl=0.3)
    node = "<object/1/label/Bowl>"
    with pytest.raises(ShapeError, match="labelProbability"):
        semantic_map.update(
            f"DELETE WHERE {{ {node} here:labelProbability ?p }}",
            by="ann",
        )


def test_it_can_be_asked_for_and_explained(semantic_map: SemanticMap) -> None:
    write(semantic_map, bowl=0.3, vase=0.1)
    rows = [
        (row["category"], row["other"], row["probability"])
        for row in semantic_map.query("may-be").records()
    ]
    assert rows == [("cup", "bowl", 0.3), ("cup", "vase", 0.1)]
    (reason,) = semantic_map.history.explain("object/1")
    texts = [step.text for step in reason.because]
    assert "may also be here:Bowl, probability 0.3" in texts
