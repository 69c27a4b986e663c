"""A recording without poses finds itself in a map of the same room, and in no other."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from kg.model.errors import LayoutError
from kg.serving.opening import create_map
from mapping.mapping_options import MappingOptions
from mapping.recording_mapper import map_recording
from perception.camera.poses import motion
from perception.sources.recording import FolderRecording, open_recording
from perception.sources.recording_options import RecordingOptions, Selection

OPTIONS = MappingOptions(check_poses=False, surface=None, pictures=False)
GIVEN = RecordingOptions(check=False, selection=Selection(every=4, limit=12))


@pytest.fixture(scope="module")
def second(shared: Callable[[str], Path], tmp_path_factory) -> FolderRecording:
    """Other images of the living room than the map's, without poses, in their own world."""
    source, folder = shared("data/rgbd/icl_livingroom"), tmp_path_factory.mktemp("r") / "second"
    for name in ("image", "depth"):
        (folder / name).mkdir(parents=True)
        for path in sorted((source / name).iterdir())[5:25:2]:
            (folder / name / path.name).symlink_to(path)
    shutil.copy(source / "intrinsics.json", folder)
    return open_recording(folder)


@pytest.fixture
def nothing(scripted_detector, make_detections):
    return scripted_detector({}, make_detections())


def test_it_is_placed_in_the_map_and_the_map_says_how(shared, tmp_path, second, nothing):
    first = open_recording(shared("data/rgbd/icl_livingroom"), GIVEN)
    truth = open_recording(shared("data/rgbd/icl_livingroom"), RecordingOptions(check=False))
    true = {entry.id: first.T_map_world @ entry.T_world_cam for entry in truth.listing.entries}
    with create_map(tmp_path / "a.map") as semantic_map:
        map_recording(first, semantic_map, nothing, options=OPTIONS)
        report = map_recording(second, semantic_map, nothing, options=OPTIONS)
        assert report.frames == len(second)
        assert "second was recognised in" in report.fit
        record = {r.name: r for r in semantic_map.recordings()}["second"]
        assert "errors of up to" in record.pose_estimate
        assert "; recognised in" in record.pose_estimate
        placed = second.placed(record.T_map_world)
        for frame in placed.frames():
            far, turned = motion(true[frame.id], frame.T_map_cam)
            assert far < 0.06
            assert turned < np.deg2rad(2)
        again = map_recording(second, semantic_map, nothing, options=OPTIONS)
        assert (again.frames, again.skipped) == (0, len(second))


def test_it_is_refused_in_a_map_of_another_room(shared, tmp_path, second, nothing):
    lounge = open_recording(shared("data/rgbd/hololens_lounge"), GIVEN)
    with create_map(tmp_path / "a.map") as semantic_map:
        map_recording(lounge, semantic_map, nothing, options=OPTIONS)
        before = semantic_map.sequence
        with pytest.raises(LayoutError, match=r"place of 'second'.*not recognised.*would work"):
            map_recording(second, semantic_map, nothing, options=OPTIONS)
        (semantic_map.store.path / "views.sqlite").unlink()
        with pytest.raises(LayoutError, match=r"the map keeps no views.*a new map would work"):
            map_recording(second, semantic_map, nothing, options=OPTIONS)
        with pytest.raises(LayoutError, match="a world of their own"):
            map_recording(second, semantic_map, nothing, options=MappingOptions(same_frame=True))
        assert semantic_map.sequence == before
