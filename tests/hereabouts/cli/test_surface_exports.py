"""The surface in files for other programs, read again by the programs' own packages."""

from pathlib import Path

import numpy as np
import pytest

from hereabouts.cli import main
from kg.maps.surface.voxels import Surface
from kg.serving.opening import open_map


@pytest.fixture(scope="module")
def furnished(kitchen_map: Path) -> tuple[Path, Surface, list[str]]:
    """A mapped kitchen, its surface, and the names of its objects."""
    with open_map(kitchen_map, read_only=True) as semantic_map:
        surface = semantic_map.surface(min_count=2)
        names = [one.iri.removeprefix(semantic_map.base) for one in semantic_map.objects()]
    assert len(surface) > 500 and names
    return kitchen_map, surface, names


def test_ply_opens_as_coloured_points(furnished, tmp_path):
    import trimesh

    path, surface, names = furnished
    assert main(["export", str(path), "-o", str(tmp_path / "k.ply"), "--all"]) == 0
    cloud = trimesh.load(tmp_path / "k.ply")
    n = len(surface)
    np.testing.assert_allclose(cloud.vertices[:n], surface.points, atol=1e-6)
    np.testing.assert_array_equal(cloud.colors[:n, :3], surface.colours)
    assert len(cloud.vertices) > n  # and the boxes of objects
    header = (tmp_path / "k.ply").read_bytes().partition(b"end_header")[0].decode()
    assert all(f"comment {name} " in header for name in names)


def test_gltf_opens_with_the_surface_and_named_boxes(furnished, tmp_path):
    import trimesh

    path, surface, names = furnished
    words = ["export", str(path), "--format", "gltf", "-o", str(tmp_path / "k.glb"), "--all"]
    assert main(words) == 0
    scene = trimesh.load(tmp_path / "k.glb")
    nodes = set(scene.graph.nodes)
    assert "surface" in nodes
    for name in names:
        assert any(node.endswith(f"({name})") for node in nodes), name
    transform, geometry = scene.graph["surface"]
    cloud = scene.geometry[geometry]
    assert len(cloud.vertices) == len(surface)
    x, y, z = (cloud.vertices @ transform[:3, :3].T).T
    np.testing.assert_allclose(np.stack([x, -z, y], 1), surface.points, atol=1e-5)


def test_a_map_without_a_surface_or_objects_is_written_too(lab, tmp_path):
    for name in ("m.ply", "m.glb"):
        assert main(["export", str(lab), "-o", str(tmp_path / name)]) == 0
        assert (tmp_path / name).stat().st_size > 50


def test_viewers_get_the_surface_as_a_point_cloud(furnished, tmp_path):
    from mcap.reader import make_reader
    from rerun.chunk import RrdReader
    from rosbags.rosbag1 import Reader
    from rosbags.typesys import Stores, get_typestore

    path, surface, _ = furnished
    for name in ("k.mcap", "k.bag", "k.rrd"):
        assert main(["export", str(path), "-o", str(tmp_path / name)]) == 0
    with (tmp_path / "k.mcap").open("rb") as file:
        (data,) = (
            message.data
            for _, _, message in make_reader(file).iter_messages(["/hereabouts/surface"])
        )
    ros2 = get_typestore(Stores.ROS2_HUMBLE).deserialize_cdr(data, "sensor_msgs/msg/PointCloud2")
    ros1 = get_typestore(Stores.ROS1_NOETIC)
    with Reader(tmp_path / "k.bag") as bag:
        (connection,) = (c for c in bag.connections if c.topic == "/hereabouts/surface")
        ((_, _, raw),) = bag.messages([connection])
    for cloud in (ros2, ros1.deserialize_ros1(raw, "sensor_msgs/msg/PointCloud2")):
        assert [field.name for field in cloud.fields] == ["x", "y", "z", "rgb"]
        points = cloud.data.view("<f4").reshape(-1, 4)[:, :3]
        np.testing.assert_array_equal(points, surface.points)
        rgb = cloud.data.reshape(-1, 16)[:, 14:11:-1]
        np.testing.assert_array_equal(rgb, surface.colours)
    entities = {str(c.entity_path) for c in RrdReader(tmp_path / "k.rrd").stream().to_chunks()}
    assert "/map/surface" in entities
