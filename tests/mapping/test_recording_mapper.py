import numpy as np
import pytest

from kg.model.areas import Rectangle
from kg.model.errors import RecordingError
from kg.serving.opening import create_map, in_memory_map, open_map
from mapping.frames.projection import robot_at
from mapping.mapping_options import MappingOptions
from mapping.places.layout import Layout, LayoutPlace
from mapping.recording_mapper import map_recording
from mapping.runs.progress_report import STAGES

MIDDLE = (30, 22, 34, 26)


@pytest.fixture
def drive(step_back):
    """Five frames that step back from a wall by 0.3 m each."""
    return [step_back(n) for n in range(5)]


@pytest.fixture
def cup(scripted_detector, make_detections):
    return lambda: scripted_detector({}, make_detections(("cup", 0.5, MIDDLE)))


def facts(semantic_map):
    """What a user sees of the map, without the identity of the map itself.

    How sure it is of each object is left out: a run that goes on knows the sum of earlier views.
    """
    return (
        [(o.iri, o.p_map.tolist(), o.observations) for o in semantic_map.objects()],
        [(p.label, p.xmin, p.xmax, p.views, dict(p.beliefs)) for p in semantic_map.places()],
    )


def test_recording_becomes_objects_places_and_a_robot(
    semantic_map, drive, list_recording, cup, scripted_scene
):
    scene = scripted_scene({"kitchen": 0.9, "bar": 0.1})
    report = map_recording(list_recording(drive), semantic_map, cup(), scene)
    (found,) = semantic_map.objects()
    (place,) = semantic_map.places()
    assert found.p_map == pytest.approx([2.0, 0.0, 1.0])
    assert found.observations == 5
    assert found.place == place.iri
    assert (found.evidence.recording, found.evidence.model) == ("room", "scripted")
    assert place.label == "room" and place.views == 5
    assert semantic_map.robot().p_map == pytest.approx([-1.2, 0.0, 1.0])
    assert semantic_map.robot().heading == pytest.approx(0.0)
    (progress,) = semantic_map.recordings()
    assert (progress.frames_applied, progress.last_frame) == (5, "frame-000004")
    assert (report.frames, report.skipped, report.objects, report.views) == (5, 0, 1, 5)


def test_mapped_frames_are_skipped(semantic_map, drive, list_recording, cup):
    map_recording(list_recording(drive), semantic_map, cup())
    before, detector = facts(semantic_map), cup()
    report = map_recording(list_recording(drive), semantic_map, detector)
    assert (report.frames, report.skipped, report.frames_per_second) == (0, 5, 0.0)
    assert detector.asked == []
    assert facts(semantic_map) == before


def test_again_maps_them_once_more(semantic_map, drive, list_recording, cup):
    map_recording(list_recording(drive), semantic_map, cup())
    report = map_recording(list_recording(drive), semantic_map, cup(), again=True)
    assert report.frames == 5
    assert semantic_map.objects()[0].observations == 10
    assert semantic_map.recordings()[0].frames_applied == 5


def test_cut_again_does_not_forget_how_far_the_recording_was(
    semantic_map, drive, list_recording, cup
):
    map_recording(list_recording(drive), semantic_map, cup())
    broken = list_recording(drive, broken=frozenset({2}))
    with pytest.raises(RecordingError):
        map_recording(broken, semantic_map, cup(), again=True)
    assert semantic_map.recordings()[0].frames_applied == 5


def test_unreadable_frame_leaves_the_whole_frames_before_it(
    tmp_path, drive, list_recording, cup, scripted_scene
):
    with create_map(tmp_path / "a.map", base="https://example.org/map/") as cut:
        broken = list_recording(drive, broken=frozenset({3}))
        with pytest.raises(RecordingError, match="frame 3 is truncated"):
            map_recording(broken, cut, cup(), scripted_scene({"kitchen": 1.0}))
        assert cut.recordings()[0].frames_applied == 3
        assert cut.objects()[0].observations == 3
    with open_map(tmp_path / "a.map") as resumed:
        report = map_recording(
            list_recording(drive), resumed, cup(), scripted_scene({"kitchen": 1.0})
        )
        assert (report.frames, report.skipped) == (2, 3)
        after, existence = facts(resumed), resumed.objects()[0].existence
    with in_memory_map(base="https://example.org/map/") as whole:
        map_recording(list_recording(drive), whole, cup(), scripted_scene({"kitchen": 1.0}))
        assert after == facts(whole)
        assert existence == pytest.approx(whole.objects()[0].existence, abs=0.02)


