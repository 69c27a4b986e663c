import struct
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from hereabouts.demo.house_demo import ground_truth
from hereabouts.display.plots.drawing import Stop, draw_floor, draw_surface
from hereabouts.display.plots.label_placement import (
    WallsBelow,
    overlapping,
    place_labels,
    wall_cells,
)
from hereabouts.display.plots.layout import Extent, Listing, ListItem, Sheet
from hereabouts.display.plots.map_labels import NamedPlace, write_place_names
from hereabouts.display.plots.map_plot import SearchDrawing, plot_map
from hereabouts.display.plots.palette import object_groups
from hereabouts.display.plots.search_plot import numbered_stops
from kg.maps.semantic_map import SemanticMap
from kg.maps.surface.voxels import Surface
from kg.model.areas import area_of
from kg.model.errors import PictureError
from kg.model.records import FREE, UNKNOWN, MapUpdate, ObjectRecord, PlaceRecord, RobotRecord
from kg.serving.opening import in_memory_map
from lab.maps.saved_maps import import_saved_maps
from mapping.occupancy.mapped_floor import MappedFloor
from planner.simulation.house import furnished_house


def record(semantic_map, label, x, y, existence=1.0):
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
    return [
        line[5:-4].strip() for line in lines if line.startswith("<!-- ") and line.endswith(" -->")
    ]


def size_of(png: Path) -> tuple[int, int]:
    data = png.read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    width, height = struct.unpack(">II", data[16:24])
    return width, height


def test_a_picture_names_places_and_objects(kitchen: SemanticMap, tmp_path: Path) -> None:
    written = texts_of(plot_map(kitchen, tmp_path / "map.svg"))
    for text in ("our kitchen", "kitchen", "place 1, belief 0.81", "place 2", "not viewed yet"):
        assert text in written
    for text in ("banana", "oven", "chair", "food 1", "electronics 1", "other 1", "robot"):
        assert text in written
    assert "3 objects   ·   2 places, 1 not viewed yet" in written
    assert {"x [m]", "y [m]", "0", "2"} <= set(written)


def test_improbable_objects_are_drawn_on_request(kitchen: SemanticMap, tmp_path: Path) -> None:
    kitchen.apply(MapUpdate(objects=(record(kitchen, "vase", 1, 2, existence=0.4),)))
    some = texts_of(plot_map(kitchen, tmp_path / "some.svg"))
    assert "vase" not in some and "existence below 0.5" in some
    assert "vase" in texts_of(plot_map(kitchen, tmp_path / "all.svg", least=0.0))


def test_the_legend_goes_by_class_or_by_place(kitchen: SemanticMap, tmp_path: Path) -> None:
    (first, second) = (place.iri for place in kitchen.places())
    kitchen.apply(
        MapUpdate(
            objects=(
                replace(record(kitchen, "cup", 1, 1), place=first),
                replace(record(kitchen, "vase", 5, 1), place=second),
            )
        )
    )
    written = texts_of(plot_map(kitchen, tmp_path / "map.svg", legend="place"))
    assert {"kitchen 1", "elsewhere 4"} <= set(written) and "food 1" not in written


def test_anybodys_name_is_written_as_it_stands(kitchen: SemanticMap, tmp_path: Path) -> None:
    names = ["$\\frac{1}{0}$", "<b> & it", "Ann's שלום 😀 日本", "long " * 50]
    for name in names[:3]:
        thing = record(kitchen, "cup", 2, 1)
        kitchen.apply(MapUpdate(objects=(thing,)))
        kitchen.assertions.add(thing.iri, "label", name, by="ann")
    path = plot_map(kitchen, tmp_path / "map.svg", title=names[3] + "$")
    written = texts_of(path)
    assert {names[0], "Ann's שלום 😀 日本"} <= set(written)
    assert any(text.startswith("long long") and text.endswith("…") for text in written)


