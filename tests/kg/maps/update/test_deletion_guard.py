"""Large deletions are refused until somebody confirms them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from kg.maps.semantic_map import SemanticMap
from kg.maps.update.deletion_guard import DeletionLimit
from kg.model import vocabulary as v
from kg.model.errors import UnconfirmedDeletionError
from kg.model.records import MapUpdate, ObjectRecord, PlaceRecord
from kg.serving.opening import in_memory_map

BASE = "http://m/"
EVERYTHING = "DELETE WHERE { ?s ?p ?o }"


def fill(made: SemanticMap, objects: int, places: int = 1) -> None:
    cup = made.catalogue.find("cup").iri
    position = np.array([1.0, 1.0, 0.5])
    records = tuple(
        ObjectRecord(made.new_object_iri(), cup, position, 1.0, 0.5, 3, 10.0, 50.0)
        for _ in range(objects)
    )
    rooms = tuple(
        PlaceRecord(f"{BASE}place/{n}", f"place {n}", n, n + 1, 0, 5, 1) for n in range(places)
    )
    made.apply(MapUpdate(objects=records, places=rooms))


@pytest.fixture
def home() -> Iterator[SemanticMap]:
    with in_memory_map(base=BASE) as made:
        fill(made, 30, 2)
        yield made


def delete_objects(least: int, most: int) -> str:
    names = " ".join(f"<object/{n}>" for n in range(least, most + 1))
    return (
        f"DELETE {{ ?s ?p ?o }} WHERE {{ VALUES ?s {{ {names} }} GRAPH graph:map {{ ?s ?p ?o }} }}"
    )


def test_an_update_that_empties_the_map_is_refused_and_says_what_would_have_worked(
    home: SemanticMap,
) -> None:
    before, sequence = set(home.engine), home.sequence
    with pytest.raises(UnconfirmedDeletionError) as refusal:
        home.update(EVERYTHING, by="ann")
    assert "32 of 32 objects and places" in str(refusal.value)
    assert "--yes" in str(refusal.value) and "Here-Confirm: delete" in str(refusal.value)
    assert (set(home.engine), home.sequence) == (before, sequence)


def test_a_confirmed_deletion_is_carried_out(home: SemanticMap) -> None:
    home.update(EVERYTHING, by="ann", confirmed=True)
    assert not home.objects() and not home.places()


def test_ten_things_go_without_a_question_and_eleven_of_thirty_do_not(home: SemanticMap) -> None:
    home.update(delete_objects(1, 10))
    assert len(home.objects()) == 20
    with pytest.raises(UnconfirmedDeletionError, match="11 of 22 objects and places"):
        home.update(delete_objects(11, 21))


def test_a_small_share_of_a_large_map_goes_without_a_question() -> None:
    with in_memory_map(base=BASE) as large:
        fill(large, 150)
        large.update(delete_objects(1, 15))
        assert len(large.objects()) == 135


def test_a_small_map_can_be_emptied_without_a_question() -> None:
    with in_memory_map(base=BASE) as small:
        fill(small, 9)
        small.update(EVERYTHING)
        assert not small.objects()


def test_what_loses_its_type_and_what_is_replaced_count_by_their_result(home: SemanticMap) -> None:
    with pytest.raises(UnconfirmedDeletionError):
        home.update("DELETE { ?s a ?t } WHERE { GRAPH graph:map { ?s a ?t ; here:x ?x } }")
    cup, bowl = f"<{home.catalogue.find('cup').iri}>", f"<{v.HERE}Bowl>"
    home.update(
        f"DELETE {{ ?s a {cup} }} INSERT {{ ?s a {bowl} }} WHERE {{ ?s a {cup} }}", by="ann"
    )
    assert {record.category for record in home.objects()} == {v.HERE + "Bowl"}


def test_the_limit_can_be_set(home: SemanticMap) -> None:
    home.deletion_limit = DeletionLimit(share=1.0)
    home.update(EVERYTHING)
    fill(home, 3)
    home.deletion_limit = DeletionLimit(share=0.0, count=1)
    with pytest.raises(UnconfirmedDeletionError):
        home.update(delete_objects(31, 32))


def test_the_rdflib_view_asks_too(home: SemanticMap) -> None:
    with pytest.raises(UnconfirmedDeletionError):
        home.dataset.update(EVERYTHING)
    home.dataset.update(EVERYTHING, confirmed=True)
    assert not home.objects()
