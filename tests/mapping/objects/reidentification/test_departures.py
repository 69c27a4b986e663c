"""What left is remembered in the map: after a restart, by other mappers, until people say no."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from kg.knowledge.ontology.lint import check_map
from kg.maps.semantic_map import SemanticMap
from kg.model.records import DepartedRecord, MapUpdate
from kg.model.transactions import Cause
from kg.serving.opening import create_map, open_map
from mapping.mapper import Mapper
from mapping.mapping_options import MappingOptions
from mapping.objects.settings import ObjectSettings
from perception.frames import Detections, Frame

View = Callable[..., Frame]
FAR_WALL = 5.0  # [m] seen instead of a thing that is gone


LATER = 3600.0  # [s] after the first views


def see(mapper: Mapper, view: View, *boxes: tuple[str, float, float], after: float = 0.0) -> None:
    """Three views of things (label, metres beside the middle, score), `after` [s] later."""
    for n in range(3):
        scale = 2 / (2 + 0.3 * n)
        corners = [
            (32 + (25 * x - 3) * scale, 24 - 3 * scale, 32 + (25 * x + 3) * scale, 24 + 3 * scale)
            for _, x, _ in boxes
        ]
        scores = np.array([score for *_, score in boxes], dtype=np.float32)
        found = Detections(
            np.array(corners, np.float32).reshape(-1, 4), scores, tuple(b[0] for b in boxes)
        )
        frame = view(n)
        mapper.add(replace(frame, stamp=frame.stamp + after), found)


def leave(mapper: Mapper, view: View) -> list[MapUpdate]:
    """Three views in which nothing is there."""
    nothing = Detections(np.zeros((0, 4), np.float32), np.zeros(0, np.float32), ())
    frames = [view(n) for n in range(3)]
    return [
        mapper.add(replace(frame, depth=np.full_like(frame.depth, FAR_WALL)), nothing)
        for frame in frames
    ]


CUP, ELSEWHERE = ("cup", 0.0, 0.8), ("cup", 0.8, 0.8)


def mapped_and_left(semantic_map: SemanticMap, view: View) -> str:
    mapper = Mapper(semantic_map)
    see(mapper, view, CUP)
    (cup,) = semantic_map.objects()
    leave(mapper, view)
    (departed,) = semantic_map.departed()
    assert (semantic_map.objects(), departed.iri) == ((), cup.iri)
    assert departed.observations == cup.observations
    return cup.iri


def test_after_a_restart_what_left_is_found_elsewhere(tmp_path: Path, step_back: View) -> None:
    with create_map(tmp_path / "a.map") as semantic_map:
        iri = mapped_and_left(semantic_map, step_back)
    with open_map(tmp_path / "a.map") as semantic_map:
        see(Mapper(semantic_map), step_back, ELSEWHERE, after=LATER)
        (cup,) = semantic_map.objects()
        assert (cup.iri, cup.observations, semantic_map.departed()) == (iri, 6, ())
        assert cup.p_map[1] < -0.5 or cup.p_map[1] > 0.5
        assert check_map(semantic_map.engine) == []


def test_what_another_mapper_found_gone_is_found_elsewhere(
    semantic_map: SemanticMap, step_back: View
) -> None:
    mapper = Mapper(semantic_map)
    see(mapper, step_back, CUP)
    (cup,) = semantic_map.objects()
    seen = cup.first_seen, cup.last_seen, cup.last_seen + 1
    departed = DepartedRecord(cup.iri, cup.category, cup.p_map, 0.9, 3, *seen, cup.extent)
    update = MapUpdate(removed=(cup.iri,), departed=(departed,))
    semantic_map.apply(update, Cause("frame", "another"))
    see(mapper, step_back, ELSEWHERE, after=LATER)
    assert [found.iri for found in semantic_map.objects()] == [cup.iri]


def test_what_people_delete_is_not_found_again(semantic_map: SemanticMap, step_back: View) -> None:
    mapper = Mapper(semantic_map)
    see(mapper, step_back, CUP)
    (cup,) = semantic_map.objects()
    leave(mapper, step_back)
    semantic_map.update(f"DELETE WHERE {{ <{cup.iri}> ?p ?o }}")
    see(mapper, step_back, ELSEWHERE, after=LATER)
    (new,) = semantic_map.objects()
    assert new.iri != cup.iri


def test_what_people_say_is_not_there_is_not_remembered(
    semantic_map: SemanticMap, step_back: View
) -> None:
    mapper = Mapper(semantic_map)
    see(mapper, step_back, CUP)
    (cup,) = semantic_map.objects()
    semantic_map.assertions.add(cup.iri, "existence", "absent", by="ann")
    leave(mapper, step_back)
    assert semantic_map.departed() == ()


@pytest.mark.parametrize("again", [False, True])
def test_only_the_latest_are_kept(semantic_map: SemanticMap, step_back: View, again: bool) -> None:
    mapper = Mapper(semantic_map, MappingOptions(objects=ObjectSettings(departures=1)))
    for label in ("cup", "bottle"):
        see(mapper, step_back, (label, 0.0, 0.8))
        leave(mapper, step_back)
        if again:  # a restart between them
            mapper = Mapper(semantic_map, MappingOptions(objects=ObjectSettings(departures=1)))
    (departed,) = semantic_map.departed()
    assert semantic_map.catalogue.label(departed.category) == "bottle"
    assert check_map(semantic_map.engine) == []


def test_what_left_is_written_once(semantic_map: SemanticMap, step_back: View) -> None:
    mapper = Mapper(semantic_map)
    see(mapper, step_back, CUP)
    updates = leave(mapper, step_back) + leave(mapper, step_back)
    assert sum(len(update.departed) for update in updates) == 1
