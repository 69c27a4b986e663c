"""What the history of a thing tells people: no counters, no corrections within the uncertainty."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from kg.model import vocabulary as v
from kg.model.records import MapUpdate, ObjectRecord, PlaceRecord
from kg.serving.opening import in_memory_map

Told = Callable[..., list[list[str]]]
CUP, BOWL = v.HERE + "Cup", v.HERE + "Bowl"


@pytest.fixture
def told() -> Iterator[Told]:
    """Callable: what the history tells of each of the states (x, existence, category) of a cup.

    None is a cup that is removed, a text an update of the map.
    """
    with in_memory_map() as semantic_map:

        def tell(*states: tuple[float, float, str] | str | None) -> list[list[str]]:
            iri = semantic_map.base + "object/1"
            for number, state in enumerate(states, start=1):
                if state is None:
                    semantic_map.apply(MapUpdate(removed=(iri,)))
                elif isinstance(state, str):
                    semantic_map.update(state)
                else:
                    x, existence, kind = state
                    at = np.array([x, 2.0, 0.5])
                    seen = ObjectRecord(
                        iri, kind, at, 3 * existence, existence, number, 1.0, number
                    )
                    semantic_map.apply(MapUpdate(objects=(seen,)))
            return [list(event.told) for event in semantic_map.history.events("object/1")]

        yield tell


def test_a_step_below_the_uncertainty_is_not_told_and_steps_add_up(told: Told) -> None:
    first, *later = told(*((x, 0.9, CUP) for x in (1.0, 1.06, 1.12, 1.18)))
    assert first == ["new: cup", "at (1.00, 2.00) m", "there with 90 %", "called cup 1"]
    assert later == [[], ["moved 0.12 m, at (1.12, 2.00) m"], []]


def test_an_existence_is_told_where_it_is_surer_or_well_on_the_other_side(told: Told) -> None:
    _, *later = told(*((1.0, existence, CUP) for existence in (0.45, 0.52, 0.6, 0.75, 0.85)))
    assert later == [[], ["there with 60 %"], [], ["there with 85 %"]]


def test_a_place_is_new_once_and_told_what_it_turns_out_to_be() -> None:
    with in_memory_map() as semantic_map:
        place = PlaceRecord(semantic_map.base + "place/1", "place 1", 0.0, 4.0, 0.0, 4.0)
        semantic_map.apply(MapUpdate(places=(place,)))
        believed = replace(place, views=3, beliefs={v.HERE + "Kitchen": 0.9})
        semantic_map.apply(MapUpdate(places=(believed,)))
        first, second = (event.told for event in semantic_map.history.events("place/1"))
    assert first == ("new: place", "at (2.00, 2.00) m", "called place 1")
    assert second == ("a kitchen now",)


def test_a_new_kind_is_told(told: Told) -> None:
    assert "a bowl now" in told((1.0, 0.9, CUP), (1.0, 0.9, BOWL))[1]


def test_what_other_graphs_say_of_a_thing_is_not_told(told: Told) -> None:
    facts = "<object/1> here:x 'far' ; a <http://example.org/Note>"
    graph = f"GRAPH <http://example.org/notes> {{ {facts} }}"
    _, *later = told((1.0, 0.9, CUP), f"INSERT DATA {{ {graph} }}", f"DELETE DATA {{ {graph} }}")
    assert not any(later)


def test_a_thing_that_is_removed_and_comes_again_has_its_position_told(told: Told) -> None:
    first, gone, again = told((1.0, 0.9, CUP), None, (1.0, 0.9, CUP))
    assert gone == ["removed"] and again == first


def test_a_move_counts_beyond_twice_the_uncertainty_of_both_positions() -> None:
    def cup(number: int, x: float) -> ObjectRecord:
        iri, at = f"{semantic_map.base}object/{number}", np.array([x, 2.0, 0.5])
        return ObjectRecord(iri, CUP, at, 2.7, 0.9, 3, 1.0, 1.0, deviation=0.2)

    with in_memory_map() as semantic_map:
        for moved in (0.0, 0.6):  # [m]; both deviations together are 0.28 m
            cups = cup(1, 1.0 + moved), cup(2, 1.0 - 0.8 * moved)
            semantic_map.apply(MapUpdate(objects=cups))
        (change,) = semantic_map.history.compare(semantic_map.sequence - 1).changes
        assert (change.kind, change.iri) == ("moved", "object/1")


def test_causes_places_and_other_things_have_the_names_that_answers_print() -> None:
    with in_memory_map() as semantic_map:
        base, at = semantic_map.base, np.array([1.0, 2.0, 0.5])
        kinds = {v.HERE + "Kitchen": 0.9}
        place = PlaceRecord(base + "place/7", "place 7", 0.0, 4.0, 0.0, 4.0, 3, kinds)
        things = tuple(
            ObjectRecord(f"{base}object/{n}", kind, at, 3, 0.9, 3, 1.0, 3, place=place.iri)
            for n, kind in ((1, CUP), (2, v.HERE + "DiningTable"))
        )
        semantic_map.apply(MapUpdate(places=(place,), objects=things))
        semantic_map.assertions.add("object/1", "on", "object/2", by="ann")
        new, placed = semantic_map.history.events("object/1")
    assert "in the kitchen" in new.told
    assert placed.told == ("on dining table 2",)
    assert placed.cause_words == "assert cup 1 on dining table 2"
