"""kg.records.Rectangle: sides belong to it, points one by one and many at once, union."""

from __future__ import annotations

import numpy as np
import pytest

from kg.records import PlaceRecord, Rectangle

ROOM = Rectangle(0.0, 4.0, -1.5, 2.0)


@pytest.mark.parametrize(
    ("x", "y", "inside"),
    [(2, 0, True), (0, -1.5, True), (4, 2, True), (4.001, 0, False), (2, np.nan, False)],
)
def test_a_point_is_tested_alike_alone_and_among_many(x, y, inside):
    assert ROOM.contains(x, y) == inside
    assert ROOM.contains_each(np.array([x]), np.array([y])).tolist() == [inside]


def test_sizes_are_those_of_the_sides():
    assert (ROOM.size, ROOM.area, ROOM.centre) == ((4.0, 3.5), 14.0, (2.0, 0.25))


def test_a_union_contains_both():
    assert ROOM.union(Rectangle(3, 5, -3, 0)) == Rectangle(0, 5, -3, 2)


def test_a_place_has_the_rectangle_of_its_sides():
    place = PlaceRecord("http://example.org/m/place/1", "place 1", 0.0, 4.0, -1.5, 2.0)
    assert place.rectangle == ROOM
