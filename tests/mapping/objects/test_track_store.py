"""The store of tracks beside a map: a run that ended, however it did, goes on as it was."""

import functools
import gc
import shutil
import signal
import sqlite3
import time
from pathlib import Path

import pytest

from kg.maps.semantic_map import SemanticMap
from kg.serving.opening import create_map, open_map
from lab.houses.random_house import random_house
from lab.recordings.hard_senses import SENSES, detector_of
from mapping.mapper import Mapper
from mapping.mapping_options import MappingOptions
from mapping.objects.bayes_mapper import BayesObjectMapper
from mapping.objects.settings import ObjectSettings
from mapping.objects.track_store import FILE, RunState, TrackStore
from perception.frames import Detections, Frame
from planner.simulation.camera import SimulatedCamera
from planner.simulation.house_robot import SimulatedTour
from tests.waiting import program

FRAMES = 30
_NO_VIEWPOINTS = """UPDATE tracks SET state = json_set(state, '$.viewpoints', json('[1]'))
    WHERE number = 0"""
_NO_BOX = (
    "UPDATE tracks SET state = json_set(state, '$.box', json('[0,0,0,1,-1,1,9]')) WHERE number"
)


@functools.cache
def tour() -> tuple[tuple[Frame, Detections], ...]:
    """The first frames of a drive through a house, with a weak detector's detections."""
    camera = SimulatedCamera(random_house(77), seed=77)
    detector = detector_of(camera, SENSES["hard"])
    recording = SimulatedTour(camera)
    frames = [next(recording.frames(number)) for number in range(FRAMES)]
    return tuple((frame, detector.detect(frame)) for frame in frames)


def go_on(semantic_map: SemanticMap, until: int = FRAMES) -> Mapper:
    """Map the frames that the map does not hold yet, up to number `until`."""
    mapper = Mapper(
        semantic_map, MappingOptions(occupancy=False, check_poses=False), recording="tour"
    )
    for frame, found in tour()[mapper.frames_applied : until]:
        mapper.add(frame, found)
    return mapper


def objects(folder: Path) -> list[tuple[object, ...]]:
    with open_map(folder, read_only=True) as semantic_map:
        return sorted(
            (
                record.iri.removeprefix(semantic_map.base),
                record.category,
                record.p_map.tolist(),
                None if record.extent is None else record.extent.tolist(),
                record.yaw,
                record.existence,
                record.observations,
                sorted(record.labels.items()),
            )
            for record in semantic_map.objects()
        )


