"""The per-frame API: frames and sightings in, one transaction each."""

import numpy as np
import pytest

from kg.model.areas import Rectangle
from kg.model.errors import LabelsError
from kg.model.records import MapUpdate
from kg.model.vocabulary import MAP_GRAPH
from kg.serving.opening import in_memory_map
from mapping.frames.sighting import Sighting
from mapping.labels.label_resolver import LabelTable
from mapping.mapper import Mapper
from mapping.mapping_options import MappingOptions
from mapping.objects.settings import ObjectSettings
from mapping.places.layout import Layout, LayoutPlace
from mapping.recording_mapper import map_recording
from mapping.reference.settings import ReferenceSettings
from perception.frames import SceneScores

MIDDLE = (28, 20, 33, 25)
ROOM = Layout((LayoutPlace(1, "room", Rectangle(-9, 9, -9, 9)),))
KITCHEN = SceneScores({"kitchen": 0.9, "bar": 0.1})


@pytest.fixture
def cup(make_detections):
    return make_detections(("cup", 0.9, MIDDLE))


@pytest.fixture
def map_cup(step_back, cup):
    """Callable: mapper -> the cup's record, after two views of it."""

    def two_views(mapper):
        mapper.add(step_back(0), cup)
        (record,) = mapper.add(step_back(0, id="again", stamp=1e9 + 1), cup).objects
        return record

    return two_views


def test_each_frame_is_one_transaction_and_returned_as_written(semantic_map, step_back, cup):
    with Mapper(semantic_map, MappingOptions(layout=ROOM)) as mapper:
        mapper.add(step_back(0), cup)
        before = semantic_map.sequence
        update = mapper.add(step_back(0, id="again", stamp=1e9 + 1), cup)
        assert semantic_map.sequence == before + 1
        (record,) = update.objects
        assert record.p_map == pytest.approx([2.0, 0.0, 1.0], abs=0.1)
        assert [o.iri for o in semantic_map.objects("cup")] == [record.iri]
        assert update.recording.frames_applied == mapper.frames_applied == 2
        assert mapper.changed_triples > 0


def test_a_loop_over_add_makes_the_map_that_map_recording_makes(
    make_frame, make_detections, list_recording, scripted_detector, scripted_scene, cup
):
    script = {"f2": make_detections(), "f3": make_detections(("bed", 0.8, MIDDLE))}
    frames = [make_frame(2.0 + 0.1 * n, id=f"f{n}", stamp=1e6 + n) for n in range(5)]
    detector, scene = scripted_detector(script, cup), scripted_scene({"kitchen": 0.9})

    def facts(semantic_map):
        graph = MAP_GRAPH
        return sorted(map(str, semantic_map.engine.quads_for_pattern(None, None, None, graph)))

    with in_memory_map(base="https://example.org/map/") as one:
        map_recording(list_recording(frames), one, detector, scene)
        expected = facts(one)
    with in_memory_map(base="https://example.org/map/") as other:
        with Mapper(other, recording="room", detector="scripted", scene_model="scripted") as mapper:
            for frame in frames:
                mapper.add(frame, detector.detect(frame), scene.classify(frame))
        assert facts(other) == expected


def test_scores_count_only_where_the_view_does(semantic_map, make_frame, make_detections):
    mapper = Mapper(semantic_map, MappingOptions(layout=ROOM))
    frame, nothing = make_frame(2.0), make_detections()
    assert mapper.viewed_place(frame) == semantic_map.place_iri(1)
    (place,) = mapper.add(frame, nothing, KITCHEN).places
    assert place.views == 1
    again = make_frame(2.0, id="from the same pose")
    assert mapper.viewed_place(again) is None
    assert mapper.add(again, nothing, KITCHEN).places == ()
    blind = make_frame(np.nan, id="without depth")
    assert mapper.add(blind, nothing, KITCHEN).places == ()
    assert semantic_map.places()[0].views == 1


def test_sightings_belong_to_the_objects_that_frames_showed(semantic_map, map_cup):
    mapper = Mapper(semantic_map, MappingOptions(layout=ROOM))
    first = map_cup(mapper)
    near = Sighting(first.category, 0.8, first.p_map + np.array([0.1, 0, 0]))
    (again,) = mapper.add_sightings([near], 1e9 + 5).objects
    assert (again.iri, again.observations, again.last_seen) == (first.iri, 3, 1e9 + 5)
    assert again.evidence == first.evidence  # a sighting without a box has none
    far = Sighting(first.category, 0.8, first.p_map + np.array([2.0, 0, 0]))
    (new,) = mapper.add_sightings([far], 1e9 + 6).objects
    assert new.place == semantic_map.place_iri(1)
    assert len(semantic_map.objects("cup")) == 2
    assert mapper.frames_applied == 2


def test_no_sighting_is_no_evidence_against_anything(semantic_map, map_cup):
    mapper = Mapper(semantic_map, MappingOptions(layout=ROOM))
    map_cup(mapper)
    before = semantic_map.sequence
    assert mapper.add_sightings([], 1e6 + 5) == MapUpdate()
    assert semantic_map.sequence == before


def test_a_stream_is_continued_by_its_name(semantic_map, step_back, cup):
    for run in range(2):
        with Mapper(semantic_map, recording="robot 1") as mapper:
            assert mapper.frames_applied == 2 * run
            for n in (2 * run, 2 * run + 1):
                mapper.add(step_back(0, id=f"f{n}", stamp=1e9 + n), cup)
    (record,) = semantic_map.recordings()
    assert (record.name, record.frames_applied, record.last_frame) == ("robot 1", 4, "f3")
    (found,) = semantic_map.objects()
    assert found.observations == 4


def test_occupancy_can_be_left_out(semantic_map, make_frame, cup):
    with Mapper(semantic_map, MappingOptions(occupancy=False)) as mapper:
        mapper.add(make_frame(2.0), cup)
    assert semantic_map.floor() == ()


@pytest.mark.parametrize("mode", ["bayes", "reference"])
def test_labels_and_settings_are_the_callers(semantic_map, step_back, make_detections, mode):
    labels = LabelTable({"mug": "cup"})
    settings, objects = ReferenceSettings(min_score=0.5), ObjectSettings(min_score=0.5)
    mapper = Mapper(
        semantic_map, MappingOptions(mode=mode, labels=labels, reference=settings, objects=objects)
    )
    seen = make_detections(("mug", 0.9, MIDDLE), ("bowl", 0.4, (5, 5, 15, 15)))
    for n in range(3):
        mapper.add(step_back(n), seen)
    (found,) = semantic_map.objects()
    assert semantic_map.catalogue.label(found.category) == "cup"
    with pytest.raises(LabelsError):
        Mapper(semantic_map, MappingOptions(labels=LabelTable({"mug": "flux capacitor"})))
