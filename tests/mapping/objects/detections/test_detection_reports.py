"""What became of detections: counted while frames are mapped, kept in the map's folder."""

import json
import os
from dataclasses import replace

import numpy as np
import pytest

from kg.model.errors import GraphError
from kg.model.records import MapUpdate
from kg.serving.opening import create_map, open_map
from mapping.labels.label_resolver import LabelTable
from mapping.mapper import Mapper
from mapping.mapping_options import MappingOptions
from mapping.objects.bayes_mapper import BayesObjectMapper
from mapping.objects.detections.detection_report import (
    MAX_BYTES,
    MAX_THINGS,
    DetectionFates,
    DetectionReport,
    DoubtedThing,
    Fate,
    read_report,
    report_from_json,
)
from mapping.objects.detections.detection_reporter import DetectionReporter
from mapping.objects.object_mapper import ObjectChanges
from mapping.objects.settings import ObjectSettings
from mapping.objects.tracks import Track
from mapping.recording_mapper import map_recording

MIDDLE = (28, 20, 36, 28)
LEFT = (8, 20, 16, 28)
BASE = "https://example.org/map/"


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "a.map"


@pytest.fixture
def detected(folder, step_back):
    """Callable: detections of each frame -> the report after them."""

    def run(*frames, view=step_back, **options):
        with (
            create_map(folder, base=BASE) as semantic_map,
            Mapper(semantic_map, MappingOptions(**options), recording="room") as mapper,
        ):
            for number, detections in enumerate(frames):
                mapper.add(view(number), detections)
            return mapper.detection_report()

    return run


def fates(report, category):
    return dict(report.categories[category])


def test_detections_of_an_object_are_counted_as_its_own(detected, make_detections):
    report = detected(*[make_detections(("cup", 0.65, MIDDLE))] * 5)
    assert (report.frames, fates(report, "cup")) == (5, {Fate.OBJECT: 5})
    assert [(thing.iri, thing.seen) for thing in report.things] == [(f"{BASE}object/1", 5)]


def test_what_is_believed_is_not_doubted(detected, make_detections, make_frame):
    def view(n):
        """A look from one of several sides."""
        T = make_frame().T_map_cam.copy()
        c, s = np.cos(0.5 * n), np.sin(0.5 * n)
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        T[:3, :3] = turn @ T[:3, :3]
        T[:3, 3] = np.array([2.0, 0.0, 1.0]) - 2.0 * T[:3, 2]
        return make_frame(2.0, T=T, id=f"frame-{n:06d}", stamp=1e6 + n)

    cup = make_detections(("cup", 0.9, MIDDLE))
    assert detected(*[cup] * 8, view=view).things == ()


def test_a_candidate_is_told_with_its_best_view(detected, make_detections):
    seen = [make_detections(("keyboard", score, MIDDLE)) for score in (0.2, 0.22)]
    settings = ObjectSettings(confirmed=0.99)
    report = detected(*seen, objects=settings)
    assert fates(report, "keyboard") == {Fate.CANDIDATE: 2}
    (thing,) = report.things
    assert (thing.category, thing.seen, thing.iri) == ("keyboard", 2, "")
    assert (thing.recording, thing.frame, thing.box) == ("room", "frame-000001", MIDDLE)
    assert thing.score == pytest.approx(0.22)
    assert 0 < thing.existence < 0.5
    assert report.doubted == 1


def test_candidates_that_are_not_seen_again_are_forgotten(detected, make_detections):
    settings = ObjectSettings(confirmed=0.99, forgotten=2)
    once, never = make_detections(("keyboard", 0.3, MIDDLE)), make_detections()
    report = detected(once, never, never, never, objects=settings)
    assert fates(report, "keyboard") == {Fate.FORGOTTEN: 1}
    assert (report.things, report.doubted) == ((), 0)


def test_what_is_of_no_use_is_told_apart(detected, make_detections, make_frame):
    depth = np.full((49, 65), 2.0)
    depth[:, :24], depth[:, 40:] = 9.0, 0.2
    first = make_detections(
        ("cup", 0.1, MIDDLE),
        ("gizmo", 0.9, MIDDLE),
        ("person", 0.9, MIDDLE),
        ("book", 0.9, LEFT),
        ("book", 0.9, (48, 20, 56, 28)),
    )
    report = detected(
        first, view=lambda n: make_frame(depth, stamp=1e6 + n), labels=LabelTable({"person": None})
    )
    assert fates(report, "cup") == {Fate.WEAK: 1}
    assert fates(report, "gizmo") == {Fate.UNKNOWN: 1}
    assert fates(report, "person") == {Fate.IGNORED: 1}
    assert fates(report, "book") == {Fate.FAR: 1, Fate.NEAR: 1}


