"""Boxes of objects in mesh files stand as the map has them."""

import json
from io import BytesIO

import numpy as np
import shapely
import trimesh

from hereabouts.display.viewers.mesh_files import scene_as_glb, scene_as_ply
from hereabouts.display.viewers.scene import SceneReader
from kg.maps.semantic_map import SemanticMap


def footprint(kitchen: SemanticMap) -> shapely.Polygon:
    table = next(one for one in kitchen.objects() if one.extent is not None)
    return shapely.Polygon(table.footprint)


def test_a_turned_table_is_turned_in_gltf(kitchen: SemanticMap) -> None:
    scene = trimesh.load(BytesIO(scene_as_glb(SceneReader(kitchen).read())), file_type="glb")
    (name,) = [node for node in scene.graph.nodes if node.startswith("dining table")]
    transform, geometry = scene.graph[name]
    corners = trimesh.transform_points(scene.geometry[geometry].vertices, transform)
    x, depth = corners[:, 0], -corners[:, 2]  # glTF has y upwards
    drawn = shapely.MultiPoint(np.stack([x, depth], 1)).convex_hull
    assert drawn.symmetric_difference(footprint(kitchen)).area < 1e-4
    assert np.ptp(corners[:, 1]) > 0.79


def test_a_turned_table_is_turned_in_ply(kitchen: SemanticMap) -> None:
    cloud = trimesh.load(BytesIO(scene_as_ply(SceneReader(kitchen).read())), file_type="ply")
    high = cloud.vertices[cloud.vertices[:, 2] < 0.5]  # the edges of the table, not the cup
    drawn = shapely.MultiPoint(high[:, :2]).convex_hull
    assert drawn.symmetric_difference(footprint(kitchen)).area < 1e-4


def test_the_bounds_of_gltf_are_those_of_its_numbers(kitchen: SemanticMap) -> None:
    data = scene_as_glb(SceneReader(kitchen).read())
    head = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    bounded = [one for one in head["accessors"] if "min" in one]
    assert bounded
    for one in bounded:
        assert np.less_equal(one["min"], one["max"]).all()
    assert any(np.less(one["min"], one["max"]).all() for one in bounded)
