"""The mapper of objects, its changes, and learnt categories."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyoxigraph import Literal, NamedNode, Quad

from kg.model import vocabulary as v
from kg.model.areas import Rectangle
from kg.model.records import DepartedRecord, MapUpdate, ObjectRecord
from kg.serving.opening import in_memory_map
from mapping.objects.object_mapper import ObjectChanges, ReferenceObjectMapper
from mapping.places.layout import Layout, LayoutPlace
from mapping.places.place_mapper import PlaceMapper
from mapping.places.place_registry import PlaceRegistry
from mapping.reference.settings import ReferenceSettings
from perception.frames import Detections, Frame, SceneScores

MIDDLE = (30, 22, 34, 26)  # about the optical axis: map (depth, 0, 1)
SETTINGS = ReferenceSettings()


def only(mapper):
    (record,) = mapper.objects()
    return record


def test_new_object_is_registered_where_it_was_seen(semantic_map, make_frame, make_detections):
    mapper = ReferenceObjectMapper(semantic_map, SETTINGS, recording="room", model="net")
    mapper.add(make_frame(2.0), make_detections(("cup", 0.5, MIDDLE)))
    record = only(mapper)
    assert semantic_map.catalogue.label(record.category) == "cup"
    assert record.p_map == pytest.approx([2.0, 0.0, 1.0])
    assert record.confidence == pytest.approx(0.4)  # phi 0.8 x score 0.5
    assert record.existence == pytest.approx(0.4 / 3)
    assert record.evidence.box == MIDDLE
    assert (record.evidence.recording, record.evidence.model) == ("room", "net")


def test_seen_again_moves_to_the_mean_and_grows_surer(semantic_map, make_frame, make_detections):
    mapper = ReferenceObjectMapper(semantic_map, SETTINGS)
    mapper.add(make_frame(2.0, stamp=10.0), make_detections(("cup", 0.5, MIDDLE)))
    mapper.add(make_frame(2.4, stamp=11.0), make_detections(("cup", 0.75, MIDDLE)))
    mapper.add(make_frame(2.2, stamp=12.0), make_detections(("cup", 0.25, MIDDLE)))
    record = only(mapper)
    assert record.p_map == pytest.approx([2.2, 0.0, 1.0], abs=1e-6)
    assert record.confidence == pytest.approx(0.8 * (0.5 + 0.75 + 0.25))
    assert (record.observations, record.first_seen, record.last_seen) == (3, 10.0, 12.0)
    assert record.evidence.score == 0.75  # the surest look explains it, not the last


def test_object_that_is_gone_fades_and_leaves(semantic_map, make_frame, make_detections):
    mapper = ReferenceObjectMapper(semantic_map, SETTINGS)
    mapper.add(make_frame(2.0), make_detections(("cup", 1.0, MIDDLE)))  # C = 0.8
    mapper.add(make_frame(3.0), make_detections())
    assert only(mapper).confidence == pytest.approx(0.35)
    iri = only(mapper).iri
    second = mapper.add(make_frame(3.0), make_detections())
    assert second.removed == (iri,)
    assert mapper.objects() == ()
    assert iri not in {record.iri for record in second.updated}


@pytest.mark.parametrize("depth", [0.6, 5.5])
def test_out_of_the_sensors_good_range_nothing_is_registered(
    semantic_map, make_frame, make_detections, depth
):
    mapper = ReferenceObjectMapper(semantic_map, SETTINGS)
    mapper.add(make_frame(depth), make_detections(("cup", 0.9, MIDDLE)))
    assert mapper.objects() == ()


def test_out_of_the_good_range_a_registered_object_still_grows_surer(
    semantic_map, make_frame, make_detections
):
    mapper = ReferenceObjectMapper(semantic_map, SETTINGS)
    mapper.add(make_frame(4.5), make_detections(("cup", 0.5, MIDDLE)))
    mapper.add(make_frame(4.9), make_detections(("cup", 0.5, MIDDLE)))
    assert only(mapper).confidence == pytest.approx(0.8)


def test_one_chair_detected_twice_is_one_chair(semantic_map, make_frame, make_detections):
    mapper = ReferenceObjectMapper(semantic_map, SETTINGS)
    twice = make_detections(("chair", 0.9, MIDDLE), ("chair", 0.6, (33, 22, 37, 26)))
    mapper.add(make_frame(2.0), twice)
    assert only(mapper).confidence == pytest.approx(0.72)
    mapper.add(make_frame(2.0), twice)
    assert only(mapper).observations == 2


def test_unknown_labels_and_boxes_without_depth_are_counted_not_mapped(
    semantic_map, make_frame, make_detections
):
    mapper = ReferenceObjectMapper(semantic_map, SETTINGS)
    mapper.add(make_frame(2.0), make_detections(("flux capacitor", 0.9, MIDDLE)))
    mapper.add(make_frame(np.nan), make_detections(("cup", 0.9, MIDDLE)))
    assert mapper.objects() == ()
    assert mapper.labels.unknown_labels == {"flux capacitor": 1}
    assert mapper.unplaced == 1


looks = st.lists(
    st.tuples(
        st.floats(0.5, 6.0),
        st.lists(
            st.tuples(
                st.sampled_from(["cup", "chair"]),
                st.floats(0.05, 1.0),
                st.integers(0, 55),
                st.integers(0, 40),
            ),
            max_size=4,
        ),
    ),
    max_size=8,
)


@settings(max_examples=15)
@given(looks)
def test_whatever_is_seen_the_map_stays_sane(looks):
    T = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 1], [0, 0, 0, 1]], dtype=float)
    K = np.array([[50.0, 0, 32], [0, 50.0, 24], [0, 0, 1]])
    with in_memory_map() as semantic_map:
        mapper = ReferenceObjectMapper(semantic_map, SETTINGS)
        for n, (depth, found) in enumerate(looks):
            image = np.full((49, 65), depth, dtype=np.float32)
            frame = Frame(str(n), np.zeros((49, 65, 3), np.uint8), image, K, T, 100.0 + n)
            boxes = np.array([(x, y, x + 8, y + 8) for _, _, x, y in found], dtype=np.float32)
            scores = np.array([s for _, s, _, _ in found], dtype=np.float32)
            labels = tuple(label for label, _, _, _ in found)
            changes = mapper.add(frame, Detections(boxes.reshape(-1, 4), scores, labels))
            semantic_map.apply(MapUpdate(objects=changes.updated, removed=changes.removed))
            for record in mapper.objects():
                assert 0 < record.confidence <= 3.0
                assert 0 < record.existence <= 1.0
                assert np.all(np.isfinite(record.p_map))
        assert {o.iri for o in semantic_map.objects()} == {o.iri for o in mapper.objects()}


def test_detection_too_far_to_register_does_not_suppress_one_that_is_near_enough(
    semantic_map, make_frame, make_detections
):
    depth = np.full((49, 65), 4.5)
    depth[:, 33:] = 4.7
    seen = make_detections(("cup", 0.5, (28, 22, 32, 26)), ("cup", 0.9, (33, 22, 37, 26)))
    mapper = ReferenceObjectMapper(semantic_map, SETTINGS)
    mapper.add(make_frame(depth), seen)
    assert only(mapper).confidence == pytest.approx(0.4)
    assert only(mapper).p_map[0] == pytest.approx(4.5)


def _record(iri: str, existence: float) -> ObjectRecord:
    return ObjectRecord(
        iri=iri,
        category="cup",
        p_map=np.zeros(3),
        confidence=3 * existence,
        existence=existence,
        observations=1,
        first_seen=0.0,
        last_seen=0.0,
    )


def _departed(iri: str) -> DepartedRecord:
    return DepartedRecord(iri, "cup", np.zeros(3), 0.9, 1, 0.0, 0.0, 1.0)


def test_of_each_object_the_end_counts() -> None:
    first = ObjectChanges(
        (_record("a", 0.5), _record("b", 0.5)), ("c", "d"), departed=(_departed("c"),)
    )
    then = ObjectChanges((_record("a", 0.7), _record("c", 0.6)), ("b",), departed=(_departed("b"),))
    both = first.followed_by(then)
    assert {record.iri: record.existence for record in both.updated} == {"a": 0.7, "c": 0.6}
    assert both.removed == ("b", "d")
    assert [record.iri for record in both.departed] == ["b"]


LEARNT_SETTINGS = ReferenceSettings(stride=1)
LEARNT_MIDDLE = (30.0, 22.0, 34.0, 26.0)


def learn(semantic_map, name, above, label):
    said = {
        v.RDF_TYPE.value: NamedNode(v.OWL_CLASS),
        v.RDFS_SUB_CLASS_OF: NamedNode(above),
        v.RDFS_LABEL: Literal(label),
    }
    learnt = [Quad(NamedNode(v.HERE + name), NamedNode(p), o) for p, o in said.items()]
    semantic_map.ontology.replace([*semantic_map.ontology.quads(), *learnt])


def test_an_object_category_learnt_meanwhile_is_mapped_from_the_next_frame_on(
    semantic_map, make_frame, make_detections
):
    mapper = ReferenceObjectMapper(semantic_map, LEARNT_SETTINGS)
    seen = make_detections(("flux capacitor", 0.9, LEARNT_MIDDLE))
    mapper.add(make_frame(2.0), seen)
    assert mapper.objects() == ()
    learn(semantic_map, "Flux", v.OBJECT, "flux capacitor")
    mapper.add(make_frame(2.0), seen)
    (record,) = mapper.objects()
    assert record.category == v.HERE + "Flux"


def test_a_place_category_learnt_meanwhile_is_believed_from_the_next_view_on(
    semantic_map, make_frame
):
    layout = Layout((LayoutPlace(1, "west", Rectangle(-9, 9, -9, 9)),))
    mapper = PlaceMapper(semantic_map, PlaceRegistry(semantic_map, layout), LEARNT_SETTINGS)
    scores = SceneScores({"kitchen": 0.2, "holodeck": 0.8})
    iri = mapper.viewed_place(make_frame(2.0))
    assert set(mapper.view(iri, make_frame(2.0), scores).beliefs) <= {v.HERE + "Kitchen"}
    learn(semantic_map, "Holodeck", v.PLACE, "holodeck")
    assert v.HERE + "Holodeck" in mapper.view(iri, make_frame(2.0), scores).beliefs
