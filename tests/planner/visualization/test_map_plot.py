from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kg.errors import PictureError
from kg.export.thesis_json import import_reference_maps
from kg.maps.semantic_map import SemanticMap
from kg.opening import in_memory_map
from kg.records import MapUpdate, ObjectRecord, PlaceRecord, RobotRecord
from planner.goals.search_goals import Goal
from planner.simulation.houses.house import furnished_house
from planner.simulation.houses.house_truth import ground_truth
from planner.visualization.label_placement import place_labels
from planner.visualization.layout import Extent, Sheet
from planner.visualization.map_plot import plot_map
from planner.visualization.palette import object_groups
from planner.visualization.place_names import fit_name
from planner.visualization.plan_plot import numbered_stops


def record(
    semantic_map: SemanticMap, label: str, x: float, y: float, existence: float = 1.0
) -> ObjectRecord:
    return ObjectRecord(
        iri=semantic_map.new_object_iri(),
        category=semantic_map.catalogue.find(label, "object").iri,
        p_map=np.array([x, y, 0.5]),
        confidence=2.0,
        existence=existence,
        observations=4,
        first_seen=0.0,
        last_seen=10.0,
    )


@pytest.fixture
def kitchen() -> SemanticMap:
    """A map of one viewed and one unviewed place, three objects and the robot."""
    semantic_map = in_memory_map(title="our kitchen")
    category = semantic_map.catalogue.find("kitchen", "place").iri
    semantic_map.apply(
        MapUpdate(
            objects=(
                record(semantic_map, "banana", 1, 1),
                record(semantic_map, "oven", 3, 2),
                record(semantic_map, "chair", 2, 2.5, existence=0.6),
            ),
            places=(
                PlaceRecord(semantic_map.place_iri(1), "place 1", 0, 4, 0, 3, 5, {category: 0.81}),
                PlaceRecord(semantic_map.place_iri(2), "place 2", 4, 7, 0, 3),
            ),
            robot=RobotRecord(np.array([2.0, 1.5, 1.2]), 0.5, 10.0),
        )
    )
    return semantic_map


def texts_of(svg: Path) -> list[str]:
    """Everything written in a drawing; matplotlib notes each text beside its outline."""
    lines = (line.strip() for line in svg.read_text().splitlines())
    return [line[5:-4] for line in lines if line.startswith("<!-- ") and line.endswith(" -->")]


def size_of(png: Path) -> tuple[int, int]:
    data = png.read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    width, height = struct.unpack(">II", data[16:24])
    return width, height


def test_a_picture_names_places_and_objects(kitchen: SemanticMap, tmp_path: Path) -> None:
    written = texts_of(plot_map(kitchen, tmp_path / "map.svg"))
    for text in ("our kitchen", "kitchen", "place 1, belief 0.81", "place 2", "not viewed yet"):
        assert text in written
    for text in ("banana", "oven", "chair", "food", "electronics", "other", "robot"):
        assert text in written
    assert "3 objects   ·   2 places, 1 not viewed yet" in written
    assert any(text.endswith(" m") for text in written)


def test_improbable_objects_are_drawn_on_request(kitchen: SemanticMap, tmp_path: Path) -> None:
    kitchen.apply(MapUpdate(objects=(record(kitchen, "vase", 1, 2, existence=0.4),)))
    assert "vase" not in texts_of(plot_map(kitchen, tmp_path / "some.svg"))
    assert "vase" in texts_of(plot_map(kitchen, tmp_path / "all.svg", least=0.0))


