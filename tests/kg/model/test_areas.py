"""kg.model.areas: sides belong to it, points one by one and many at once, union."""

import numpy as np
import pytest
from shapely import LinearRing

from kg.model.areas import Area, Rectangle, area_of

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


L_SHAPE = [(0, 0), (6, 0), (6, 2), (2, 2), (2, 5), (0, 5)]


def test_a_polygon_holds_what_its_sides_enclose_but_not_its_holes():
    area = area_of([L_SHAPE, [(0.5, 0.5), (1.5, 0.5), (1.5, 1.5), (0.5, 1.5)]])
    x, y = np.array([1.0, 0.2, 5.0, 5.0, 1.0, 7.0]), np.array([1.0, 0.2, 1.0, 3.0, 4.0, 1.0])
    assert area.contains_each(x, y).tolist() == [False, True, True, False, True, False]
    assert area.area == pytest.approx(6 * 2 + 2 * 3 - 1)
    assert (area.xmin, area.xmax, area.ymin, area.ymax) == (0, 6, 0, 5)


def test_the_centre_of_a_polygon_is_inside():
    u_shape = [(0, 0), (9, 0), (9, 9), (8, 9), (8, 1), (1, 1), (1, 9), (0, 9)]
    area = area_of([u_shape])
    assert area.contains(*area.centre)


def test_four_corners_along_the_axes_are_a_rectangle():
    assert area_of([[(0, 0), (0, 3), (4, 3), (4, 0), (0, 0)]]) == Area(0, 4, 0, 3)


@pytest.mark.parametrize(
    ("rings", "says"),
    [
        ([], "has no ring"),
        ([[]], "encloses no area"),
        ([[(0, 0), (1, 1), (2, 2)]], "encloses no area"),
        ([[(0, 0), (4, 4), (4, 0), (0, 3)]], "crosses itself"),
        ([[(0, 0), (1e300, 0), (1e300, 1e300)]], "beyond 1e\\+06 m"),
        ([[(0, 0), (1, 0), (float("nan"), 1)]], "not finite"),
        ([[(k, k * k) for k in range(3000)]], "3000 corners"),
        ([L_SHAPE, [(1, 1), (1.5, 9), (1.5, 1)]], "crosses itself"),
        ([L_SHAPE, [(7, 7), (8, 7), (8, 8)]], "crosses itself"),
    ],
)
def test_what_encloses_no_area_is_refused(rings, says):
    with pytest.raises(ValueError, match=says):
        area_of(rings)


def test_rings_that_touch_in_a_point_are_an_outline():
    hourglass = area_of([[(0, 0), (4, 0), (2, 2), (4, 4), (0, 4), (2, 2)]])
    assert hourglass.area == pytest.approx(8)
    assert hourglass.contains(2, 1)
    assert not hourglass.contains(0.5, 2)


def test_shared_area_is_that_of_the_intersection():
    room, hole = Area(0, 4, 0, 4), [(1, 1), (2, 1), (2, 2), (1, 2)]
    assert area_of([[(2, 0), (6, 0), (6, 2), (2, 2)]]).shared_area(room) == pytest.approx(4)
    assert area_of([[(0, 0), (4, 0), (4, 4), (0, 4)], hole]).shared_area(room) == pytest.approx(15)
    assert Area(4, 5, 0, 4).shared_area(room) == 0


@pytest.mark.parametrize("outer", [1, -1])
@pytest.mark.parametrize("inner", [1, -1])
def test_outer_rings_turn_left_and_holes_right(outer: int, inner: int) -> None:
    square = ((0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0))
    hole = tuple((x / 4 + 1, y / 4 + 1) for x, y in square)
    area = Area(0.0, 4.0, 0.0, 4.0, outline=(square[::outer], hole[::inner]))
    around, within = (LinearRing(ring) for ring in area.oriented_rings)
    assert around.is_ccw and not within.is_ccw
