"""Relations against a truth, each worked out by hand."""

from dataclasses import replace

import numpy as np
import pytest

from kg.model.records import MapUpdate, ObjectRecord, Relation
from kg.serving.opening import in_memory_map
from lab.maps.complete_truth import TrueObject
from lab.maps.map_evaluation import evaluate_map, pooled
from lab.maps.truth_matching import TruthMatcher

CUP = (0.1, 0.1, 0.1)


def entry(name, label, position, extent, on):
    return TrueObject(name, label, np.array(position), extent=extent, on=on)


TRUTH = (
    entry("table", "dining table", (0.0, 0.0, 0.4), (1.6, 0.9, 0.8), "floor"),
    entry("left", "cup", (-0.2, 0.0, 0.85), CUP, "table"),
    entry("right", "cup", (0.1, 0.0, 0.85), CUP, "table"),
    entry("far", "cup", (3.0, 0.0, 0.85), CUP, "desk"),
)


def evaluated(truth: tuple[TrueObject, ...], *relations: tuple[int, Relation]):
    """Evaluation of a map that has every true thing, by number, with those relations."""
    semantic_map = in_memory_map(base="http://example.org/lab/")
    for number, one in enumerate(truth):
        record = ObjectRecord(
            iri=f"http://example.org/lab/object/{number}",
            category=semantic_map.catalogue.find(one.label).iri,
            p_map=one.p_world,
            confidence=1.0,
            existence=0.9,
            observations=1,
            first_seen=10.0,
            last_seen=10.0,
        )
        mine = tuple(relation for thing, relation in relations if thing == number)
        semantic_map.apply(MapUpdate(objects=(replace(record, relations=mine),)))
    return evaluate_map(semantic_map, TruthMatcher(truth, np.eye(4)))


def related(kind: str, other: int, probability: float) -> Relation:
    return Relation(kind, f"http://example.org/lab/object/{other}", probability)  # type: ignore[arg-type]


def test_right_wrong_and_missed_relations() -> None:
    found = evaluated(
        TRUTH,
        (1, related("on", 0, 0.9)),
        (2, related("on", 0, 0.3)),  # not stated
        (3, related("on", 0, 0.8)),  # wrong: it is on a desk
        (1, related("beside", 2, 0.7)),
    )
    on, beside = found.scores().relations
    assert (on.true, on.stated, on.right, on.recall, on.precision) == (2, 2, 1, 0.5, 0.5)
    assert on.ece == pytest.approx((0.1 + 0.7 + 0.8) / 3)
    assert (beside.true, beside.stated, beside.right, beside.recall) == (2, 1, 1, 0.5)


def test_several_maps_together() -> None:
    one = evaluated(TRUTH, (1, related("on", 0, 0.9)))
    other = evaluated(TRUTH, (1, related("on", 0, 0.9)), (2, related("on", 0, 0.9)))
    on = pooled([one, other]).relations[0]
    assert (on.true, on.right, on.recall) == (4, 3, 0.75)


def test_a_truth_without_relations_scores_none() -> None:
    truth = tuple(replace(one, on=None) for one in TRUTH)
    assert evaluated(truth, (1, related("on", 0, 0.9))).scores().relations == ()
