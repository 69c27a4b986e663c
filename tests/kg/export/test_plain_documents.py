"""Plain documents: GeoJSON, CSV."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from kg.export.plain_documents import geojson_document, rooms_document
from kg.maps.semantic_map import SemanticMap
from kg.model.records import MapUpdate, PlaceRecord
from kg.serving.opening import in_memory_map
from mapping.places.layout import load_layout
from tests.kg.conftest import thing


@pytest.fixture
def home() -> SemanticMap:
    """A kitchen with a hole and a cup in it, a corridor, and a chair in neither."""
    semantic_map = in_memory_map(title="home")
    place = semantic_map.place_iri(3)
    box = {"extent": np.array([0.1, 0.1, 0.2]), "yaw": 0.79, "p_map": np.array([0.5, 0.25, 1.0])}
    for label, where, existence in (("cup", place, 0.9), ("chair", None, 0.8), ("tv", None, 0.1)):
        record = thing(semantic_map, label, place=where, existence=existence, **box)
        semantic_map.apply(MapUpdate(objects=(record,)))
    hole = (((0, 0), (0, 4), (4, 4), (4, 0)), ((2, 2), (3, 2), (3, 3), (2, 3)))
    kitchen = semantic_map.catalogue.find("kitchen", "place").iri
    semantic_map.apply(
        MapUpdate(
            places=(
                PlaceRecord(place, 'Ann\'s "Küche"', 0, 4, 0, 4, 5, {kitchen: 0.8}, outline=hole),
                PlaceRecord(semantic_map.place_iri(7), "corridor", 4, 7, 0, 3),
            )
        )
    )
    return semantic_map


def test_rooms_hold_their_objects(home: SemanticMap) -> None:
    document = json.loads(json.dumps(rooms_document(home), allow_nan=False))
    kitchen, corridor = document["rooms"]
    assert (kitchen["name"], kitchen["likely_category"]) == ("place/3", "kitchen")
    assert [(o["category"], o["position"]) for o in kitchen["objects"]] == [("cup", [0.5, 0.25, 1])]
    assert kitchen["objects"][0]["size"] == [0.1, 0.1, 0.2]
    assert kitchen["objects"][0]["yaw"] == 0.79
    assert (corridor["likely_category"], corridor["objects"]) == (None, [])
    assert [o["category"] for o in document["elsewhere"]] == ["chair"]
    assert [o["category"] for o in rooms_document(home, 0)["elsewhere"]] == ["chair", "tv"]


def test_geojson_is_read_as_places_again(home: SemanticMap, tmp_path: Path) -> None:
    path = tmp_path / "home.geojson"
    path.write_text(json.dumps(geojson_document(home), allow_nan=False), encoding="utf-8")
    layout = load_layout(path)
    assert [(p.number, p.label, p.category) for p in layout.places] == [
        (3, 'Ann\'s "Küche"', None),  # what is believed is no assertion
        (7, "corridor", None),
    ]
    for place, record in zip(layout.places, home.places(), strict=True):
        assert place.area.area == pytest.approx(record.area.area)


def test_geojson_names_its_metres_and_turns_rings_as_the_rfc_has_it(home: SemanticMap) -> None:
    document = geojson_document(home)
    assert document["crs"]["properties"]["name"] == home.base + "crs"
    kinds = [f["properties"]["kind"] for f in document["features"]]
    assert kinds == ["place", "place", "object", "object"]
    corners = np.array(document["features"][2]["properties"]["footprint"])
    np.testing.assert_allclose(np.ptp(corners, axis=0), 0.1 * math.sqrt(2), atol=0.002)
    outer, hole = document["features"][0]["geometry"]["coordinates"]
    assert outer[0] == outer[-1] and hole[0] == hole[-1]

    def turn(ring: list[list[float]]) -> float:
        x, y = np.array(ring).T
        return float((x[:-1] * y[1:] - x[1:] * y[:-1]).sum())

    assert turn(outer) > 0 > turn(hole)
    assert document["features"][2]["geometry"] == {"type": "Point", "coordinates": [0.5, 0.25, 1.0]}


def test_an_empty_map_is_an_empty_document() -> None:
    empty = in_memory_map()
    assert rooms_document(empty)["rooms"] == []
    assert geojson_document(empty)["features"] == []