@pytest.fixture(scope="module")
def begun(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A map of the first 20 frames."""
    folder = tmp_path_factory.mktemp("begun") / "a.map"
    with create_map(folder) as semantic_map:
        go_on(semantic_map, 20)
    gc.collect()  # the mapper's connection
    return folder


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[object, ...]]:
    folder = tmp_path_factory.mktemp("whole") / "a.map"
    with create_map(folder) as semantic_map:
        go_on(semantic_map)
    found = objects(folder)
    assert len(found) > 5
    return found


def test_a_run_that_is_killed_makes_the_same_map(tmp_path, uninterrupted):
    create_map(tmp_path / "a.map").close()
    text = (
        "import runpy, sys; from pathlib import Path; from kg.serving.opening import open_map\n"
        f"names = runpy.run_path({str(Path(__file__))!r})\n"
        "names['tour'](); print('begun', flush=True)\n"
        f"names['go_on'](open_map(Path({str(tmp_path / 'a.map')!r})))\n"
    )
    with program(text) as running:
        assert running.stdout is not None and running.stdout.readline() == "begun\n"
        time.sleep(0.5)
        running.send_signal(signal.SIGKILL)
    with open_map(tmp_path / "a.map") as semantic_map:
        go_on(semantic_map)
    assert objects(tmp_path / "a.map") == uninterrupted


def test_what_was_stored_for_a_transaction_that_never_came_does_not_count(
    tmp_path: Path, begun: Path, uninterrupted: list[tuple[object, ...]]
) -> None:
    shutil.copytree(begun, tmp_path / "a.map")
    with open_map(tmp_path / "a.map") as semantic_map:
        store = TrackStore(tmp_path / "a.map")
        tracks, run = store.load(semantic_map.sequence, ObjectSettings())
        for track in tracks:
            track.observations += 100
            track.changed = True
        store.save(tracks[1:], run, semantic_map.sequence + 1)
        store.close()
    with open_map(tmp_path / "a.map") as semantic_map:
        go_on(semantic_map)
    assert objects(tmp_path / "a.map") == uninterrupted


def test_what_people_changed_meanwhile_counts(tmp_path: Path, begun: Path) -> None:
    shutil.copytree(begun, tmp_path / "a.map")
    with open_map(tmp_path / "a.map") as semantic_map:
        first = semantic_map.objects()[0]
        semantic_map.update(f"DELETE WHERE {{ <{first.iri}> ?p ?o }}", by="ann")
    with open_map(tmp_path / "a.map") as semantic_map:
        mapper = BayesObjectMapper(semantic_map)
        assert first.iri not in {track.iri for track in mapper.tracks}


@pytest.mark.parametrize(
    "damage",
    [
        lambda path: path.write_bytes(b"no database" * 100),
        lambda path: path.write_bytes(path.read_bytes()[:3000]),
        lambda path: _filled(path, "CREATE VIEW tracks AS SELECT 1 AS number"),
        lambda path: _filled(path, "UPDATE tracks SET state = '[]'"),
        lambda path: _filled(path, "UPDATE tracks SET state = json_remove(state, '$.low')"),
        lambda path: _filled(path, 'UPDATE tracks SET state = replace(state, ":", ": 1e999,")'),
        lambda path: _filled(
            path, "UPDATE tracks SET state = json_set(state, '$.views', '//') WHERE number"
        ),
        lambda path: _filled(path, _NO_BOX),
        lambda path: _filled(path, _NO_VIEWPOINTS),
    ],
    ids=[
        *("text", "cut", "a view", "no object", "no boxes", "no number", "no views", "no box"),
        "no viewpoints",
    ],
)
def test_a_damaged_file_is_thrown_away(tmp_path: Path, begun: Path, damage) -> None:
    shutil.copytree(begun, tmp_path / "a.map")
    before = objects(tmp_path / "a.map")
    for suffix in ("-wal", "-shm"):
        Path(f"{tmp_path / 'a.map' / FILE}{suffix}").unlink(missing_ok=True)
    damage(tmp_path / "a.map" / FILE)
    assert objects(tmp_path / "a.map") == before
    with open_map(tmp_path / "a.map") as semantic_map:
        go_on(semantic_map, 24)
        assert len(semantic_map.objects()) >= max(6, len(before))
        store = TrackStore(tmp_path / "a.map")
        assert store.load(semantic_map.sequence, ObjectSettings())[0]
        store.close()


def _filled(path: Path, statement: str) -> None:
    with sqlite3.connect(path) as file:
        if statement.startswith("CREATE"):
            file.execute("DROP TABLE tracks")
        file.execute(statement)
    file.close()


def test_the_state_of_a_run_is_read_as_it_was_at_a_transaction(tmp_path: Path) -> None:
    first, second = RunState(7, 1.5, {"a": [[1.0, 2.0]]}), RunState(8, 2.5)
    store = TrackStore(tmp_path)
    store.load(0, ObjectSettings())
    for mark, run in ((1, first), (2, second)):
        store.save([], run, mark)
    store.close()
    for sequence, wanted in ((2, second), (1, first)):  # the second never came
        store = TrackStore(tmp_path)
        assert store.load(sequence, ObjectSettings()) == ([], wanted)
        store.close()


def test_a_link_in_its_place_is_not_followed(tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.write_text("mine")
    (tmp_path / FILE).symlink_to(elsewhere)
    store = TrackStore(tmp_path)
    assert store.load(0, ObjectSettings()) == ([], RunState())
    store.save([], RunState(), 1)
    store.close()
    assert elsewhere.read_text() == "mine"
