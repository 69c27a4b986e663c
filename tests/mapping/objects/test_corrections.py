"""Many ways in which people and perception agree, contradict each other and change their minds."""

import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import ConflictError
from kg.model.records import MapUpdate, PlaceRecord
from kg.model.transactions import Cause, ChangeSet
from kg.serving.client.remote_map import RemoteMap
from kg.serving.opening import create_map, in_memory_map, open_map
from kg.serving.server import BearerTokens, MapServer
from mapping.objects.object_mapper import ReferenceObjectMapper
from mapping.places.place_registry import PlaceRegistry
from mapping.reference.settings import ReferenceSettings
from tests.mapping.correction_scripts import SCRIPTS
from tests.mapping.correction_stage import BASE, ROOM, Acts, Stage, as_told, halves, play, runs
from tests.small_server import SMALL

TOKEN = "a-token-of-the-tests-0123"


@pytest.fixture(scope="module")
def empty_map(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("maps") / "empty.map"
    create_map(path, base=BASE).close()
    return path


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.name)
def test_the_map_is_as_told(script, make_frame):
    with in_memory_map(base=BASE) as semantic_map:
        for steps in runs(script.steps):
            play(semantic_map, steps, make_frame)
        as_told(semantic_map, script)


@pytest.mark.parametrize("script", SCRIPTS[::2], ids=lambda script: script.name)
def test_the_map_is_as_told_when_reopened_again_and_again(script, make_frame, empty_map, tmp_path):
    path = tmp_path / "a.map"
    shutil.copytree(empty_map, path)
    parts = [part for steps in runs(script.steps) for part in halves(steps)]
    for number, part in enumerate(parts, start=1):
        with open_map(path) as semantic_map:
            play(semantic_map, part, make_frame)
            if number == len(parts):
                as_told(semantic_map, script)


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[SemanticMap, str]]:
    """A map, and the address where it is served to whoever has the token in the environment."""
    monkeypatch.setenv("HEREABOUTS_TOKEN", TOKEN)
    settings = replace(SMALL, tokens=BearerTokens((("ann", TOKEN.encode()),)))
    with in_memory_map(base=BASE) as semantic_map, MapServer(semantic_map, settings) as server:
        monkeypatch.setenv("HEREABOUTS_SERVER", server.url)
        yield semantic_map, server.url


@pytest.mark.parametrize("script", SCRIPTS[6::14], ids=lambda script: script.name)
@pytest.mark.parametrize("afar", [True, False], ids=["people afar", "people beside the server"])
def test_a_mapper_writes_into_a_served_map_as_into_its_folder(script, afar, make_frame, served):
    semantic_map, url = served
    with open_map(url) as mapper, open_map(url) as people:
        for steps in runs(script.steps):
            play(mapper, steps, make_frame, people if afar else semantic_map)
        as_told(semantic_map, script)


@pytest.mark.parametrize("times", [2, 3])
def test_a_frame_that_somebody_gets_in_the_way_of_is_mapped_anew(
    times, make_frame, served, monkeypatch
):
    semantic_map, url = served
    monkeypatch.setattr("mapping.mapper.MAX_ATTEMPTS", 3)
    with open_map(url) as far:
        assert isinstance(far, RemoteMap)
        play(far, ["see cup", "see cup"], make_frame)
        frames = semantic_map.recordings()[0].frames_applied
        write, left = far.apply, times

        def contested(update: MapUpdate, cause: Cause | None = None) -> ChangeSet | None:
            nonlocal left
            if left and update.objects:
                left -= 1  # a cup is put elsewhere between what was read and what is written
                Acts(semantic_map).do("move", ["1", f"{2.1 + 0.05 * left}", "0"])
            return write(update, cause)

        monkeypatch.setattr(far, "apply", contested)
        if times == 3:
            with pytest.raises(ConflictError, match=r"others have changed object/1 since #\d+"):
                play(far, ["blind", "see cup"], make_frame)
            assert semantic_map.objects()[0].observations == 2
            return
        play(far, ["blind", "see cup"], make_frame)
        (cup,) = semantic_map.objects()
        assert cup.p_map[0] == pytest.approx((2 * 2.1 + 2) / 3, abs=0.01)
        assert cup.observations == 3, "each sighting counts once"
        assert (frames, [r.frames_applied for r in semantic_map.recordings()]) == (2, [2, 2])


def test_the_mapper_hears_of_what_another_program_moves_removes_and_adds(served, make_frame):
    other, url = served
    with open_map(url) as semantic_map:
        mapper = ReferenceObjectMapper(semantic_map, ReferenceSettings())
        book = PlaceRegistry(semantic_map, ROOM)
        stage = Stage(["see cup left", "see cup right"], Acts(other), make_frame)
        for frame, detections, _ in stage.shots():
            changes = mapper.add(frame, detections)
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
