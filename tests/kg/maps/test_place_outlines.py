"""Places that are polygons: written, read, asked for, edited by SPARQL."""

from __future__ import annotations

import numpy as np
import pytest

from kg.export.serialization import export_map as export
from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.areas import area_of
from kg.model.errors import InvalidFactError, ShapeError
from kg.model.records import MapUpdate, PlaceRecord, RobotRecord
from kg.serving.opening import in_memory_map

BASE = "http://m/"
PLACE = f"{BASE}place/1"
L_SHAPE = area_of([[(0, 0), (6, 0), (6, 2), (2, 2), (2, 5.004), (0, 5.004)]])
ROUND = area_of([[(0, 0), (6, 0), (6, 2), (2, 2), (2, 5), (0, 5)]])


@pytest.fixture
def flat():
    with in_memory_map(base=BASE) as made:
        hall = PlaceRecord(PLACE, "hall", 0, 1, 0, 1).with_area(L_SHAPE)
        room = PlaceRecord(f"{BASE}place/2", "room", 2, 6, 2, 5)
        robot = RobotRecord(np.array([4.0, 4.0, 1.0]), 0.0, 1.0)
        made.apply(MapUpdate(places=(hall, room), robot=robot))
        yield made


def outline(semantic_map: SemanticMap) -> list[str]:
    table = semantic_map.query(
        f"SELECT ?o WHERE {{ GRAPH graph:map {{ <{PLACE}> here:outline ?o }} }}"
    )
    return [str(row[0]) for row in table.rows]


def test_an_outline_is_read_as_it_was_written_to_a_centimetre(flat):
    hall, room = flat.places()
    assert hall.area == ROUND
    assert room.outline == ()
    assert outline(flat) == [f"<{BASE}crs> POLYGON ((0 0, 6 0, 6 2, 2 2, 2 5, 0 5, 0 0))"]


def test_what_did_not_change_is_not_written(flat):
    assert flat.apply(MapUpdate(places=flat.places())) is None


def test_the_robot_is_in_the_place_whose_polygon_holds_it(flat):
    assert [row["place"] for row in flat.query("robot").records()] == ["room"]


def test_sparql_asks_for_what_lies_within_a_polygon(flat):
    rows = flat.query(
        """SELECT ?place WHERE { GRAPH graph:map { ?place here:outline ?o }
           FILTER(geof:sfWithin("POINT (1 4)"^^geo:wktLiteral, ?o)) }"""
    ).rows
    assert [row[0] for row in rows] == [PLACE]


def edit(semantic_map: SemanticMap, where: str, what: str) -> None:
    semantic_map.update(
        f"WITH graph:map DELETE {{ <{PLACE}> {where} ?o }} "
        f"INSERT {{ <{PLACE}> {what} }} WHERE {{ <{PLACE}> {where} ?o }}"
    )


def test_a_new_outline_brings_its_rectangle_and_centre(flat):
    edit(flat, "here:outline", 'here:outline "POLYGON ((1 1, 9 1, 5 4, 1 1))"^^geo:wktLiteral')
    hall = flat.places()[0]
    assert (hall.xmin, hall.xmax, hall.ymin, hall.ymax) == (1, 9, 1, 4)
    assert hall.outline == (((1, 1), (9, 1), (5, 4)),)


def test_a_new_rectangle_replaces_the_outline(flat):
    edit(flat, "here:xMax", "here:xMax 7.0")
    assert outline(flat) == []
    assert flat.places()[0].area.contains(6.9, 4.9)


@pytest.mark.parametrize(
    "text", ["POINT (1 2)", "POLYGON ((0 0, 1 1))", "POLYGON ((a b, c d, e f, a b))", "x" * 200_000]
)
def test_what_is_no_polygon_is_no_outline(flat, text):
    with pytest.raises(ShapeError, match="POLYGON"):
        edit(flat, "here:outline", f'here:outline "{text}"^^geo:wktLiteral')


def test_a_record_whose_outline_crosses_itself_is_refused(flat):
    ring = ((0.0, 0.0), (4.0, 4.0), (4.0, 0.0), (0.0, 3.0))
    bad = PlaceRecord(PLACE, "hall", 0, 4, 0, 4, outline=(ring,))
    with pytest.raises(InvalidFactError, match="crosses itself"):
        flat.apply(MapUpdate(places=(bad,)))


def test_an_export_has_the_polygon_as_geometry(flat, tmp_path):
    path = tmp_path / "flat.nq"
    export(flat, path)
    lines = [line for line in path.read_text().splitlines() if f"<{PLACE}/geometry>" in line]
    assert any("6 2, 2 2" in line and v.GEO_AS_WKT in line for line in lines)