def test_the_ending_decides_the_format(kitchen: SemanticMap, tmp_path: Path) -> None:
    width, height = size_of(plot_map(kitchen, tmp_path / "map.PNG"))
    assert width > 1500 and height > 800
    assert plot_map(kitchen, tmp_path / "map.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize(("name", "said"), [("map.bmp", "the ending .bmp"), ("map", "no ending")])
def test_another_ending_is_refused_in_one_line(
    kitchen: SemanticMap, tmp_path: Path, name: str, said: str
) -> None:
    with pytest.raises(PictureError, match=f"{said}; .png, .svg or .pdf would work") as error:
        plot_map(kitchen, tmp_path / name)
    assert "\n" not in str(error.value)
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_not_there_is_said_in_one_line(
    kitchen: SemanticMap, tmp_path: Path
) -> None:
    with pytest.raises(PictureError, match=r"cannot write .*No such file"):
        plot_map(kitchen, tmp_path / "nowhere" / "map.png")


def test_the_same_map_gives_the_same_drawing(kitchen: SemanticMap, tmp_path: Path) -> None:
    first = plot_map(kitchen, tmp_path / "a.svg").read_bytes()
    assert first == plot_map(kitchen, tmp_path / "b.svg").read_bytes()


def test_goals_are_numbered_and_the_route_is_drawn(kitchen: SemanticMap, tmp_path: Path) -> None:
    goals = [
        Goal(f"urn:g{k}", "place", "kitchen", np.array([x, 1.0]), 0.5, "because")
        for k, x in enumerate((1.5, 5.0))
    ]
    path = plot_map(kitchen, tmp_path / "a.svg", goals=goals, route=[[2, 1.5], [1.5, 1], [5, 1]])
    written = texts_of(path)
    assert "1" in written and "2" in written and "route" in written
    assert "3 objects   ·   2 places, 1 not viewed yet   ·   2 goals" in written
    assert "route" not in texts_of(plot_map(kitchen, tmp_path / "b.svg", title="plain"))


def test_what_was_found_gets_a_star(kitchen: SemanticMap, tmp_path: Path) -> None:
    path = plot_map(kitchen, tmp_path / "a.svg", finds=[(2.0, 1.0, 0.9)])
    assert "found" in texts_of(path)
    assert "found" not in texts_of(plot_map(kitchen, tmp_path / "b.svg"))


def test_looks_from_one_spot_share_a_disc() -> None:
    spots = [np.array(xy) for xy in ((1.0, 1.0), (1.1, 1.0), (4.0, 2.0), (1.0, 1.1))]
    stops, numbers = numbered_stops(spots)
    assert [tuple(stop.p_map) for stop in stops] == [(1.0, 1.0), (4.0, 2.0)]
    assert numbers == ["1, ...", "3"]


def test_a_house_adds_its_walls_and_widens_the_picture(
    kitchen: SemanticMap, tmp_path: Path
) -> None:
    path = plot_map(kitchen, tmp_path / "a.svg", truth=ground_truth(furnished_house()))
    assert "truth" in texts_of(path)
    bare = plot_map(kitchen, tmp_path / "b.svg")
    assert path.read_text().count("<path") > bare.read_text().count("<path") + 80
    tall = size_of(plot_map(kitchen, tmp_path / "c.png", truth=ground_truth(furnished_house())))
    flat = size_of(plot_map(kitchen, tmp_path / "d.png"))
    assert tall[1] > 1.4 * flat[1]


def test_a_map_without_anything_is_still_a_picture(tmp_path: Path) -> None:
    path = plot_map(in_memory_map(title="nothing yet"), tmp_path / "map.svg")
    written = texts_of(path)
    assert "nothing yet" in written and "0 objects   ·   0 places" in written


def test_a_lone_object_without_any_place_is_drawn(tmp_path: Path) -> None:
    semantic_map = in_memory_map()
    semantic_map.apply(MapUpdate(objects=(record(semantic_map, "cup", 40, -7),)))
    assert "cup" in texts_of(plot_map(semantic_map, tmp_path / "map.svg"))


def test_the_laboratory_of_the_thesis_is_labelled(
    shared: Callable[[str], Path], tmp_path: Path
) -> None:
    semantic_map = in_memory_map(title="laboratory")
    folder = shared("reference")
    import_reference_maps(
        semantic_map, folder / "saved_objects_lab.json", folder / "saved_places_lab.json"
    )
    written = texts_of(plot_map(semantic_map, tmp_path / "map.svg", least=0.0))
    names = {semantic_map.catalogue.label(record.category) for record in semantic_map.objects()}
    labels = [text for text in written if text in names]
    assert len(labels) > 0.9 * 91
    assert written.count("corridor") == 4 and "waiting room" in written


def test_frequent_classes_have_a_colour_of_their_own() -> None:
    semantic_map = in_memory_map()
    labels = ["chair"] * 3 + ["banana", "apple", "oven", "umbrella"]
    objects = [record(semantic_map, label, k, 0) for k, label in enumerate(labels)]
    semantic_map.apply(MapUpdate(objects=tuple(objects)))
    groups = object_groups(semantic_map, objects)
    of = {semantic_map.catalogue.label(iri): group for iri, group in groups.items()}
    assert of["banana"] == of["apple"] and of["banana"].name == "food"
    assert {of[label].name for label in ("chair", "oven", "umbrella")} == {
        "chair",
        "electronics",
        "other",
    }
    assert len({group.colour for group in of.values()}) == 4


@given(st.floats(0.3, 40), st.floats(0.3, 40))
def test_names_of_places_fit_into_them(width: float, height: float) -> None:
    sheet = Sheet(Extent(0, 45, 0, 45))
    name = fit_name(sheet, PlaceRecord("urn:p", "p", 0, width, 0, height), "dining room", "not")
    if min(width, height) > 4 * sheet.metres(12) and max(width, height) > sheet.metres(110):
        assert name.box[0] <= width and name.box[1] <= height
        assert name.size == pytest.approx(9.5)
    assert name.size >= 5


def test_a_lone_spot_gets_a_sheet_and_a_row_of_spots_no_ribbon() -> None:
    lone = Extent.around(np.array([[40.0, -7.0]]))
    assert lone.width == lone.height == pytest.approx(3.0)
    row = Extent.around(np.array([[0.0, 0.0], [100.0, 0.0]]))
    assert row.width > 100 and row.height > 0.4 * row.width


def test_a_crowd_gets_a_larger_sheet() -> None:
    extent = Extent(0, 60, 0, 30)
    crowd = np.random.default_rng(1).uniform(0, 8, (90, 2))
    usual, large = (Sheet(extent, spots).figure.get_size_inches()[0] for spots in ((), crowd))
    assert 10 < usual < 12 and usual * 1.4 < large < 21


box_size = st.tuples(st.floats(5, 60), st.floats(5, 15))
spot = st.tuples(st.floats(0, 400), st.floats(0, 300))
labels = st.lists(st.tuples(spot, box_size), max_size=25)


def overlap(a: Sequence[float], b: Sequence[float]) -> bool:
    """Whether two boxes share more than an edge."""
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


@given(labels, st.lists(spot, max_size=4))
@settings(max_examples=60)
def test_no_label_covers_another_or_an_obstacle(
    items: Sequence[tuple[tuple[float, float], tuple[float, float]]],
    corners: Sequence[tuple[float, float]],
) -> None:
    obstacles = [(x, y, x + 30, y + 20) for x, y in corners]
    bounds = (0.0, 0.0, 400.0, 300.0)
    placed = place_labels([p for p, _ in items], [s for _, s in items], obstacles, bounds=bounds)
    boxes = [label.box for label in placed]
    for k, box in enumerate(boxes):
        assert not any(overlap(box, other) for other in (*boxes[k + 1 :], *obstacles))
        assert min(box) >= 0 and box[2] <= 400 and box[3] <= 300
        width, height = items[placed[k].index][1]
        assert box[2] - box[0] == pytest.approx(width)
        assert box[3] - box[1] == pytest.approx(height)


def test_a_label_with_room_stands_to_the_right_of_its_point() -> None:
    (label,) = place_labels([(100, 100)], [(40, 10)], bounds=(0, 0, 400, 300))
    assert label.box == (106, 95, 146, 105) and not label.distant
