"""Objects and places of the past, by the same conditions as those of now."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import pytest

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import HistoryError, UnknownCategoryError
from kg.model.records import MapUpdate
from kg.serving.opening import create_map, in_memory_map, open_map
from tests.conftest import publish

Frame = Callable[..., MapUpdate]
BASE = "https://example.org/flat/"
FIRST, SECOND = BASE + "object/1", BASE + "object/2"


@pytest.fixture(params=["in memory", "on disk", "on disk, reopened for reading"])
def lived(
    request: pytest.FixtureRequest, frame: Frame, tmp_path: Path
) -> Callable[[], SemanticMap]:
    """Callable: a map of six frames whose second chair then left it."""

    def make() -> SemanticMap:
        if request.param == "in memory":
            made = in_memory_map(base=BASE)
        else:
            made = create_map(tmp_path / "flat.map", base=BASE)
        for number in range(6):
            made.apply(frame(number))
        made.apply(MapUpdate(removed=(SECOND,)))
        if "reopened" not in request.param:
            return made
        made.close()
        return open_map(tmp_path / "flat.map", read_only=True)

    return make


def test_objects_of_then_are_those_of_the_map_of_then(lived: Callable[[], SemanticMap]) -> None:
    with lived() as semantic_map:
        assert [record.iri for record in semantic_map.objects()] == [FIRST]
        then = semantic_map.objects(at=3)
        assert [(record.iri, record.observations) for record in then] == [(FIRST, 3), (SECOND, 3)]
        assert semantic_map.objects(at="#3")[1].p_map[0] == pytest.approx(2.02)
        assert semantic_map.objects(at=0) == ()
        assert [r.iri for r in semantic_map.objects(at=datetime.now(UTC))] == [FIRST]


def test_conditions_hold_in_the_past_too(lived: Callable[[], SemanticMap]) -> None:
    with lived() as semantic_map:
        near = semantic_map.objects("chair", place=1, near=(2.0, 1.0), radius=0.5, at=6)
        assert [record.iri for record in near] == [SECOND]
        beside = semantic_map.objects(near=SECOND, at=6)
        assert [record.iri for record in beside] == [FIRST]
        assert semantic_map.objects("banana", at=6) == ()
        with pytest.raises(UnknownCategoryError):
            semantic_map.objects("bananna", at=6)


def test_places_of_then(lived: Callable[[], SemanticMap]) -> None:
    with lived() as semantic_map:
        assert semantic_map.places(at=0) == ()
        assert [place.views for place in semantic_map.places("kitchen", at=1)] == [1]
        assert [place.views for place in semantic_map.places(at=6)] == [2]
        assert semantic_map.places("office", at=6) == ()
        assert len(semantic_map.places("office", min_belief=0.2, at=6)) == 1


def test_a_past_that_is_not_kept_is_said_so(lived: Callable[[], SemanticMap]) -> None:
    with lived() as semantic_map:
        with pytest.raises(HistoryError, match="no transaction #99"):
            semantic_map.objects(at=99)
        with pytest.raises(HistoryError, match="someday"):
            semantic_map.places(at="someday")


def test_a_published_map_keeps_no_past(sparql_server: str, frame: Frame) -> None:
    with in_memory_map(base=BASE) as local:
        local.apply(frame(0))
        publish(local, sparql_server)
    with open_map(sparql_server, read_only=True) as semantic_map:
        for ask in (semantic_map.objects, semantic_map.places):
            assert ask()
            with pytest.raises(HistoryError, match="keeps no history"):
                ask(at=1)
