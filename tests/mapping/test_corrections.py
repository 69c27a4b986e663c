"""Fifty ways in which people and perception agree, contradict each other and change their minds."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from kg.commits import Cause
from kg.records import MapUpdate, PlaceRecord
from kg.semantic_map import SemanticMap
from mapping.object_mapper import ObjectMapper
from mapping.place_book import PlaceBook
from mapping.settings import ReferenceSettings
from perception.frame import Frame
from tests.mapping.correction_scripts import SCRIPTS, Script
from tests.mapping.correction_stage import (
    BASE,
    ROOM,
    Acts,
    Stage,
    as_told,
    halves,
    play,
    runs,
)


@pytest.fixture(scope="module")
def empty_map(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("maps") / "empty.map"
    SemanticMap.create(path, base=BASE).close()
    return path


def test_there_are_fifty_scripts_and_no_two_are_the_same():
    assert len({script.steps for script in SCRIPTS}) == len(SCRIPTS) >= 50


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.name)
def test_the_map_is_as_told(script, make_frame):
    with SemanticMap.in_memory(base=BASE) as semantic_map:
        for steps in runs(script.steps):
            play(semantic_map, steps, make_frame)
        as_told(semantic_map, script)


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.name)
def test_the_map_is_as_told_when_reopened_again_and_again(script, make_frame, empty_map, tmp_path):
    path = tmp_path / "a.map"
    shutil.copytree(empty_map, path)
    parts = [part for steps in runs(script.steps) for part in halves(steps)]
    for number, part in enumerate(parts, start=1):
        with SemanticMap.open(path) as semantic_map:
            play(semantic_map, part, make_frame)
            if number == len(parts):
                as_told(semantic_map, script)


def said(script: Script) -> bool:
    """Whether people only say and unsay: updates are for maps in a folder."""
    verbs = {step.split()[0] for steps in runs(script.steps) for step in steps}
    return "say" in verbs and verbs <= {"see", "look", "blind", "view", "say", "unsay"}


@pytest.mark.parametrize("script", [*filter(said, SCRIPTS)][::3], ids=lambda script: script.name)
def test_people_and_mapper_are_two_programs_on_one_server(
    script: Script, sparql_server: str, make_frame: Callable[..., Frame]
) -> None:
    with (
        SemanticMap.create(sparql_server, base=BASE) as semantic_map,
        SemanticMap.open(sparql_server) as people,
    ):
        for steps in runs(script.steps):
            play(semantic_map, steps, make_frame, people)
        as_told(semantic_map, script)


def test_the_mapper_hears_of_what_another_program_moves_removes_and_adds(
    sparql_server: str, make_frame: Callable[..., Frame]
) -> None:
    with (
        SemanticMap.create(sparql_server, base=BASE) as semantic_map,
        SemanticMap.open(sparql_server) as other,
    ):
        mapper = ObjectMapper(semantic_map, ReferenceSettings())
        book = PlaceBook(semantic_map, ROOM)
        stage = Stage(["see cup left", "see cup right"], Acts(other), make_frame, 0)
        for frame in stage.frames():
            changes = mapper.step(frame, stage.detect(frame))
            semantic_map.apply(MapUpdate(objects=changes.updated))
        left, right = other.objects()
        mapper.refresh()
        assert {o.iri for o in mapper.objects()} == {left.iri, right.iri}
        kitchen = other.catalogue.find("kitchen").iri
        added = replace(left, iri=f"{BASE}object/9", p_map=np.array([5.0, 3.0, 1.0]))
        moved = replace(right, p_map=np.array([3.0, 2.0, 1.0]))
        update = MapUpdate(
            objects=(added, moved),
            removed=(left.iri,),
            places=(PlaceRecord(f"{BASE}place/7", "loft", 10, 12, 0, 2, 1, {kitchen: 1.0}),),
        )
        other.apply(update, Cause("import", "somebody"))
        mapper.refresh()
        book.refresh()
        found = {o.iri: tuple(o.p_map) for o in mapper.objects()}
        assert found == {moved.iri: (3.0, 2.0, 1.0), added.iri: (5.0, 3.0, 1.0)}
        assert [p.label for p in book.places()] == ["the room", "loft"]
