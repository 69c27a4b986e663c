"""A search honours what people asserted: a thing that it sees again stays one object."""

from collections.abc import Callable, Iterator

import pytest

from kg.maps.semantic_map import SemanticMap
from kg.serving.opening import in_memory_map
from planner.execution.object_updates import ObjectUpdates
from planner.execution.options import Event, SearchOutcome
from tests.planner.robots import ring, run

AT = (5.0, 3.0, 0.8)  # [m] where `ring` puts its apple
ELSEWHERE = (6.5, 1.0, 0.8)  # [m] farther from there than an object is associated over


@pytest.fixture
def semantic_map() -> Iterator[SemanticMap]:
    with in_memory_map() as semantic_map:
        ring(semantic_map, apples=1)
        yield semantic_map


def _sees(semantic_map: SemanticMap, label: str, at: tuple[float, float, float]) -> SearchOutcome:
    return run(semantic_map, "apple", objects=[[label, *at, 0.9]])


def _only(semantic_map: SemanticMap) -> str:
    """Local name of the map's only object."""
    (record,) = semantic_map.objects()
    return record.iri.removeprefix(semantic_map.base)


@pytest.mark.parametrize(
    ("retracted", "seen", "expected"),
    [
        (False, ELSEWHERE, [ELSEWHERE]),
        (False, AT, [ELSEWHERE]),  # where it was before its correction
        (True, AT, [AT]),
        (True, ELSEWHERE, [AT, ELSEWHERE]),
    ],
)
def test_a_thing_seen_where_people_say_it_is_stays_one_object(
    semantic_map, retracted, seen, expected
):
    assert semantic_map.assertions.add("object/1", "position", ELSEWHERE, by="ann")
    if retracted:
        assert semantic_map.assertions.retract("object/1", "position", by="ann")
    outcome = _sees(semantic_map, "apple", seen)
    apples = semantic_map.objects("apple")
    for apple, p_map in zip(apples, expected, strict=True):
        assert apple.p_map == pytest.approx(p_map, abs=0.01)
        assert apple.place == semantic_map.place_iri(2)
    assert set(outcome.found) <= {apple.iri for apple in apples}
    if seen == ELSEWHERE and not retracted:
        assert outcome.found == (apples[0].iri,)
        assert semantic_map.assertions.conflicts() == ()  # perception is at the same position


@pytest.mark.parametrize(
    ("wanted", "label", "state"),
    [("orange", "apple", "found"), ("orange", "orange", "found"), ("apple", "apple", "given up")],
)
def test_a_corrected_category_names_what_is_found(semantic_map, wanted, label, state):
    assert semantic_map.assertions.add("object/1", "category", "orange", by="ann")
    outcome = run(semantic_map, wanted, objects=[[label, *AT, 0.9]])
    assert _only(semantic_map) == "object/1"
    found = (f"{semantic_map.base}object/1",) if state == "found" else ()
    assert (outcome.state, outcome.found) == (state, found)


def test_a_thing_that_people_say_is_gone_is_not_doubled_where_it_is_seen(semantic_map):
    assert semantic_map.assertions.add("object/1", "existence", "absent", by="ann")
    _sees(semantic_map, "apple", AT)
    assert _only(semantic_map) == "object/1"
    assert semantic_map.objects()[0].existence == 0.0


def _during(act: Callable[[], object]) -> Callable[[Event], None]:
    """Do `act` once, at the search's first plan."""
    done: list[object] = []

    def on_event(event: Event) -> None:
        if event.kind == "plan" and not done:
            done.append(act())

    return on_event


def test_a_correction_while_the_robot_drives_counts(semantic_map: SemanticMap) -> None:
    act = _during(lambda: semantic_map.assertions.add("object/1", "position", ELSEWHERE, by="ann"))
    run(semantic_map, "apple", objects=[["apple", *ELSEWHERE, 0.9]], on_event=act)
    assert _only(semantic_map) == "object/1"


def test_a_thing_deleted_while_the_robot_drives_is_a_new_one_when_it_is_seen(semantic_map):
    delete = f"DELETE WHERE {{ <{semantic_map.base}object/1> ?p ?o }}"
    act = _during(lambda: semantic_map.update(delete, by="ann"))
    outcome = run(semantic_map, "apple", objects=[["apple", *AT, 0.9]], on_event=act)
    (apple,) = semantic_map.objects("apple")
    assert outcome.found == (apple.iri,)
    assert apple.observations <= 2  # nothing of the deleted one is left


def test_what_people_say_is_there_stays_when_looks_are_in_vain(semantic_map: SemanticMap) -> None:
    assert semantic_map.assertions.add("object/1", "existence", "present", by="ann")
    assert run(semantic_map, "apple").state == "given up"
    assert _only(semantic_map) == "object/1"
    assert semantic_map.objects()[0].existence == 1.0


def test_objects_of_a_category_are_those_that_people_put_into_it(semantic_map: SemanticMap) -> None:
    find = semantic_map.catalogue.find
    updates = ObjectUpdates(semantic_map)
    assert semantic_map.assertions.add("object/1", "category", "orange", by="ann")
    assert semantic_map.assertions.add("object/1", "position", ELSEWHERE, by="ann")
    assert updates.of({find("apple").iri}) == ()
    (orange,) = updates.of({find("orange").iri})
    assert orange.p_map == pytest.approx(ELSEWHERE)
