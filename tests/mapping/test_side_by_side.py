"""A second mapping of a home: side by side, and found again."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import LayoutError, MapBusyError
from kg.serving.opening import create_map, open_map
from kg.serving.server import BearerTokens, MapServer
from mapping.mapping_options import MappingOptions
from mapping.recording_mapper import map_recording
from perception.camera.poses import motion
from perception.frames import Frame
from perception.sources.recording import FolderRecording, open_recording
from perception.sources.recording_options import RecordingOptions, Selection
from tests.small_server import SMALL

TOKEN = "a-token-of-the-tests-0123"


@pytest.fixture
def server(semantic_map, monkeypatch):
    """Callable: `semantic_map` as a mapper far away has it."""
    monkeypatch.setenv("HEREABOUTS_TOKEN", TOKEN)
    settings = replace(SMALL, tokens=BearerTokens((("ann", TOKEN.encode()),)))
    with MapServer(semantic_map, settings) as running:
        monkeypatch.setenv("HEREABOUTS_SERVER", running.url)
        yield lambda: open_map(running.url)


@pytest.fixture
def frames(step_back: Callable[..., Frame]) -> list[Frame]:
    return [step_back(n, id=f"frame-{n}") for n in range(6)]


@pytest.fixture
def detector(scripted_detector, make_detections):
    """Sees one cup in each frame."""
    return scripted_detector({}, make_detections(("cup", 0.9, (30, 22, 34, 26))))


def notes(semantic_map: SemanticMap) -> list[str]:
    return [c.cause.note for c in semantic_map.history.changes(0) if c.cause.kind == "frame"]


@pytest.mark.parametrize("here", [True, False], ids=["beside the server", "afar"])
def test_a_recording_that_two_map_at_once_is_mapped_by_one_of_them(
    here, semantic_map, server, frames, list_recording, detector
):
    recording = list_recording(frames)
    with server() as one, server() as other:
        second = semantic_map if here else other

        def meanwhile(report: object) -> None:
            if report.index == 1:
                assert map_recording(recording, second, detector).frames == 4

        with pytest.raises(MapBusyError, match=r"else maps recording 'room' .* at frame 6"):
            map_recording(recording, one, detector, on_frame=meanwhile)
    assert [*dict.fromkeys(notes(semantic_map))] == [f"room/{f.id}" for f in frames]
    (cup,) = semantic_map.objects()
    assert cup.observations == 6, "each sighting counts once"


def test_recordings_are_mapped_side_by_side(semantic_map, server, frames, list_recording, detector):
    with server() as one, server() as other:

        def meanwhile(report: object) -> None:
            if report.index == 1:
                map_recording(list_recording(frames, name="hall"), other, detector)

        assert map_recording(list_recording(frames), one, detector, on_frame=meanwhile).frames == 6
    assert {r.name: r.frames_applied for r in semantic_map.recordings()} == {"room": 6, "hall": 6}
    (cup,) = semantic_map.objects()
    assert cup.observations == 12, "each sighting counts once"


@pytest.mark.parametrize("here", [True, False], ids=["beside the server", "afar"])
def test_a_mapper_continues_on_a_map_that_was_restored_meanwhile(
    here, semantic_map, server, frames, list_recording, detector
):
    recording = list_recording(frames)
    with server() as far:

        def meanwhile(report: object) -> None:
            if report.index == 2:
                semantic_map.update("DELETE WHERE { ?s ?p ?o }", confirmed=True)
            if report.index == 4:
                (after_three,) = [
                    c.sequence
                    for c in semantic_map.history.changes(0)
                    if c.cause.note == "room/frame-2"
                ][-1:]
                semantic_map.restore(after_three, by="ann")

        mapped = map_recording(
            recording, semantic_map if here else far, detector, on_frame=meanwhile
        )
    assert mapped.frames == 6
    (cup,) = semantic_map.objects()
    assert cup.observations == 4, "three before the deletion, and the frame after the restoration"
    assert semantic_map.recordings()[0].frames_applied == 6


OPTIONS = MappingOptions(check_poses=False, surface=None, pictures=False)
GIVEN = RecordingOptions(check=False, selection=Selection(every=4, limit=12))


@pytest.fixture(scope="module")
def second(shared: Callable[[str], Path], tmp_path_factory) -> FolderRecording:
    """Other images of the living room than the map's, without poses, in their own world."""
    source, folder = shared("data/rgbd/icl_livingroom"), tmp_path_factory.mktemp("r") / "second"
    for name in ("image", "depth"):
        (folder / name).mkdir(parents=True)
        for path in sorted((source / name).iterdir())[5:25:2]:
            (folder / name / path.name).symlink_to(path)
    shutil.copy(source / "intrinsics.json", folder)
    return open_recording(folder)


@pytest.fixture
def nothing(scripted_detector, make_detections):
    return scripted_detector({}, make_detections())


def test_it_is_placed_in_the_map_and_the_map_says_how(shared, tmp_path, second, nothing):
    first = open_recording(shared("data/rgbd/icl_livingroom"), GIVEN)
    truth = open_recording(shared("data/rgbd/icl_livingroom"), RecordingOptions(check=False))
    true = {entry.id: first.T_map_world @ entry.T_world_cam for entry in truth.listing.entries}
    with create_map(tmp_path / "a.map") as semantic_map:
        map_recording(first, semantic_map, nothing, options=OPTIONS)
        report = map_recording(second, semantic_map, nothing, options=OPTIONS)
        assert report.frames == len(second)
        assert "second was recognised in" in report.fit
        record = {r.name: r for r in semantic_map.recordings()}["second"]
        assert "errors of up to" in record.pose_estimate
        assert "; recognised in" in record.pose_estimate
        placed = second.placed(record.T_map_world)
        for frame in placed.frames():
            far, turned = motion(true[frame.id], frame.T_map_cam)
            assert far < 0.06
            assert turned < np.deg2rad(2)
        again = map_recording(second, semantic_map, nothing, options=OPTIONS)
        assert (again.frames, again.skipped) == (0, len(second))


def test_it_is_refused_in_a_map_of_another_room(shared, tmp_path, second, nothing):
    lounge = open_recording(shared("data/rgbd/hololens_lounge"), GIVEN)
    with create_map(tmp_path / "a.map") as semantic_map:
        map_recording(lounge, semantic_map, nothing, options=OPTIONS)
        before = semantic_map.sequence
        with pytest.raises(LayoutError, match=r"place of 'second'.*not recognised.*would work"):
            map_recording(second, semantic_map, nothing, options=OPTIONS)
        (semantic_map.store.path / "views.sqlite").unlink()
        with pytest.raises(LayoutError, match=r"the map keeps no views.*a new map would work"):
            map_recording(second, semantic_map, nothing, options=OPTIONS)
        with pytest.raises(LayoutError, match="a world of their own"):
            map_recording(second, semantic_map, nothing, options=MappingOptions(same_frame=True))
        assert semantic_map.sequence == before
