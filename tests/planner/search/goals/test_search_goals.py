from datetime import UTC, datetime

import numpy as np
import pytest

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import UnknownCategoryError
from kg.model.records import Evidence, MapUpdate, ObjectRecord, PlaceRecord
from planner.freespace.planning_map import number
from planner.search.goals.candidate_queries import existence_of
from planner.search.goals.search_goals import Goal, derive_goals, explain_none, resolve_target
from planner.settings import BeliefSettings

SEEN = datetime(2026, 3, 4, 5, 6, 7, tzinfo=UTC).timestamp()


def add_object(semantic_map, label, x, y, existence=0.8):
    record = ObjectRecord(
        iri=semantic_map.new_object_iri(),
        category=semantic_map.catalogue.find(label, "object").iri,
        p_map=np.array([x, y, 0.9]),
        confidence=2.0,
        existence=existence,
        observations=14,
        first_seen=SEEN - 60,
        last_seen=SEEN,
        evidence=Evidence("frame-000056", "walk", SEEN, (1, 2, 3, 4), 0.7, "a detector"),
    )
    semantic_map.apply(MapUpdate(objects=(record,)))
    return record


def add_place(semantic_map: SemanticMap, number: int, **beliefs: float) -> PlaceRecord:
    record = PlaceRecord(
        iri=semantic_map.place_iri(number),
        label=f"place {number}",
        xmin=4.0 * number,
        xmax=4.0 * number + 4,
        ymin=0.0,
        ymax=2.0,
        views=int(bool(beliefs)) * 9,
        beliefs={semantic_map.catalogue.find(k, "place").iri: b for k, b in beliefs.items()},
    )
    semantic_map.apply(MapUpdate(places=(record,)))
    return record


def by_iri(goals: tuple[Goal, ...]) -> dict[str, Goal]:
    assert len({goal.iri for goal in goals}) == len(goals)
    return {goal.iri: goal for goal in goals}


def test_a_known_object_is_a_goal_with_its_existence_and_its_history(semantic_map):
    cup = add_object(semantic_map, "cup", 1.5, -2.25)
    add_object(semantic_map, "car", 9, 9)
    (goal,) = derive_goals(semantic_map, "cup")
    assert (goal.iri, goal.kind, goal.probability) == (cup.iri, "known", pytest.approx(0.8))
    assert goal.p_map.tolist() == [1.5, -2.25]
    for fact in ("cup", "80 % sure", "seen 14 times", "last seen on 2026-03-0", "frame-000056"):
        assert fact in goal.why
    assert "\n" not in goal.why


def test_an_object_known_to_be_near_it_is_a_goal_in_the_direction_of_the_relation(semantic_map):
    banana = add_object(semantic_map, "banana", 1, 1)
    (goal,) = derive_goals(semantic_map, "apple")
    (relation,) = [
        row
        for row in semantic_map.query("goals-relations", category="apple").records()
        if row["target"] == "banana"
    ]
    assert (goal.iri, goal.kind) == (banana.iri, "nearby")
    assert goal.probability == pytest.approx(0.8 * float(str(relation["probability"])), abs=1e-6)
    assert "apple is found near banana" in goal.why
    add_object(semantic_map, "apple", 5, 5)
    assert by_iri(derive_goals(semantic_map, "banana")).keys() == {banana.iri}


def test_an_explored_place_where_the_ontology_puts_it_is_a_goal_at_its_centre(semantic_map):
    kitchen = add_place(semantic_map, 1, kitchen=0.81, bedroom=0.1)
    add_place(semantic_map, 2, bedroom=0.9, kitchen=0.1)
    add_place(semantic_map, 3)
    (goal,) = derive_goals(semantic_map, "toaster")
    (listed,) = [
        row
        for row in semantic_map.query("goals-relations", category="toaster").records()
        if row["target"] == "kitchen"
    ]
    assert (goal.iri, goal.kind, goal.label) == (kitchen.iri, "place", "place 1")
    assert goal.p_map.tolist() == [6, 1]
    assert goal.probability == pytest.approx(0.81 * float(str(listed["probability"])), abs=1e-6)
    assert goal.why.startswith("this is a kitchen (belief 0.81), where toaster is found (")
    assert str(listed["source"]) in goal.why


def test_the_authors_finder_takes_every_category_believed_enough(semantic_map: SemanticMap) -> None:
    toaster = resolve_target(semantic_map.catalogue, "toaster").iri

    def places(**widened: float) -> list[object]:
        rows = semantic_map.query("goals-places", category=toaster, **widened).records()
        return [row["label"] for row in rows]

    add_place(semantic_map, 1, bedroom=0.6, kitchen=0.3)
    add_place(semantic_map, 2, bedroom=0.6, kitchen=0.2)
    assert derive_goals(semantic_map, "toaster") == ()
    assert places(minBelief=0.25, anyCategory=1) == ["place 1"]
    add_place(semantic_map, 3, kitchen=0.2)
    assert [goal.label for goal in derive_goals(semantic_map, "toaster")] == ["place 3"]
    assert places(minBelief=0.25) == []


