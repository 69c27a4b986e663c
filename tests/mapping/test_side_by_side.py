"""Two mappers on one served map: other recordings side by side, one recording by one of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from kg.maps.semantic_map import SemanticMap
from kg.model.errors import MapBusyError
from kg.serving.opening import open_map
from kg.serving.server import BearerTokens, MapServer, Settings
from mapping.recording_mapper import map_recording
from perception.frames import Detections, Frame

TOKEN = "a-token-of-the-tests-0123"


@pytest.fixture
def server(
    semantic_map: SemanticMap, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[[], SemanticMap]]:
    """Callable: `semantic_map` as a mapper far away has it."""
    monkeypatch.setenv("HEREABOUTS_TOKEN", TOKEN)
    settings = Settings(port=0, tokens=BearerTokens((("ann", TOKEN.encode()),)))
    with MapServer(semantic_map, settings) as running:
        monkeypatch.setenv("HEREABOUTS_SERVER", running.url)
        yield lambda: open_map(running.url)


@pytest.fixture
def frames(step_back: Callable[..., Frame]) -> list[Frame]:
    return [step_back(n, id=f"frame-{n}") for n in range(6)]


@pytest.fixture
def detector(
    scripted_detector: Callable[..., object], make_detections: Callable[..., Detections]
) -> object:
    """Sees one cup in each frame."""
    return scripted_detector({}, make_detections(("cup", 0.9, (30, 22, 34, 26))))


def notes(semantic_map: SemanticMap) -> list[str]:
    return [c.cause.note for c in semantic_map.history.changes(0) if c.cause.kind == "frame"]


@pytest.mark.parametrize("here", [True, False], ids=["beside the server", "afar"])
def test_a_recording_that_two_map_at_once_is_mapped_by_one_of_them(
    here: bool,
    semantic_map: SemanticMap,
    server: Callable[[], SemanticMap],
    frames: list[Frame],
    list_recording: Callable[..., object],
    detector: object,
) -> None:
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


def test_recordings_are_mapped_side_by_side(
    semantic_map: SemanticMap,
    server: Callable[[], SemanticMap],
    frames: list[Frame],
    list_recording: Callable[..., object],
    detector: object,
) -> None:
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
    here: bool,
    semantic_map: SemanticMap,
    server: Callable[[], SemanticMap],
    frames: list[Frame],
    list_recording: Callable[..., object],
    detector: object,
) -> None:
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
