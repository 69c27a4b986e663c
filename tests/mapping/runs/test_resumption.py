"""A recording that has grown since it was mapped goes on where it was."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from kg.model.errors import LayoutError
from kg.serving.opening import create_map
from mapping.recording_mapper import map_recording
from mapping.runs.resumption import resumed
from perception.inference.detector import load_detector
from perception.sources.recording import open_recording
from perception.sources.recording_options import RecordingOptions


def part_of(recording: Path, folder: Path, frames: int) -> Path:
    """`folder` with the first so many `frames` of a recording; which way is up is not said."""
    folder.mkdir(exist_ok=True)
    shown = sorted({path.name.split(".")[0] for path in recording.glob("frame-*.color.*")})
    kept = set(shown[:frames])
    for path in recording.iterdir():
        if "intrinsics" in path.name or path.name.split(".")[0] in kept:
            shutil.copyfile(path, folder / path.name)
    return folder


def test_a_recording_that_has_grown_goes_on_where_it_stood(tmp_path, shared):
    whole, folder = shared("data/rgbd/redkitchen"), tmp_path / "kitchen"
    detector = load_detector(shared("models/deimv2_femto_416.onnx"), threshold=0.25)
    with create_map(tmp_path / "kitchen.map") as semantic_map:
        first = open_recording(part_of(whole, folder, 3))
        map_recording(first, semantic_map, detector)
        grown = open_recording(part_of(whole, folder, 60))
        assert not np.allclose(grown.T_map_world, first.T_map_world, atol=1e-3)
        stood = resumed(grown, semantic_map)
        assert np.array_equal(stood.T_map_world, first.T_map_world)
        assert semantic_map.recordings()[0].frames_applied == 3
        given = open_recording(folder, RecordingOptions(T_map_world=grown.T_map_world))
        with pytest.raises(LayoutError, match="'kitchen' is in this map by another T_map_world"):
            map_recording(given, semantic_map, detector)
        for path in sorted(folder.glob("frame-*"))[5 * len(list(folder.glob("frame-000000.*"))) :]:
            path.unlink()
        report = map_recording(open_recording(folder), semantic_map, detector)
        assert (report.skipped, report.frames) == (3, 2)
        (record,) = semantic_map.recordings()
        assert np.array_equal(record.T_map_world, first.T_map_world)


def test_another_recording_of_the_same_name_is_refused(
    semantic_map, make_frame, list_recording, scripted_detector, make_detections
):
    def cup():
        return scripted_detector({}, make_detections(("cup", 0.5, (20, 15, 40, 30))))

    one, other = (
        list_recording([make_frame(2.0, id=f"{kind}-{n}") for n in range(9)])
        for kind in ("frame", "other")
    )
    map_recording(one, semantic_map, cup())
    before = semantic_map.store.sequence
    with pytest.raises(LayoutError, match=r"another recording 'room' is in this map: its frame"):
        map_recording(other, semantic_map, cup())
    assert semantic_map.store.sequence == before
