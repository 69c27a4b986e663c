"""What Rerun is given, read again with its own reader."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rerun.chunk import RrdReader

from hereabouts.display.viewers.rerun_viewer import RerunFile, scenes_as_rrd
from hereabouts.display.viewers.scene import ScenePlan, SceneReader, SceneStop
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import PictureError
from kg.serving.opening import in_memory_map
from perception.frames import Detections, Frame


def read(path: Path) -> dict[str, list[dict[str, Any]]]:
    """Entity -> rows of its chunks, by component."""
    found: dict[str, list[dict[str, Any]]] = {}
    for chunk in RrdReader(path).stream().to_chunks():
        batch = chunk.to_record_batch()
        components = [name for name in batch.schema.names if ":" in name]
        rows = batch.select(components).to_pylist()
        found.setdefault(str(chunk.entity_path), []).extend(rows)
    return found


def test_a_map_is_shapes_floors_lines_and_a_plan(kitchen: SemanticMap, tmp_path: Path) -> None:
    plan = ScenePlan(((0, 0), (1, 1)), (SceneStop((1, 1), 0.5, "near the cup"),))
    path = tmp_path / "kitchen.rrd"
    path.write_bytes(scenes_as_rrd([(SceneReader(kitchen).read(plan), 1000.25)]))
    entities = read(path)
    labels = {
        label
        for name, rows in entities.items()
        for row in rows
        for key, values in row.items()
        if name.startswith("/map/objects") and key.endswith(":labels")
        for label in values or ()
    }
    assert labels == {"dining table", "cup"}
    [extents] = entities["/map/objects/extents"]
    assert np.allclose(extents["Boxes3D:half_sizes"], [[0.6, 0.4, 0.4]])
    assert len(entities["/map/floor"]) == 1
    assert entities["/map/plan/stops"][0]["Arrows3D:labels"] == ["near the cup"]
    assert entities[r"/map/places/place\/1/name"][0]["Points3D:labels"] == [
        "kitchen\nKüche, belief 0.80"
    ]


def test_an_empty_map_is_a_valid_file(tmp_path: Path) -> None:
    path = tmp_path / "empty.rrd"
    path.write_bytes(scenes_as_rrd([(SceneReader(in_memory_map()).read(), float("nan"))]))
    assert "/map/objects/cubes" in read(path)


def test_frames_are_kept_as_they_come(kitchen: SemanticMap, tmp_path: Path) -> None:
    path = tmp_path / "out.rrd"
    viewer = RerunFile("our kitchen", path)
    assert not path.exists()
    rgb, K = np.zeros((12, 16, 3), np.uint8), np.diag([10.0, 10.0, 1.0])
    for stamp in (1.0, 2.0):
        frame = Frame("f", rgb, np.ones((12, 16), np.float32), K, np.eye(4), stamp)
        box = Detections(
            np.array([[1, 2, 8, 9]], np.float32), np.array([0.9], np.float32), ("cup",)
        )
        viewer.frame(frame, box)
    viewer.remark("found it", 2.0)
    viewer.close()
    entities = read(path)
    assert entities["/log"][0]["TextLog:text"] == ["found it"]
    boxes = [row["Boxes2D:labels"] for row in entities["/map/camera/image/detections"]]
    assert boxes == [["cup 0.90"], ["cup 0.90"]]
    with pytest.raises(PictureError, match="exists"):
        RerunFile("another", path)
    late = RerunFile("made meanwhile", tmp_path / "late.rrd")
    (tmp_path / "late.rrd").write_text("mine")
    with pytest.raises(PictureError, match="cannot write"):
        late.remark("too late", 1.0)
    assert (tmp_path / "late.rrd").read_text() == "mine"
