"""Plain documents: GeoJSON, CSV, and the JSON of the thesis."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from kg.export.plain_documents import geojson_document, rooms_document
from kg.export.thesis_json import ThesisMap, export_reference_maps, import_reference_maps
from kg.knowledge.ontology.lint import check_map
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import InvalidFactError, UnknownCategoryError
from kg.model.records import MapUpdate, PlaceRecord
from kg.serving.opening import create_map, in_memory_map, open_map
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


Shared = Callable[[str], Path]


def read(path: Path) -> list[dict]:  # type: ignore[type-arg]
    return json.loads(path.read_text())


def test_the_lab_survives_save_and_reload(shared: Shared, tmp_path: Path) -> None:
    objects, places = (shared(f"reference/saved_{n}_lab.json") for n in ("objects", "places"))
    with create_map(tmp_path / "lab") as chart:
        assert import_reference_maps(chart, objects, places) == ThesisMap(91, 11)
    with open_map(tmp_path / "lab", read_only=True) as chart:
        counts = {
            row["category"]: row["count"] for row in chart.query("summary", least=0).records()
        }
        assert (counts["chair"], counts["tv"], sum(counts.values())) == (31, 20, 91)
        assert all(record.place is not None for record in chart.objects())
        assert check_map(chart.engine) == []
        export_reference_maps(chart, tmp_path / "objects.json", tmp_path / "places.json")
    saved, back = read(objects), read(tmp_path / "objects.json")
    assert len(back) == 91
    for old, new in zip(saved, back, strict=True):
        assert [new[k] for k in ("id", "label", "ndetections")] == [
            old[k] for k in ("id", "label", "ndetections")
        ]
        assert new["confidence"] == pytest.approx(old["confidence"], abs=0.01)
        assert new["pos"] == pytest.approx(old["pos"], abs=0.00501)
    rooms, again = read(places), read(tmp_path / "places.json")
    assert len(again) == 11
    for old, new in zip(rooms, again, strict=True):
        assert new["counter"] == min(old["counter"], 50)
        assert new["checked"] == old["checked"]
        edges = ("xmin", "xmax", "ymin", "ymax")
        assert [new[k] for k in edges] == pytest.approx([old[k] for k in edges], abs=0.00501)
        held = zip(old["labels"], old["beliefs"], old["scene_id"], strict=True)
        kept = {label: (belief, number) for label, belief, number in held if belief >= 0.005}
        assert dict(zip(new["labels"], new["beliefs"], strict=True)) == pytest.approx(
            {label: belief for label, (belief, _) in kept.items()}, abs=0.00501
        )
        assert dict(zip(new["labels"], new["scene_id"], strict=True)) == {
            label: number for label, (_, number) in kept.items()
        }


def test_imported_places_do_not_overwrite_those_of_the_map(shared: Shared, tmp_path: Path) -> None:
    places = shared("reference/saved_places_lab.json")
    chart = in_memory_map()
    import_reference_maps(chart, places_json=places)
    upstairs = tmp_path / "upstairs.json"
    rooms = json.loads(places.read_text())
    upstairs.write_text(json.dumps([room | {"xmax": room["xmax"] + 1} for room in rooms]))
    import_reference_maps(chart, places_json=upstairs)
    assert [place.iri for place in chart.places()] == [chart.place_iri(n) for n in range(1, 23)]


CHAIR = {"label": "chair", "confidence": 1, "ndetections": 2, "pos": {"x": 0, "y": 0, "z": 0}}


@pytest.mark.parametrize(
    ("entries", "error", "reason"),
    [
        ([CHAIR, {**CHAIR, "label": "chiar"}], UnknownCategoryError, "did you mean chair"),
        ([CHAIR, {**CHAIR, "label": "kitchen"}], UnknownCategoryError, "kitchen"),
        ([CHAIR, {**CHAIR, "pos": {"x": 0, "y": 0}}], InvalidFactError, "z must be a number"),
        ([CHAIR, {**CHAIR, "confidence": "high"}], InvalidFactError, "confidence"),
        ([CHAIR, {**CHAIR, "ndetections": None}], InvalidFactError, "ndetections"),
        ([CHAIR, {**CHAIR, "pos": dict.fromkeys("xyz", math.nan)}], InvalidFactError, "finite"),
        ({"objects": []}, InvalidFactError, "must be a list"),
    ],
)
def test_a_bad_file_is_one_line_and_nothing_is_written(
    tmp_path: Path, entries: object, error: type[Exception], reason: str
) -> None:
    path = tmp_path / "objects.json"
    path.write_text(json.dumps(entries))
    chart = in_memory_map()
    with pytest.raises(error, match=reason) as caught:
        import_reference_maps(chart, path)
    assert "\n" not in str(caught.value)
    with pytest.raises(InvalidFactError, match="cannot read"):
        import_reference_maps(chart, tmp_path / "none.json")
    assert chart.objects() == ()
