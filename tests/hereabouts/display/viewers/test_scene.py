from dataclasses import replace

import numpy as np
import pytest

from hereabouts.display.plots.palette import object_groups
from hereabouts.display.viewers.scene import Scene, SceneReader, planned_search, triangles
from kg.maps.semantic_map import SemanticMap
from kg.model.areas import area_of
from kg.model.records import MapUpdate
from kg.serving.opening import in_memory_map


def covered(outline: object) -> float:
    a, b, c = triangles(outline).transpose(1, 0, 2)  # type: ignore[arg-type]
    (x1, y1), (x2, y2) = (b - a).T, (c - a).T
    return float(np.abs(x1 * y2 - x2 * y1).sum() / 2)


def star(corners: int) -> list[tuple[float, float]]:
    turn = np.arange(corners) * 2 * np.pi / corners
    reach = np.where(np.arange(corners) % 2, 1.0, 2.0)
    return list(zip(reach * np.cos(turn), reach * np.sin(turn), strict=True))


@pytest.mark.parametrize(
    ("outline", "off"),
    [
        ([[(0, 0), (4, 0), (4, 3), (2, 3), (2, 2), (0, 2)]], 1e-9),
        ([[(0, 0), (4, 0), (4, 4), (0, 4)], [(1, 1), (1, 2), (3, 2), (3, 1)]], 1e-9),
        ([star(50)], 1e-9),
        ([star(1900)], 0.05),  # more heights than strips
    ],
)
def test_triangles_cover_an_outline_without_its_holes(outline: object, off: float) -> None:
    area = area_of(outline)  # type: ignore[arg-type]
    assert covered(area.rings) == pytest.approx(area.area, rel=max(off, 1e-9))
    assert len(triangles(area.rings)) < 600_000


def test_objects_have_the_colours_of_plot_and_doubtful_ones_are_left_out(kitchen):
    scene = SceneReader(kitchen).read()
    assert [thing.text for thing in scene.objects] == ["dining table", "cup"]
    table, cup = scene.objects
    assert (table.extent, table.yaw) == ((1.2, 0.8, 0.8), 0.3) and cup.extent is None
    assert cup.existence == 0.75
    groups = object_groups(kitchen, [r for r in kitchen.objects() if r.existence >= 0.5])
    assert {thing.group for thing in scene.objects} == {g.name for g in groups.values()}
    assert {thing.text for thing in SceneReader(kitchen, 0).read().objects} >= {"chair"}


def test_places_relations_floor_and_robot_are_in_the_scene(kitchen: SemanticMap) -> None:
    scene = SceneReader(kitchen).read()
    viewed, unviewed = scene.places
    assert viewed.text == "kitchen\nKüche, belief 0.80" and viewed.colour is not None
    assert "not viewed yet" in unviewed.text and unviewed.colour is None
    table, cup = scene.objects
    assert [*scene.relations] == [(cup.p_map, table.p_map)]
    assert scene.floor is not None and scene.floor.height == 0.05
    assert scene.floor.grid.states.shape == (40, 20)  # one unknown cell around what is known
    assert scene.robot is not None and scene.robot.stamp == 1000


def test_groups_are_found_again_once_what_is_frequent_changes(kitchen: SemanticMap) -> None:
    reader = SceneReader(kitchen)
    assert {thing.group for thing in reader.read().objects if thing.text == "cup"} == {"other"}
    cup = next(r for r in kitchen.objects() if r.iri.endswith("/2"))
    more = [replace(cup, iri=kitchen.new_object_iri(), p_map=np.array([2.0, n, 1])) for n in (0, 1)]
    kitchen.apply(MapUpdate(objects=tuple(more)))
    assert {thing.group for thing in reader.read().objects if thing.text == "cup"} == {"cup"}


def test_an_empty_map_is_an_empty_scene() -> None:
    scene = SceneReader(in_memory_map(title="\x1b[31mred\n")).read()
    assert isinstance(scene, Scene) and scene.title.isprintable()
    assert (scene.objects, scene.places, scene.floor, scene.robot) == ((), (), None, None)


def test_a_planned_search_has_a_way_and_reasons(kitchen: SemanticMap) -> None:
    plan = planned_search(kitchen, "banana")
    assert plan is not None and len(plan.path) >= 1 and plan.path[0] == pytest.approx((2, 1))
    words = "\n".join(stop.text for stop in plan.stops if stop.text).splitlines()
    numbers = sorted(int(line.partition(".")[0]) for line in words)
    assert numbers == list(range(1, len(plan.stops) + 1))
    assert planned_search(in_memory_map(), "banana") is None