def test_killed_between_frames_goes_on_with_the_next(semantic_map, drive, list_recording, cup):
    def stop(report):
        if report.index == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        map_recording(list_recording(drive), semantic_map, cup(), on_frame=stop)
    detector = cup()
    map_recording(list_recording(drive), semantic_map, detector)
    assert detector.asked == ["frame-000002", "frame-000003", "frame-000004"]


def test_scene_network_is_asked_only_for_frames_that_can_be_used(
    semantic_map, make_frame, list_recording, cup, scripted_scene
):
    still = [make_frame(2.0, id=str(n), stamp=1e9 + n) for n in range(4)]
    dark = make_frame(np.nan, id="dark", stamp=1e9 + 9)
    scene = scripted_scene({"kitchen": 1.0})
    report = map_recording(list_recording([*still, dark]), semantic_map, cup(), scene)
    assert scene.asked == ["0"]
    assert report.views == 1
    assert report.unplaced == 1


def test_given_layout_is_written_even_where_nothing_is_seen(
    semantic_map, drive, list_recording, cup
):
    layout = Layout(
        (
            LayoutPlace(1, "here", Rectangle(-9, 9, -9, 9)),
            LayoutPlace(2, "there", Rectangle(20, 30, 0, 9)),
        )
    )
    map_recording(list_recording(drive), semantic_map, cup(), options=MappingOptions(layout=layout))
    assert [p.label for p in semantic_map.places()] == ["here", "there"]
    assert semantic_map.objects()[0].place == semantic_map.place_iri(1)


def test_objects_follow_a_new_layout_without_being_seen(
    semantic_map, drive, make_frame, list_recording, cup
):
    map_recording(list_recording(drive), semantic_map, cup())
    layout = Layout((LayoutPlace(7, "shelf", Rectangle(1.5, 2.5, -1, 1)),))
    blind = list_recording([make_frame(np.nan)], name="blind")
    map_recording(blind, semantic_map, cup(), options=MappingOptions(layout=layout))
    assert semantic_map.objects()[0].place == semantic_map.place_iri(7)


def test_two_recordings_make_one_building(semantic_map, drive, make_frame, list_recording, cup):
    map_recording(list_recording(drive), semantic_map, cup())
    away = []
    for n in range(2):
        T = make_frame().T_map_cam.copy()
        T[0, 3] = 10.0 - 0.3 * n
        away.append(make_frame(2.0 + 0.3 * n, T=T, id=f"den-{n}"))
    map_recording(list_recording(away, name="den"), semantic_map, cup())
    assert [r.name for r in semantic_map.recordings()] == ["den", "room"]
    labels = {p.iri: p.label for p in semantic_map.places()}
    assert sorted(labels[o.place] for o in semantic_map.objects()) == ["den", "room"]


def test_callbacks_hear_of_each_frame(semantic_map, drive, list_recording, cup, scripted_scene):
    reports, pictures = [], []
    map_recording(
        list_recording(drive),
        semantic_map,
        cup(),
        scripted_scene({"kitchen": 1.0}),
        on_frame=reports.append,
        on_detections=lambda *shown: pictures.append(shown),
    )
    assert [r.index for r in reports] == [0, 1, 2, 3, 4]
    assert {r.total for r in reports} == {5}
    assert all(set(r.seconds) == set(STAGES) for r in reports)
    assert [frame.id for frame, _, _ in pictures] == [frame.id for frame in drive]
    assert all(len(detections) == 1 for _, detections, _ in pictures)
    assert pictures[0][2].probability == {"kitchen": 1.0}


def test_heading_follows_the_camera_axis(make_frame):
    T = np.array([[-1.0, 0, 0, 1], [0, 0, 1, 2], [0, -1, 0, 1], [0, 0, 0, 1]])
    robot = robot_at(make_frame(T=T))  # looks along map y
    assert robot.heading == pytest.approx(np.pi / 2)
    assert robot.p_map == pytest.approx([1, 2, 1])
