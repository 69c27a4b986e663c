"""The writer changes what differs, all of it at once, and nothing that people added."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import GraphError, InvalidFactError
from kg.model.records import Evidence, MapUpdate, ObjectRecord, PlaceRecord, RobotRecord
from kg.model.vocabulary import NEXT_OBJECT, SEQUENCE
from kg.serving.opening import in_memory_map

COUNTERS = {NEXT_OBJECT, SEQUENCE}
SEEN = Evidence("frame-1", "lab", 10.0, (1, 2, 3, 4), 0.8, "detector")


@pytest.fixture
def chart() -> SemanticMap:
    return in_memory_map(base="http://example.org/lab/")


def thing(chart: SemanticMap, label: str = "chair", **fields: object) -> ObjectRecord:
    record = ObjectRecord(
        iri=chart.new_object_iri(),
        category=chart.catalogue.find(label).iri,
        p_map=np.array([1.0, 2.0, 0.5]),
        confidence=1.0,
        existence=0.5,
        observations=1,
        first_seen=10.0,
        last_seen=10.0,
        evidence=SEEN,
    )
    return replace(record, **fields)  # type: ignore[arg-type]


def test_the_same_update_twice_changes_nothing(chart: SemanticMap) -> None:
    update = MapUpdate(objects=(thing(chart),), robot=RobotRecord(np.zeros(3), 0.0, 10.0))
    assert len(chart.apply(update)) > 10
    assert chart.apply(update) is None


def test_noise_below_the_precision_of_the_map_costs_no_write(chart: SemanticMap) -> None:
    chair = thing(chart)
    chart.apply(MapUpdate(objects=(chair,)))
    moved = replace(chair, p_map=chair.p_map + 0.003, last_seen=10.3, existence=0.502)
    assert chart.apply(MapUpdate(objects=(moved,))) is None


def test_a_moved_object_changes_two_triples_an_axis(chart: SemanticMap) -> None:
    chair = thing(chart)
    chart.apply(MapUpdate(objects=(chair,)))
    assert (
        len(chart.apply(MapUpdate(objects=(replace(chair, p_map=np.array([1.5, 2.0, 0.5])),)))) == 2
    )
    assert chart.objects()[0].p_map[0] == 1.5


def test_a_removed_object_leaves_nothing_behind_and_its_number_is_not_used_again(
    chart: SemanticMap,
) -> None:
    before = set(chart.engine)
    chair = thing(chart)
    chart.apply(MapUpdate(objects=(chair,)))
    chart.apply(MapUpdate(removed=(chair.iri,)))
    left = {q for q in set(chart.engine) ^ before if q.predicate.value not in COUNTERS}
    assert left == set()
    assert chart.new_object_iri() == "http://example.org/lab/object/2"


def test_a_lost_evidence_takes_the_observation_along(chart: SemanticMap) -> None:
    chair = thing(chart)
    chart.apply(MapUpdate(objects=(chair,)))
    chart.apply(MapUpdate(objects=(replace(chair, evidence=None),)))
    assert chart.query("why-object", object=chair.iri).rows == ()
    assert chart.query("SELECT ?o WHERE { ?o a sosa:Observation }").rows == ()


def test_a_belief_that_fades_leaves_no_node_behind(chart: SemanticMap) -> None:
    kitchen, bar = (chart.catalogue.find(name, "place").iri for name in ("kitchen", "bar"))
    room = PlaceRecord(chart.place_iri(1), "room", 0, 4, 0, 4, 3, {kitchen: 0.7, bar: 0.3})
    chart.apply(MapUpdate(places=(room,)))
    chart.apply(MapUpdate(places=(replace(room, beliefs={bar: 0.9}),)))
    assert chart.places()[0].beliefs == {bar: 0.9}
    assert len(chart.query("SELECT ?b WHERE { ?b a here:PlaceBelief }").rows) == 1
    assert chart.query("places").records()[0]["category"] == "bar"


def test_what_people_added_survives_and_what_they_changed_is_seen(chart: SemanticMap) -> None:
    chair = thing(chart)
    chart.apply(MapUpdate(objects=(chair,)))
    chart.update(
        "DELETE { GRAPH graph:map { ?o here:x ?x ; rdfs:label ?l } } "
        "INSERT { GRAPH graph:map { ?o here:x 7e0 ; rdfs:label 'throne' ; rdfs:comment 'old' } } "
        "WHERE { GRAPH graph:map { ?o here:x ?x ; rdfs:label ?l } }"
    )
    assert chart.objects()[0].p_map[0] == 7.0
    chart.apply(MapUpdate(objects=(replace(chair, observations=2),)))
    text = "SELECT * WHERE { ?o rdfs:comment ?c ; rdfs:label ?l; here:x ?x ; here:y ?y }"
    (row,) = chart.query(text).records()
    assert (row["c"], row["l"], row["x"]) == ("old", "throne", 1.0)


def test_one_bad_record_and_nothing_of_the_update_is_written(chart: SemanticMap) -> None:
    good, bad = thing(chart), thing(chart, existence=2.0)
    with pytest.raises(InvalidFactError):
        chart.apply(MapUpdate(objects=(good, bad)))
    assert chart.objects() == ()


def test_contradicting_updates_are_refused(chart: SemanticMap) -> None:
    chair = thing(chart)
    with pytest.raises(InvalidFactError, match="2 times"):
        chart.apply(MapUpdate(objects=(chair, chair)))
    with pytest.raises(InvalidFactError, match="both written and removed"):
        chart.apply(MapUpdate(objects=(chair,), removed=(chair.iri,)))


def test_a_closed_map_cannot_be_written(chart: SemanticMap) -> None:
    chair = thing(chart)
    chart.close()
    with pytest.raises(GraphError, match="closed"):
        chart.apply(MapUpdate(objects=(chair,)))
