"""The thesis author's saved maps: read into a map, and written back."""

import json
import math
from collections.abc import Callable
from pathlib import Path

import pytest

from kg.knowledge.ontology.lint import check_map
from kg.model.errors import InvalidFactError, UnknownCategoryError
from kg.serving.opening import create_map, in_memory_map, open_map
from lab.maps.saved_maps import SavedMap, export_saved_maps, import_saved_maps

Shared = Callable[[str], Path]


def read(path: Path) -> list[dict]:  # type: ignore[type-arg]
    return json.loads(path.read_text())


def test_the_lab_survives_save_and_reload(shared: Shared, tmp_path: Path) -> None:
    objects, places = (shared(f"reference/saved_{n}_lab.json") for n in ("objects", "places"))
    with create_map(tmp_path / "lab") as chart:
        assert import_saved_maps(chart, objects, places) == SavedMap(91, 11)
    with open_map(tmp_path / "lab", read_only=True) as chart:
        counts = {
            row["category"]: row["count"] for row in chart.query("summary", least=0).records()
        }
        assert (counts["chair"], counts["tv"], sum(counts.values())) == (31, 20, 91)
        assert all(record.place is not None for record in chart.objects())
        assert check_map(chart.engine) == []
        export_saved_maps(chart, tmp_path / "objects.json", tmp_path / "places.json")
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
    import_saved_maps(chart, places_json=places)
    upstairs = tmp_path / "upstairs.json"
    rooms = json.loads(places.read_text())
    upstairs.write_text(json.dumps([room | {"xmax": room["xmax"] + 1} for room in rooms]))
    import_saved_maps(chart, places_json=upstairs)
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
def test_a_bad_file_is_one_line_and_nothing_is_written(tmp_path, entries, error, reason):
    path = tmp_path / "objects.json"
    path.write_text(json.dumps(entries))
    chart = in_memory_map()
    with pytest.raises(error, match=reason) as caught:
        import_saved_maps(chart, path)
    assert "\n" not in str(caught.value)
    with pytest.raises(InvalidFactError, match="cannot read"):
        import_saved_maps(chart, tmp_path / "none.json")
    assert chart.objects() == ()