def test_boxes_without_depth_are_counted(detected, make_detections, make_frame):
    depth = np.full((49, 65), 2.0)
    depth[:, :40] = np.nan
    first = make_detections(("laptop", 0.9, LEFT))
    report = detected(first, view=lambda n: make_frame(depth))
    assert fates(report, "laptop") == {Fate.NO_DEPTH: 1}


def test_a_frame_that_could_not_be_written_counts_once(semantic_map, step_back, make_detections):
    mapper = BayesObjectMapper(semantic_map)
    detections = make_detections(("cup", 0.9, MIDDLE), ("book", 0.1, LEFT), ("gizmo", 0.9, LEFT))
    for _ in range(3):
        mapper.undo(mapper.add(step_back(0), detections))
    mapper.add(step_back(0), detections)
    reporter = DetectionReporter(semantic_map, mapper)
    reporter.keep()
    mapper.undo(ObjectChanges())  # of a transaction that was no frame's
    report = reporter.report()
    assert report.frames == 1
    assert {name: sum(of.values()) for name, of in report.categories.items()} == {
        "cup": 1,
        "book": 1,
        "gizmo": 1,
    }


def test_detections_follow_a_thing_that_is_merged():
    cup, mug = (Track(np.array([x, 0.0, 1.0]), 0.1, ObjectSettings()) for x in (2.0, 2.1))
    cup.iri = f"{BASE}object/1"
    fates = DetectionFates()
    fates.begin([])
    fates.seen(cup, frozenset({"cup"}))
    fates.seen(mug, frozenset({"mug"}))
    fates.begin([cup, mug])
    fates.seen(mug, frozenset({"mug"}))
    fates.merge(cup, mug)
    fates.settle()
    fates.sweep([cup])
    assert fates.things == {cup.number: (cup, {"cup": 1, "mug": 2})}
    fates.sweep([])
    assert fates.things == {}
    assert fates.by_category() == {"mug": {Fate.OBJECT: 2}, "cup": {Fate.OBJECT: 1}}


def test_the_report_is_kept_and_goes_on(folder, detected, make_detections, step_back):
    cup = make_detections(("cup", 0.9, MIDDLE), ("keyboard", 0.1, LEFT))
    made = detected(*[cup] * 3)
    assert read_report(folder).to_json() == made.to_json()
    with open_map(folder) as semantic_map, Mapper(semantic_map, recording="room") as mapper:
        mapper.add(step_back(3), cup)
    report = read_report(folder)
    assert report.frames == 4
    assert fates(report, "cup") == {Fate.OBJECT: 4}
    assert fates(report, "keyboard") == {Fate.WEAK: 4}


def test_candidates_of_an_earlier_run_are_forgotten(folder, detected, make_detections, step_back):
    detected(make_detections(("keyboard", 0.3, MIDDLE)), objects=ObjectSettings(confirmed=0.99))
    with open_map(folder) as semantic_map, Mapper(semantic_map, recording="room") as mapper:
        mapper.add(step_back(1), make_detections())
    assert fates(read_report(folder), "keyboard") == {Fate.FORGOTTEN: 1}


def test_detections_of_an_object_that_left_stay_counted(folder, detected, make_detections):
    detected(*[make_detections(("cup", 0.9, MIDDLE))] * 3)
    with open_map(folder) as semantic_map:
        semantic_map.apply(MapUpdate(removed=(f"{BASE}object/1",)))
        with Mapper(semantic_map) as mapper:
            report = mapper.detection_report()
    assert fates(report, "cup") == {Fate.OBJECT: 3}


def test_the_mapping_report_names_what_is_not_believed(
    semantic_map, step_back, list_recording, scripted_detector, make_detections
):
    weak = scripted_detector({}, make_detections(("keyboard", 0.25, MIDDLE)))
    report = map_recording(list_recording([step_back(0)]), semantic_map, weak)
    assert report.doubted == 1
    told = report.to_json()
    assert told["doubted"] == 1
    assert told["most_probable_doubted"][0]["category"] == "keyboard"
    json.dumps(told, allow_nan=False)


