"""The writer changes what differs, all of it at once, and nothing that people added."""

from dataclasses import replace

import numpy as np
import pytest

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import InvalidFactError
from kg.model.records import Evidence, MapUpdate, ObjectRecord, PlaceRecord, RobotRecord
from kg.model.vocabulary import NEXT_OBJECT, SEQUENCE
from tests.kg.conftest import thing as made

COUNTERS = {NEXT_OBJECT, SEQUENCE}
SEEN = Evidence("frame-1", "lab", 10.0, (1, 2, 3, 4), 0.8, "detector")


def thing(semantic_map: SemanticMap, label: str = "chair", **fields: object) -> ObjectRecord:
    return made(semantic_map, label, **{"evidence": SEEN, **fields})


def test_the_same_update_twice_changes_nothing(semantic_map: SemanticMap) -> None:
    update = MapUpdate(objects=(thing(semantic_map),), robot=RobotRecord(np.zeros(3), 0.0, 10.0))
    assert len(semantic_map.apply(update)) > 10
    assert semantic_map.apply(update) is None


def test_noise_below_the_precision_of_the_map_costs_no_write(semantic_map: SemanticMap) -> None:
    chair = thing(semantic_map)
    semantic_map.apply(MapUpdate(objects=(chair,)))
    moved = replace(chair, p_map=chair.p_map + 0.003, last_seen=10.3, existence=0.502)
    assert semantic_map.apply(MapUpdate(objects=(moved,))) is None


def test_a_moved_object_changes_two_triples_an_axis(semantic_map: SemanticMap) -> None:
    chair = thing(semantic_map)
    semantic_map.apply(MapUpdate(objects=(chair,)))
    moved = replace(chair, p_map=np.array([1.5, 2.0, 0.5]))
    assert len(semantic_map.apply(MapUpdate(objects=(moved,)))) == 2
    assert semantic_map.objects()[0].p_map[0] == 1.5


def test_a_removed_object_leaves_nothing_behind_and_its_number_is_not_used_again(semantic_map):
    before = set(semantic_map.engine)
    chair = thing(semantic_map)
    semantic_map.apply(MapUpdate(objects=(chair,)))
    semantic_map.apply(MapUpdate(removed=(chair.iri,)))
    left = {q for q in set(semantic_map.engine) ^ before if q.predicate.value not in COUNTERS}
    assert left == set()
    assert semantic_map.new_object_iri() == "https://example.org/map/object/2"


def test_a_lost_evidence_takes_the_observation_along(semantic_map: SemanticMap) -> None:
    chair = thing(semantic_map)
    semantic_map.apply(MapUpdate(objects=(chair,)))
    semantic_map.apply(MapUpdate(objects=(replace(chair, evidence=None),)))
    assert semantic_map.query("why-object", object=chair.iri).rows == ()
    assert semantic_map.query("SELECT ?o WHERE { ?o a sosa:Observation }").rows == ()


def test_a_belief_that_fades_leaves_no_node_behind(semantic_map: SemanticMap) -> None:
    kitchen, bar = (semantic_map.catalogue.find(name, "place").iri for name in ("kitchen", "bar"))
    room = PlaceRecord(semantic_map.place_iri(1), "room", 0, 4, 0, 4, 3, {kitchen: 0.7, bar: 0.3})
    semantic_map.apply(MapUpdate(places=(room,)))
    semantic_map.apply(MapUpdate(places=(replace(room, beliefs={bar: 0.9}),)))
    assert semantic_map.places()[0].beliefs == {bar: 0.9}
    assert len(semantic_map.query("SELECT ?b WHERE { ?b a here:PlaceBelief }").rows) == 1
    assert semantic_map.query("places").records()[0]["category"] == "bar"


def test_what_people_added_survives_and_what_they_changed_is_seen(semantic_map):
    chair = thing(semantic_map)
    semantic_map.apply(MapUpdate(objects=(chair,)))
    semantic_map.update(
        "DELETE { GRAPH graph:map { ?o here:x ?x ; rdfs:label ?l } } "
        "INSERT { GRAPH graph:map { ?o here:x 7e0 ; rdfs:label 'throne' ; rdfs:comment 'old' } } "
        "WHERE { GRAPH graph:map { ?o here:x ?x ; rdfs:label ?l } }"
    )
    assert semantic_map.objects()[0].p_map[0] == 7.0
    semantic_map.apply(MapUpdate(objects=(replace(chair, observations=2),)))
    text = "SELECT * WHERE { ?o rdfs:comment ?c ; rdfs:label ?l; here:x ?x ; here:y ?y }"
    (row,) = semantic_map.query(text).records()
    assert (row["c"], row["l"], row["x"]) == ("old", "throne", 1.0)


def test_one_bad_record_and_nothing_of_the_update_is_written(semantic_map: SemanticMap) -> None:
    good, bad = thing(semantic_map), thing(semantic_map, existence=2.0)
    for wrong in (bad, thing(semantic_map, deviation=1e200)):
        with pytest.raises(InvalidFactError, match="must be within"):
            semantic_map.apply(MapUpdate(objects=(good, wrong)))
    assert semantic_map.objects() == ()


def test_contradicting_updates_are_refused(semantic_map: SemanticMap) -> None:
    chair = thing(semantic_map)
    with pytest.raises(InvalidFactError, match="2 times"):
        semantic_map.apply(MapUpdate(objects=(chair, chair)))
    with pytest.raises(InvalidFactError, match="both written and removed"):
        semantic_map.apply(MapUpdate(objects=(chair,), removed=(chair.iri,)))