def test_food_is_searched_as_any_of_its_members_each_goal_saying_which(semantic_map):
    banana = add_object(semantic_map, "banana", 1, 1)
    pizza = add_object(semantic_map, "pizza", 2, 2, existence=0.6)
    kitchen = add_place(semantic_map, 1, kitchen=0.9)
    goals = by_iri(derive_goals(semantic_map, "food"))
    assert goals.keys() == {banana.iri, pizza.iri, kitchen.iri}
    # the banana is food itself; that it also lies near apples is the weaker reason
    assert goals[banana.iri].kind == "known"
    assert goals[pizza.iri].why.startswith("pizza")
    assert ", where " in goals[kitchen.iri].why
    assert "cake" in goals[kitchen.iri].why and "pizza" in goals[kitchen.iri].why
    rows = semantic_map.query("goals-places", category="food").records()
    assert len(rows) > 1  # the strongest reason for a place stands
    assert goals[kitchen.iri].probability == max(number(row, "probability") for row in rows)


def test_goals_come_in_order_of_probability_and_none_is_without(semantic_map: SemanticMap) -> None:
    for existence in (0.3, 0.9, 0.0, 0.6):
        add_object(semantic_map, "cup", 0, 0, existence)
    goals = derive_goals(semantic_map, "cup")
    assert [goal.probability for goal in goals] == pytest.approx([0.9, 0.6, 0.3])


def test_a_relation_added_by_hand_counts_at_once_for_members_too(semantic_map: SemanticMap) -> None:
    bath = add_place(semantic_map, 1, shower=0.5)
    assert derive_goals(semantic_map, "banana") == ()
    semantic_map.dataset.update(
        "INSERT DATA { GRAPH graph:commonsense { <http://example.org/r> a here:LocatedAtRelation ; "
        "here:relationSubject here:Food ; here:relationTarget here:Shower ; "
        'here:relationProbability 0.3e0 ; dct:source "Ada" } }'
    )
    (goal,) = derive_goals(semantic_map, "banana")
    assert (goal.iri, goal.probability) == (bath.iri, pytest.approx(0.15))
    assert goal.why == "this is a shower (belief 0.50), where food is found (30 %, Ada)"


def test_targets_are_named_by_label_synonym_iri_in_any_spelling(semantic_map: SemanticMap) -> None:
    couch = resolve_target(semantic_map.catalogue, "couch")
    for name in ("sofa", "Couch", couch.iri):
        assert resolve_target(semantic_map.catalogue, name) == couch
    glass = resolve_target(semantic_map.catalogue, "wine glass")
    assert resolve_target(semantic_map.catalogue, "Wine_Glass") == glass


def test_what_is_no_category_is_refused_with_what_there_is(semantic_map: SemanticMap) -> None:
    with pytest.raises(
        UnknownCategoryError, match=r"no category 'froobl'; it is none of the \d+ kinds"
    ) as refused:
        derive_goals(semantic_map, "froobl")
    assert "\n" not in str(refused.value)
    with pytest.raises(UnknownCategoryError, match="did you mean banana"):
        derive_goals(semantic_map, "bamama")
    with pytest.raises(UnknownCategoryError, match="means banana, apple or orange; ask for one"):
        derive_goals(semantic_map, "fruit")
    with pytest.raises(UnknownCategoryError, match="'kitchen' is a kind of place"):
        derive_goals(semantic_map, "kitchen")


def test_no_goals_are_explained_by_what_map_and_ontology_lack(semantic_map: SemanticMap) -> None:
    assert derive_goals(semantic_map, "zebra") == ()
    assert "no ontology says where it is found" in explain_none(semantic_map, "zebra")
    add_place(semantic_map, 1)
    add_place(semantic_map, 2, bedroom=1.0)
    assert derive_goals(semantic_map, "toaster") == ()
    said = explain_none(semantic_map, "toaster")
    assert "kitchen" in said
    assert "1 of its 2 places are explored" in said
    assert "banana" in explain_none(semantic_map, "apple")


@pytest.mark.parametrize(("existence", "surer"), [(0.49, 0.49), (0.5, 0.9), (0.95, 0.95)])
def test_what_a_search_found_is_surer_where_it_is_present(existence, surer):
    row = {"existence": existence, "foundBy": "search/1", "own": None}
    assert existence_of(row, BeliefSettings()) == surer
    assert existence_of(row | {"foundBy": None}, BeliefSettings()) == existence