def test_viewers_see_no_detection_that_is_too_weak(
    semantic_map, step_back, list_recording, scripted_detector, make_detections
):
    both = scripted_detector({}, make_detections(("cup", 0.9, MIDDLE), ("cup", 0.1, LEFT)))
    shown = []
    map_recording(
        list_recording([step_back(0)]),
        semantic_map,
        both,
        on_detections=lambda frame, detections, scene: shown.append(detections),
    )
    assert [len(detections) for detections in shown] == [1]


# what others may have put there

THING = DoubtedThing("cup", 0.3, 4, frame="f", recording="r", box=(1.0, 2.0, 3.0, 4.0))
REPORT = DetectionReport(3, {"cup": {Fate.WEAK: 2}}, (THING,), 1)


def test_a_report_survives_json():
    assert report_from_json(json.loads(json.dumps(REPORT.to_json()))) == REPORT
    many = replace(REPORT, things=(THING,) * 500)
    assert len(report_from_json(many.to_json()).things) == MAX_THINGS


HOSTILE = {
    "binary": b"\xff\x00\x01",
    "deep": b"[" * 100_000,
    "long number": b'{"version": ' + b"9" * 10_000 + b"}",
    "other version": json.dumps({**REPORT.to_json(), "version": 7}).encode(),
    "nan": json.dumps({**REPORT.to_json(), "nearest": float("nan")}).encode(),
    "thing": json.dumps({**REPORT.to_json(), "things": [[]]}).encode(),
    "fate": json.dumps({**REPORT.to_json(), "categories": {"a": {"eaten": 1}}}).encode(),
    "huge": b" " * (MAX_BYTES + 1),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_what_is_no_report_is_refused(name, tmp_path):
    (tmp_path / "detections.json").write_bytes(HOSTILE[name])
    with pytest.raises(GraphError) as refused:
        read_report(tmp_path)
    assert len(str(refused.value)) < 1000


def test_a_report_of_an_older_form_counts_as_none(tmp_path):
    (tmp_path / "detections.json").write_text('{"version": 1, "frames": 7, "categories": {}}')
    assert read_report(tmp_path) is None


def test_what_is_no_report_is_replaced(folder, detected, make_detections, step_back):
    detected(make_detections(("cup", 0.9, MIDDLE)))
    (folder / "detections.json").write_bytes(HOSTILE["binary"])
    with open_map(folder) as semantic_map, Mapper(semantic_map, recording="room") as mapper:
        mapper.add(step_back(1), make_detections(("cup", 0.9, MIDDLE)))
    assert read_report(folder).frames == 1


def test_a_link_is_neither_read_nor_written_through(folder, detected, make_detections, tmp_path):
    other = tmp_path / "other.json"
    other.write_text(json.dumps(REPORT.to_json()))
    with create_map(folder, base=BASE):
        (folder / "detections.json").symlink_to(other)
        with pytest.raises(GraphError, match="file of its own"):
            read_report(folder)
    with pytest.raises(GraphError, match=r"detections\.json, a link"):
        open_map(folder)
    assert json.loads(other.read_text()) == REPORT.to_json()


def test_a_pipe_in_its_place_ends_the_keeping_only(folder, step_back, make_detections):
    with create_map(folder, base=BASE) as semantic_map:
        os.mkfifo(folder / "detections.json")
        with Mapper(semantic_map) as mapper:
            mapper.add(step_back(0), make_detections(("cup", 0.9, MIDDLE)))
        assert mapper.detection_report().frames == 1
    with pytest.raises(GraphError, match="no regular file"):
        read_report(folder)


def test_labels_may_be_any_text_without_end(semantic_map, step_back, make_detections):
    with Mapper(semantic_map) as mapper:
        for frame in range(3):
            found = [(f"{frame} {n} " + "x" * 500, 0.1, MIDDLE) for n in range(600)]
            mapper.add(step_back(frame), make_detections(*found))
        report = mapper.detection_report()
    assert sum(sum(of.values()) for of in report.categories.values()) == 1800
    assert len(json.dumps(report.to_json())) < MAX_BYTES
    assert report_from_json(report.to_json()).frames == 3
