"""The mapper of places, and their registry."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from kg.model.areas import Rectangle
from kg.model.errors import LayoutError
from kg.model.records import MapUpdate, PlaceRecord
from mapping.frames.projection import map_points
from mapping.places.layout import Layout, LayoutPlace
from mapping.places.place_mapper import PlaceMapper
from mapping.places.place_registry import PlaceRegistry, extended, trimmed_extent
from mapping.reference.belief_filters import main_owner
from mapping.reference.settings import ReferenceSettings
from perception.frames import SceneScores

WEST_EAST = Layout(
    (
        LayoutPlace(1, "west", Rectangle(-9, 3, -9, 9)),
        LayoutPlace(2, "east", Rectangle(3, 9, -9, 9)),
    )
)
KITCHEN = SceneScores({"kitchen": 0.8, "bar": 0.2})


def place_mapper(semantic_map, layout=WEST_EAST, **settings):
    chosen = ReferenceSettings(stride=1, **settings)
    return PlaceMapper(semantic_map, PlaceRegistry(semantic_map, layout), chosen)


def step(mapper, frame, scene):
    """The record of the place that `frame` shows, after it was viewed; () where it shows none."""
    iri = mapper.viewed_place(frame)
    return () if iri is None else (mapper.view(iri, frame, scene),)


def shifted(frame_pose, x=0.0, yaw=0.0):
    turned = np.eye(4)
    turned[:2, :2] = [[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]]
    T = turned @ frame_pose
    T[0, 3] += x
    return T


@given(st.lists(st.integers(-1, 3), min_size=1, max_size=40))
def test_main_owner_holds_three_quarters(owners):
    best = main_owner(np.array(owners, dtype=np.intp), 0.75)
    shares = {o: owners.count(o) / len(owners) for o in set(owners) if o >= 0}
    expected = [o for o, share in shares.items() if share >= 0.75]
    assert ([] if best is None else [best]) == expected


def test_view_of_one_place_counts_for_it(semantic_map, make_frame):
    (record,) = step(place_mapper(semantic_map), make_frame(2.0), KITCHEN)
    kitchen = semantic_map.catalogue.find("kitchen", kind="place").iri
    assert (record.label, record.views) == ("west", 1)
    assert record.beliefs[kitchen] == pytest.approx(0.8)


@pytest.mark.parametrize(("columns", "expected"), [(50, "west"), (15, "east"), (33, None)])
def test_view_counts_only_with_three_quarters_in_one_place(
    semantic_map, make_frame, columns, expected
):
    depth = np.full((49, 65), 5.0)
    depth[:, :columns] = 2.0  # west up to there
    iri = place_mapper(semantic_map).viewed_place(make_frame(depth))
    named = {semantic_map.place_iri(1): "west", semantic_map.place_iri(2): "east", None: None}
    assert named[iri] == expected


def test_mostly_unknown_view_does_not_count(semantic_map, make_frame):
    depth = np.full((49, 65), np.nan)
    depth[:, :16] = 2.0  # 24.6 % known
    assert place_mapper(semantic_map).viewed_place(make_frame(depth)) is None
    depth[:, :17] = 2.0  # 26.2 % known
    assert place_mapper(semantic_map).viewed_place(make_frame(depth)) is not None


def test_same_pose_counts_once_and_a_new_one_again(semantic_map, make_frame):
    mapper, pose = place_mapper(semantic_map), make_frame().T_map_cam
    assert step(mapper, make_frame(2.0), KITCHEN)
    assert not step(mapper, make_frame(2.0), KITCHEN)
    assert not step(mapper, make_frame(2.0, T=shifted(pose, x=0.14, yaw=math.radians(9))), KITCHEN)
    assert step(mapper, make_frame(2.0, T=shifted(pose, x=0.16)), KITCHEN)
    assert step(mapper, make_frame(2.0, T=shifted(pose, yaw=math.radians(11))), KITCHEN)


def test_faint_beliefs_count_but_stay_out_of_the_graph(semantic_map, make_frame):
    mapper, pose = place_mapper(semantic_map), make_frame().T_map_cam
    bar = semantic_map.catalogue.find("bar", kind="place").iri
    faint = SceneScores({"kitchen": 0.996, "bar": 0.004})
    (record,) = step(mapper, make_frame(2.0), faint)
    assert bar not in record.beliefs
    clear = SceneScores({"kitchen": 0.79, "bar": 0.21})
    (record,) = step(mapper, make_frame(2.0, T=shifted(pose, x=0.2)), clear)
    assert record.beliefs[bar] == pytest.approx(0.107)


def test_labels_nobody_knows_lose_their_share(semantic_map, make_frame):
    mapper = place_mapper(semantic_map)
    scores = SceneScores({"kitchen": 0.6, "holodeck": 0.4})
    (record,) = step(mapper, make_frame(2.0), scores)
    assert list(record.beliefs.values()) == pytest.approx([0.6])
    assert mapper.labels.unknown_labels == {"holodeck": 1}


def test_view_with_nothing_but_unknown_labels_is_no_view(semantic_map, make_frame):
    (record,) = step(place_mapper(semantic_map), make_frame(2.0), SceneScores({"holodeck": 1.0}))
    assert record.views == 0 and not record.beliefs


def test_mapper_goes_on_from_the_graph(semantic_map, make_frame):
    pose = make_frame().T_map_cam
    views = [make_frame(1.5, T=shifted(pose, x=0.2 * n)) for n in range(4)]
    scores = [SceneScores({"kitchen": 0.5 + 0.1 * n, "bar": 0.5 - 0.1 * n}) for n in range(4)]
    whole = place_mapper(semantic_map)
    for view, score in zip(views, scores, strict=True):
        (expected,) = step(whole, view, score)
    first = place_mapper(semantic_map)
    for view, score in zip(views[:2], scores[:2], strict=True):
        semantic_map.apply(MapUpdate(places=step(first, view, score)))
    second = place_mapper(semantic_map)
    for view, score in zip(views[2:], scores[2:], strict=True):
        (resumed,) = step(second, view, score)
    assert resumed.views == 4
    kitchen = semantic_map.catalogue.find("kitchen", kind="place").iri
    assert resumed.beliefs[kitchen] == pytest.approx(expected.beliefs[kitchen], abs=0.02)


def test_map_points_of_a_level_camera(make_frame):
    points = map_points(make_frame(2.0), stride=1)
    assert points.shape == (49 * 65, 3)
    assert np.allclose(points[:, 0], 2.0)
    assert points[:, 1].max() == pytest.approx(32 * 2 / 50)
    assert len(map_points(make_frame(2.0), stride=1, max_depth=1.9)) == 0


CLOUDS = npst.arrays(
    np.float64, st.tuples(st.integers(1, 60), st.just(3)), elements=st.floats(-20, 20)
)


def test_point_belongs_to_the_place_around_it_and_to_the_first_of_several(semantic_map):
    layout = Layout(
        (LayoutPlace(4, "a", Rectangle(0, 2, 0, 2)), LayoutPlace(9, "b", Rectangle(1, 3, 1, 3)))
    )
    book = PlaceRegistry(semantic_map, layout)
    points = np.array([[0.5, 0.5, 9.0], [1.5, 1.5, 0.0], [2.5, 2.5, 0.0], [5.0, 5.0, 0.0]])
    assert book.owners(points).tolist() == [0, 0, 1, -1]
    assert book.at(points[2]) == semantic_map.place_iri(9)
    assert book.at(points[3]) is None


def test_without_a_layout_one_place_grows_with_what_is_seen(semantic_map):
    book = PlaceRegistry(semantic_map, recording="flat")
    assert book.places() == ()
    book.observe(np.array([[0.1, 0.1, 0.0], [1.2, 0.7, 1.0]]))
    (place,) = book.places()
    assert (place.label, place.iri) == ("flat", semantic_map.place_iri(1))
    assert (place.xmin, place.xmax, place.ymin, place.ymax) == (0.0, 1.5, 0.0, 1.0)
    assert book.take_changed() == (place,)
    book.observe(np.array([[0.4, 0.4, 0.0]]))
    assert book.take_changed() == ()  # nothing to write: it holds that already


def test_a_few_stray_depths_do_not_stretch_the_place():
    points = np.full((1000, 3), 0.25)
    points[:10] = 80.0
    assert trimmed_extent(points) == Rectangle(0.0, 0.5, 0.0, 0.5)


@given(st.lists(CLOUDS, min_size=1, max_size=6))
def test_the_growing_place_only_grows(clouds):
    extent = None
    for cloud in clouds:
        after = extended(extent, cloud)
        if extent is not None:
            assert after.union(extent) == after
        assert min(after.size) > 0
        extent = after


def test_a_second_recording_gets_a_place_of_its_own(semantic_map):
    first = PlaceRegistry(semantic_map, recording="kitchen")
    first.observe(np.array([[0.0, 0.0, 0.0], [2.0, 2.0, 0.0]]))
    semantic_map.apply(MapUpdate(places=first.take_changed()))
    second = PlaceRegistry(semantic_map, recording="bedroom")
    second.observe(np.array([[8.0, 0.0, 0.0], [9.0, 2.0, 0.0]]))
    assert {p.label for p in second.places()} == {"kitchen", "bedroom"}
    assert second.at(np.array([1.0, 1.0, 0.0])) == semantic_map.place_iri(1)
    assert second.at(np.array([8.5, 1.0, 0.0])) == semantic_map.place_iri(2)


def test_the_same_recording_goes_on_with_its_place(semantic_map):
    first = PlaceRegistry(semantic_map, recording="kitchen")
    first.observe(np.array([[0.0, 0.0, 0.0], [2.0, 2.0, 0.0]]))
    semantic_map.apply(MapUpdate(places=first.take_changed()))
    again = PlaceRegistry(semantic_map, recording="kitchen")
    assert again.take_changed() == ()
    again.observe(np.array([[3.0, 0.0, 0.0]]))
    assert len(again.places()) == 1
    assert again.places()[0].xmin == 0.0 and again.places()[0].xmax == 3.5


def test_layout_keeps_what_the_map_believes_of_its_places(semantic_map):
    kitchen = semantic_map.catalogue.find("kitchen", kind="place").iri
    seen = PlaceRecord(semantic_map.place_iri(1), "old", 0, 1, 0, 1, 12, {kitchen: 0.8})
    semantic_map.apply(MapUpdate(places=(seen,)))
    book = PlaceRegistry(
        semantic_map, Layout((LayoutPlace(1, "new", Rectangle(0, 5, 0, 5), "bedroom"),))
    )
    (place,) = book.places()
    assert (place.label, place.xmax, place.views) == ("new", 5, 12)
    assert dict(place.beliefs) == {kitchen: 0.8}


def test_stated_category_counts_as_one_certain_view(semantic_map):
    book = PlaceRegistry(
        semantic_map, Layout((LayoutPlace(1, "lab", Rectangle(0, 5, 0, 5), "home_office"),))
    )
    (place,) = book.take_changed()
    office = semantic_map.catalogue.find("home office", kind="place").iri
    assert (place.views, dict(place.beliefs)) == (1, {office: 1.0})


def test_stated_category_nobody_knows_is_refused(semantic_map):
    with pytest.raises(LayoutError, match=r"kitchn.*did you mean kitchen"):
        PlaceRegistry(
            semantic_map, Layout((LayoutPlace(1, "lab", Rectangle(0, 5, 0, 5), "kitchn"),))
        )


def test_a_place_that_could_not_be_written_is_written_later(semantic_map):
    book = PlaceRegistry(semantic_map, recording="flat")
    book.observe(np.array([[0.1, 0.1, 0.0], [1.2, 0.7, 1.0]]))
    written = book.take_changed()
    unknown = PlaceRecord(semantic_map.place_iri(99), "gone", 0, 1, 0, 1)
    book.undo([*written, unknown])
    assert book.take_changed() == written != ()
