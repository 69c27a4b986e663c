from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from kg.model.areas import Rectangle
from kg.model.errors import LayoutError
from kg.model.records import MapUpdate, PlaceRecord
from mapping.places.layout import Layout, LayoutPlace
from mapping.places.place_registry import PlaceRegistry, extended, trimmed_extent

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
