"""Bags of a map, read again with the `rosbags` package."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Reader
from rosbags.typesys import Stores, get_typestore

from hereabouts.display.viewers.ros_messages import TOPICS, scenes_as_bag
from hereabouts.display.viewers.scene import ScenePlan, SceneReader, SceneStop
from kg.maps.semantic_map import SemanticMap
from kg.maps.surface.voxels import Surface
from kg.serving.opening import in_memory_map


def read(path: Path) -> dict[str, Any]:
    types = get_typestore(Stores.ROS1_NOETIC)
    with Reader(path) as bag:
        assert all(connection.ext.latching for connection in bag.connections)  # type: ignore[union-attr]
        return {
            connection.topic: types.deserialize_ros1(data, connection.msgtype)
            for connection, _, data in bag.messages()
        }


def test_a_bag_has_markers_floor_robot_and_plan(kitchen: SemanticMap, tmp_path: Path) -> None:
    plan = ScenePlan(((0, 0), (1, 1)), (SceneStop((1, 1), 0.5, "near the cup"),))
    scene = SceneReader(kitchen).read(plan)
    path = tmp_path / "kitchen.bag"
    path.write_bytes(scenes_as_bag([(scene, 1000.25)]))
    messages = read(path)
    assert set(messages) == set(TOPICS) - {"/hereabouts/surface"}  # this kitchen has none
    markers = messages["/hereabouts/markers"].markers
    assert markers[0].action == 3  # delete all: it replaces what was drawn before
    assert len({marker.id for marker in markers}) == len(markers)
    assert [m.text for m in markers if m.ns == "labels"] == ["dining table", "cup"]
    assert [m.color.a for m in markers if m.ns == "objects"] == pytest.approx([1, 0.75])
    assert [m.text for m in markers if m.ns == "reasons"] == ["near the cup"]
    floor = next(m for m in markers if m.ns == "places")
    assert floor.type == 11 and len(floor.points) % 3 == 0
    header = messages["/map"].header
    assert (header.frame_id, header.stamp.sec, header.stamp.nanosec) == ("map", 1000, 250_000_000)


def test_the_occupancy_grid_is_that_of_the_mapped_floor(kitchen, tmp_path):
    scene = SceneReader(kitchen).read()
    assert scene.floor is not None
    path = tmp_path / "kitchen.bag"
    path.write_bytes(scenes_as_bag([(scene, 1.0)]))
    grid = read(path)["/map"]
    data = np.asarray(grid.data, np.int8).reshape(grid.info.height, grid.info.width)
    assert (data == np.array([-1, 0, 100, 100])[scene.floor.grid.states].T).all()
    assert grid.info.resolution == pytest.approx(0.05)
    assert (grid.info.origin.position.x, grid.info.origin.position.y) == pytest.approx((0.05, 0.05))


def test_an_empty_map_is_a_bag_that_clears_the_view(tmp_path: Path) -> None:
    path = tmp_path / "empty.bag"
    path.write_bytes(scenes_as_bag([(SceneReader(in_memory_map()).read(), 0.0)]))
    messages = read(path)
    assert list(messages) == ["/hereabouts/markers"]
    assert [marker.action for marker in messages["/hereabouts/markers"].markers] == [3]


def test_a_cloud_has_the_points_and_the_colours_of_the_surface(kitchen, tmp_path):
    """As PCL and RViz read them: x, y, z and 0x00RRGGBB, each of four bytes, little-endian."""
    rng = np.random.default_rng(1)
    points = rng.normal(size=(20, 3)).astype(np.float32)
    colours = rng.integers(0, 256, (20, 3)).astype(np.uint8)
    surface = Surface(0.025, points, colours, np.ones(20, np.uint16), np.zeros(20))
    path = tmp_path / "kitchen.bag"
    scene = replace(SceneReader(kitchen).read(), surface=surface)
    path.write_bytes(scenes_as_bag([(scene, 1.0)]))
    cloud = read(path)["/hereabouts/surface"]
    kinds = {field.name: ("<f4" if field.name in "xyz" else "<u4") for field in cloud.fields}
    offsets = [field.offset for field in cloud.fields]
    form = {"names": [*kinds], "formats": [*kinds.values()], "offsets": offsets}
    rows = np.frombuffer(bytes(cloud.data), np.dtype({**form, "itemsize": cloud.point_step}))
    assert np.stack([rows[axis] for axis in "xyz"], axis=1) == pytest.approx(points)
    packed = colours.astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32)
    assert (rows["rgb"] == packed).all()
