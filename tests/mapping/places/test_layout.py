import json

import pytest

from kg.model.errors import LayoutError
from mapping.places.layout import load_layout

ROOM = {"xmin": 0, "xmax": 4, "ymin": -1.5, "ymax": 2}


def write(tmp_path, content, name="places.json"):
    path = tmp_path / name
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_bare_rectangles_are_numbered_from_one(tmp_path):
    layout = load_layout(write(tmp_path, [ROOM, ROOM]))
    assert [r.number for r in layout.places] == [1, 2]
    assert [r.label for r in layout.places] == ["place 1", "place 2"]
    assert layout.places[0].area.ymin == -1.5


def test_id_name_and_category_are_read(tmp_path):
    (place,) = load_layout(
        write(tmp_path, [ROOM | {"id": 7, "name": "Lab", "category": "office"}])
    ).places
    assert (place.number, place.label, place.category) == (7, "Lab", "office")


def test_the_robots_own_saved_places_are_a_layout(shared):
    layout = load_layout(shared("reference/saved_places_lab.json"))
    assert len(layout.places) == 11
    assert layout.places[0].area.xmin == pytest.approx(12.3445)


def test_the_thesis_building_is_a_layout(shared):
    layout = load_layout(shared("reference/search_world_places.csv"))
    assert [r.number for r in layout.places] == list(range(10))
    assert layout.places[1].category == "kitchen"
    assert layout.places[0].area.xmax == pytest.approx(30.708)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ([ROOM | {"xmax": -1}], "xmin below xmax"),
        ([ROOM | {"ymax": -1.5}], "ymin below ymax"),
        ([ROOM | {"xmin": "left"}], "'left'"),
        ([ROOM | {"xmin": None}], "None"),
        ('[{"xmin": NaN, "xmax": 1, "ymin": 0, "ymax": 1}]', "not finite"),
        ('[{"xmin": 0, "xmax": Infinity, "ymin": 0, "ymax": 1}]', "not finite"),
        ('[{"xmin": 0, "xmax": 1e300, "ymin": 0, "ymax": 1}]', "beyond 1e+06 m"),
        ([{"xmin": 0, "xmax": 1, "ymin": 0}], "no ymax"),
        ([ROOM | {"id": 1}, ROOM | {"id": 1}], "share the id 1"),
        ([ROOM | {"id": "front"}], "'front'"),
        ([ROOM | {"id": 1.5}], "1.5"),
        ([], "without places"),
        ({"places": [ROOM]}, "no list of places"),
        ([1, 2], "no list of places"),
        ("not json", "cannot read"),
        ("", "cannot read"),
    ],
)
def test_senseless_layouts_are_refused_in_one_line(tmp_path, content, says):
    with pytest.raises(LayoutError) as raised:
        load_layout(write(tmp_path, content))
    message = str(raised.value)
    assert says in message and "places.json" in message
    assert "\n" not in message


def test_absent_and_binary_files_are_refused(tmp_path):
    with pytest.raises(LayoutError, match="cannot read"):
        load_layout(tmp_path / "nowhere.json")
    binary = tmp_path / "places.csv"
    binary.write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(LayoutError, match="cannot read"):
        load_layout(binary)


RING = [[0, 0], [6, 0], [6, 2], [2, 2], [2, 5], [0, 5], [0, 0]]


def feature(rings, **properties):
    shape = {"type": "Polygon", "coordinates": rings}
    return {"type": "Feature", "properties": properties, "geometry": shape}


def collection(*features, **more):
    return {"type": "FeatureCollection", "features": list(features), **more}


def test_geojson_polygons_are_places(tmp_path):
    path = write(
        tmp_path,
        collection(
            feature([RING], name="flat", category="kitchen", id=7),
            feature([[[9, 0, 1.5], [12, 0], [12, 3], [9, 3]]]),
        ),
        "rooms.geojson",
    )
    flat, other = load_layout(path).places
    assert (flat.number, flat.label, flat.category) == (7, "flat", "kitchen")
    assert flat.area.contains(1, 4)
    assert not flat.area.contains(4, 4)
    assert (other.number, other.label) == (2, "place 2")
    assert (other.area.xmin, other.area.xmax) == (9, 12)


def degrees(ring):
    return [[10 + x * 1e-5, 48 + y * 1e-5] for x, y in ring]


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (collection(feature([degrees(RING)])), "as if in degrees; x and y in metres"),
        (collection(feature([RING]), crs={"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}), "by its crs"),
        (collection(), "without places"),
        ({"type": "FeatureCollection"}, "a FeatureCollection of polygons"),
        ({"type": "Point", "coordinates": [0, 0]}, "'Point'"),
        (collection({"type": "Feature", "geometry": None}), "feature without a shape"),
        (collection(feature([[[0, 0], [4, 4], [4, 0], [0, 3]]])), "crosses itself"),
        (collection(feature([[[0, 0], ["a", 1], [2, 0]]])), "no rings of"),
        (collection(feature([[[0, 0], [1, 0], [2, 0]]])), "encloses no area"),
        (collection(feature("x" * 9)), "no rings of"),
        (collection(feature([RING], id="a")), "'a'"),
        (collection(7), "feature 1 is no Feature"),
    ],
)
def test_geojson_that_is_no_plan_in_metres_is_refused_in_one_line(tmp_path, content, says):
    with pytest.raises(LayoutError) as failure:
        load_layout(write(tmp_path, content, "rooms.geojson"))
    assert says in str(failure.value)
    assert "rooms.geojson" in str(failure.value)
    assert "\n" not in str(failure.value)
