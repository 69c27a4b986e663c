"""Objects and places of the past, by the same conditions as those of now."""

from collections.abc import Callable
from datetime import UTC, datetime

import pytest

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import HistoryError, UnknownCategoryError
from kg.model.records import MapUpdate
from kg.serving.opening import create_map, in_memory_map, open_map
from tests.conftest import publish

Frame = Callable[..., MapUpdate]
BASE = "https://example.org/flat/"
FIRST, SECOND = BASE + "object/1", BASE + "object/2"


@pytest.fixture(params=["in memory", "on disk, reopened for reading"], scope="module")
def lived(request, frame, tmp_path_factory):
    """A map of six frames whose second chair then left it."""
    path = tmp_path_factory.mktemp("past") / "flat.map"
    in_memory = request.param == "in memory"
    with in_memory_map(base=BASE) if in_memory else create_map(path, base=BASE) as made:
        for number in range(6):
            made.apply(frame(number))
        made.apply(MapUpdate(removed=(SECOND,)))
        if in_memory:
            yield made
    if not in_memory:
        with open_map(path, read_only=True) as opened:
            yield opened


def test_objects_of_then_are_those_of_the_map_of_then(lived: SemanticMap) -> None:
    assert [record.iri for record in lived.objects()] == [FIRST]
    then = lived.objects(at=3)
    assert [(record.iri, record.observations) for record in then] == [(FIRST, 3), (SECOND, 3)]
    assert lived.objects(at="#3")[1].p_map[0] == pytest.approx(2.02)
    assert lived.objects(at=0) == ()
    assert [r.iri for r in lived.objects(at=datetime.now(UTC))] == [FIRST]


def test_conditions_hold_in_the_past_too(lived: SemanticMap) -> None:
    near = lived.objects("chair", place=1, near=(2.0, 1.0), radius=0.5, at=6)
    assert [record.iri for record in near] == [SECOND]
    assert [record.iri for record in lived.objects(near=SECOND, at=6)] == [FIRST]
    assert lived.objects("banana", at=6) == ()
    with pytest.raises(UnknownCategoryError):
        lived.objects("bananna", at=6)


def test_places_of_then(lived: SemanticMap) -> None:
    assert lived.places(at=0) == ()
    assert [place.views for place in lived.places("kitchen", at=1)] == [1]
    assert [place.views for place in lived.places(at=6)] == [2]
    assert lived.places("office", at=6) == ()
    assert len(lived.places("office", min_belief=0.2, at=6)) == 1


def test_a_past_that_is_not_kept_is_said_so(lived: SemanticMap) -> None:
    with pytest.raises(HistoryError, match="no transaction #99"):
        lived.objects(at=99)
    with pytest.raises(HistoryError, match="someday"):
        lived.places(at="someday")


def test_a_published_map_keeps_no_past(sparql_server: str, frame: Frame) -> None:
    with in_memory_map(base=BASE) as local:
        local.apply(frame(0))
        publish(local, sparql_server)
    with open_map(sparql_server, read_only=True) as semantic_map:
        for ask in (semantic_map.objects, semantic_map.places):
            assert ask()
            with pytest.raises(HistoryError, match="keeps no history"):
                ask(at=1)