def test_the_ending_decides_the_format(kitchen: SemanticMap, tmp_path: Path) -> None:
    width, height = size_of(plot_map(kitchen, tmp_path / "map.PNG"))
    assert width > 1500 and height > 800
    assert plot_map(kitchen, tmp_path / "map.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize(("name", "said"), [("map.bmp", "the ending .bmp"), ("map", "no ending")])
def test_another_ending_is_refused_in_one_line(kitchen, tmp_path, name, said):
    with pytest.raises(PictureError, match=f"{said}; .png, .svg or .pdf would work") as error:
        plot_map(kitchen, tmp_path / name)
    assert "\n" not in str(error.value)
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_not_there_is_said_in_one_line(kitchen, tmp_path):
    with pytest.raises(PictureError, match=r"cannot write .*No such file"):
        plot_map(kitchen, tmp_path / "nowhere" / "map.png")


def test_the_same_map_gives_the_same_drawing(kitchen: SemanticMap, tmp_path: Path) -> None:
    first = plot_map(kitchen, tmp_path / "a.svg").read_bytes()
    assert first == plot_map(kitchen, tmp_path / "b.svg").read_bytes()


def test_a_search_has_its_way_its_stops_and_its_reasons(kitchen, tmp_path):
    search = SearchDrawing(
        np.array([[2, 1.5], [1.5, 1], [5, 1]]),
        (Stop(np.array([1.5, 1.0]), "1", ((0.0, 1.0),)), Stop(np.array([5.0, 1.0]), "2-3")),
        listing=Listing(
            "found in 9 s", (ListItem("1", "look east", "because"), ListItem("2", "further"))
        ),
    )
    written = texts_of(plot_map(kitchen, tmp_path / "a.svg", search=search))
    for text in ("1", "2-3", "route", "found in 9 s", "1  look east", "because", "2  further"):
        assert text in written
    assert "3 objects   ·   2 places, 1 not viewed yet   ·   2 stops" in written
    assert "route" not in texts_of(plot_map(kitchen, tmp_path / "b.svg", title="plain"))


def test_what_was_found_gets_a_star(kitchen: SemanticMap, tmp_path: Path) -> None:
    search = SearchDrawing(np.empty((0, 2)), finds=(np.array([2.0, 1.0, 0.9]),))
    path = plot_map(kitchen, tmp_path / "a.svg", search=search)
    assert "found" in texts_of(path)
    assert "found" not in texts_of(plot_map(kitchen, tmp_path / "b.svg"))


def test_looks_from_one_spot_share_a_disc() -> None:
    spots = [np.array(xy) for xy in ((1.0, 1.0), (1.1, 1.0), (4.0, 2.0), (1.0, 1.1))]
    stops = numbered_stops(spots, [(0.1 * k, 1.0) for k in range(4)])
    assert [tuple(stop.p_map) for stop in stops] == [(1.0, 1.0), (4.0, 2.0)]
    assert [stop.text for stop in stops] == ["1, ...", "3"]
    assert [len(stop.looks) for stop in stops] == [3, 1]


def test_a_house_adds_its_walls_and_widens_the_picture(kitchen, tmp_path):
    path = plot_map(kitchen, tmp_path / "a.svg", truth=ground_truth(furnished_house()))
    assert "truth" in texts_of(path)
    bare = plot_map(kitchen, tmp_path / "b.svg")
    assert path.read_text().count("<path") > bare.read_text().count("<path") + 80
    tall = size_of(plot_map(kitchen, tmp_path / "c.png", truth=ground_truth(furnished_house())))
    flat = size_of(plot_map(kitchen, tmp_path / "d.png"))
    assert tall[1] / tall[0] > 1.4 * flat[1] / flat[0]


def test_a_map_without_anything_is_still_a_picture(tmp_path: Path) -> None:
    path = plot_map(in_memory_map(title="nothing yet"), tmp_path / "map.svg")
    written = texts_of(path)
    assert "nothing yet" in written and "0 objects   ·   0 places" in written


def test_a_lone_object_without_any_place_is_drawn(tmp_path: Path) -> None:
    semantic_map = in_memory_map()
    semantic_map.apply(MapUpdate(objects=(record(semantic_map, "cup", 40, -7),)))
    assert "cup" in texts_of(plot_map(semantic_map, tmp_path / "map.svg"))


def test_the_laboratory_of_the_thesis_is_labelled(shared, tmp_path):
    semantic_map = in_memory_map(title="laboratory")
    folder = shared("reference")
    import_saved_maps(
        semantic_map, folder / "saved_objects_lab.json", folder / "saved_places_lab.json"
    )
    written = texts_of(plot_map(semantic_map, tmp_path / "map.svg", least=0.0))
    names = {semantic_map.catalogue.label(record.category) for record in semantic_map.objects()}
    labels = [text for text in written if text in names]
    assert len(labels) > 0.9 * 91
    kinds = [text.removeprefix("perhaps ") for text in written]
    assert kinds.count("corridor") == 4 and "waiting room" in kinds


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
@settings(max_examples=30)
def test_names_of_places_lie_in_them_off_the_walls(width: float, height: float) -> None:
    sheet = Sheet(Extent(0, 45, 0, 45))
    walls = np.zeros((450, 450), np.bool_)
    walls[:, 38:40] = True
    covers = WallsBelow(walls, np.zeros(2), 0.1, sheet.axes)
    area = area_of([[(0, 0), (width, 0), (width, height), (width / 2, height), (0, height / 2)]])
    texts, lost = write_place_names(
        sheet, [NamedPlace(area, "dining room", "place 1")], np.empty((0, 2)), covers
    )
    assert bool(texts) != bool(lost)
    assert texts or min(width, height) < 12
    for text in texts:
        box = np.array([sheet.measure.box(text)])
        assert not covers(box).any()
        corners = sheet.axes.transData.inverted().transform(box.reshape(2, 2))
        assert (corners >= 0).all() and (corners <= (width, height)).all()


def test_boxes_over_walls_are_told_from_others() -> None:
    sheet, rng = Sheet(Extent(0, 10, 0, 10)), np.random.default_rng(2)
    pieces = np.array([[(1.0, 2.0), (9.0, 2.0)], [(4.0, 0.0), (4.0, 20.0)]])
    walls = wall_cells(pieces, np.array([(0.0, 0.0), (10.0, 10.0)]), 0.05)
    low = rng.uniform(0, 9, (300, 2))
    boxes = np.hstack([low, low + rng.uniform(0.1, 1, (300, 2))])
    across = (boxes[:, 1] < 1.93) & (boxes[:, 3] > 2.07) & (boxes[:, 0] < 9) & (boxes[:, 2] > 1)
    along = (boxes[:, 0] < 3.93) & (boxes[:, 2] > 4.07)
    beyond = (boxes[:, 3] < 1.93) | (boxes[:, 1] > 2.07) | (boxes[:, 0] > 9.07)
    clear = beyond & ((boxes[:, 2] < 3.93) | (boxes[:, 0] > 4.07))
    pixels = sheet.axes.transData.transform(boxes.reshape(-1, 2)).reshape(-1, 4)
    covered = WallsBelow(walls, np.zeros(2), 0.05, sheet.axes)(pixels)
    assert covered[across | along].all() and not covered[clear].any()
    assert (across | along).any() and clear.any()


def test_only_seen_floor_has_the_colour_of_its_place() -> None:
    sheet = Sheet(Extent(0, 4, 0, 2))
    states = np.full((4, 2), FREE, np.uint8)
    states[1, 0] = UNKNOWN
    place = PlaceRecord("urn:p", "p", 0, 2, 0, 2)
    draw_floor(sheet.axes, MappedFloor(np.zeros(2), 1.0, states), [(place, "#ff0000")])
    ground = np.asarray(sheet.axes.images[0].get_array())
    assert ground[0, 1, 3] == 0 and (ground[1, :2, 0] > 0.99).all()
    assert ground[0, 0, 1] < 0.9 and ground[0, 3, 1] > 0.9  # the place's; that of no place


def test_a_lone_spot_gets_a_sheet_and_a_row_of_spots_no_ribbon() -> None:
    lone = Extent.around(np.array([[40.0, -7.0]]))
    assert lone.width == lone.height == pytest.approx(3.0)
    row = Extent.around(np.array([[0.0, 0.0], [100.0, 0.0]]))
    assert row.width > 100 and row.height > 0.13 * row.width


def test_an_upright_map_has_an_upright_page(tmp_path: Path) -> None:
    def page(*spots: tuple[float, float]) -> tuple[int, int]:
        semantic_map = in_memory_map()
        things = tuple(record(semantic_map, "cup", *spot) for spot in spots)
        semantic_map.apply(MapUpdate(objects=things))
        return size_of(plot_map(semantic_map, tmp_path / "map.png"))

    (low_wide, low_high), (tall_wide, tall_high) = page((0, 0), (60, 0)), page((0, 0), (0, 60))
    assert low_wide > 2 * low_high and tall_high > 2 * tall_wide
    assert tall_high - low_wide < 400


def test_a_map_far_from_its_origin_keeps_its_metres(tmp_path: Path) -> None:
    semantic_map = in_memory_map()
    things = tuple(record(semantic_map, "cup", 1e5 + k, -1e5) for k in range(9))
    semantic_map.apply(MapUpdate(objects=things))
    written = texts_of(plot_map(semantic_map, tmp_path / "map.svg"))
    assert {"100,002", "-100,000"} <= set(written)


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
def test_no_label_covers_another_or_an_obstacle(items, corners):
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


def test_the_surface_is_drawn_from_above_without_the_ceiling() -> None:
    from matplotlib.figure import Figure

    x = np.array([0.05, 0.05, 0.05, 0.25])
    z = np.array([0.0, 0.7, 2.5, 0.0])  # floor, a table on it, the ceiling; floor
    points = np.column_stack([x, np.full(4, 1.05), z]).astype(np.float32)
    colours = np.array([[9, 9, 9], [200, 100, 0], [255, 255, 255], [0, 0, 250]], np.uint8)
    surface = Surface(0.1, points, colours, np.ones(4, np.uint16), np.zeros(4))
    axes = Figure().add_subplot()
    draw_surface(axes, surface, 0.0)
    (image,) = axes.images
    assert image.get_extent() == pytest.approx([0.0, 0.3, 1.0, 1.1])
    pixels = np.round(255 * np.asarray(image.get_array())).astype(int)
    assert pixels.tolist() == [[[200, 100, 0, 255], [0, 0, 0, 0], [0, 0, 250, 255]]]


def test_boxes_overlap_where_they_share_an_area() -> None:
    rng = np.random.default_rng(0)
    low = rng.integers(0, 8, (60, 2))
    boxes = np.hstack([low, low + rng.integers(1, 4, (60, 2))]).astype(np.float64)
    shapes = [shapely.box(*box) for box in boxes]
    shared = [any(one.intersection(other).area for other in shapes[50:]) for one in shapes[:50]]
    assert overlapping(boxes[:50], boxes[50:]).tolist() == shared
    assert 0 < sum(shared) < 50
