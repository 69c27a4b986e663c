import json
from pathlib import Path

import numpy as np
import pytest

from kg.model.errors import RecordingError
from lab.maps.complete_truth import is_complete_truth, load_complete_truth
from lab.recordings.hard_senses import SENSES
from lab.recordings.simulated_recording import SimulationOptions, simulate_house, with_drift
from mapping.places.layout import load_layout
from perception.camera.poses import read_trajectory
from perception.inference.recorded_detections import load_recorded_detections
from perception.sources.recording import open_recording

SMALL = SimulationOptions(size=(160, 120), senses=SENSES["hard"], stride=3)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two sessions in a small house."""
    folder = tmp_path_factory.mktemp("simulated") / "house"
    simulate_house(folder, seed=2, sessions=2, options=SMALL)
    return folder


def truth(folder: Path) -> dict[str, dict[str, object]]:
    return json.loads((folder / "objects_full_gt.json").read_text())["objects"]


def test_a_session_is_a_recording_with_upright_poses_and_metric_depth(folder: Path) -> None:
    recording = open_recording(folder / "session-1")
    assert np.allclose(recording.T_map_world[:3, :3], np.eye(3))
    assert abs(recording.T_map_world[2, 3]) < 0.06
    assert len(recording) > 15
    frame = next(recording.frames(3))
    assert frame.rgb.shape == (120, 160, 3)
    heights = frame.T_map_cam[2, 3] - recording.T_map_world[2, 3]
    assert heights == pytest.approx(1.25)
    assert 0.5 < np.nanmedian(frame.depth) < 5


def test_detections_are_recorded_for_every_frame(folder: Path) -> None:
    recording = open_recording(folder / "session-1")
    detector = load_recorded_detections(folder / "session-1" / "detections.json")
    found = [detector.detect(frame) for frame in recording.frames()]
    assert sum(map(len, found)) > len(found)
    assert all(np.all(d.xyxy <= (160, 120, 160, 120)) for d in found)


def test_the_truth_is_a_complete_truth_that_names_what_was_seen(folder: Path) -> None:
    path = folder / "session-1" / "objects_full_gt.json"
    assert is_complete_truth(path)
    entries = load_complete_truth(path)
    true = [entry for entry in entries if not entry.ignore]
    assert len(true) >= 5 and all(entry.extent for entry in entries)
    frames = {frame.id for frame in open_recording(folder / "session-1").frames()}
    for name, entry in truth(folder / "session-1").items():
        if entry["cls"] == "not coco":
            assert entry["ignore"]
            continue
        assert set(entry["frames"]) <= frames, name
        assert entry["ignore"] == (len(entry["frames"]) < 3)


def test_the_second_truth_says_what_became_of_each_thing(folder: Path) -> None:
    first, second = truth(folder / "session-1"), truth(folder / "session-2")
    vanished = json.loads((folder / "session-2" / "objects_full_gt.json").read_text())["vanished"]
    assert vanished and vanished.keys() == first.keys() - second.keys()
    for name, entry in second.items():
        assert entry["new"] == (name not in first)
        if not entry["new"]:
            assert entry["cls"] == first[name]["cls"]
            assert entry["moved"] == (entry["position"] != first[name]["position"])
        if entry["moved"]:
            assert entry["before"] == first[name]["position"]
    assert any(entry["moved"] for entry in second.values())
    assert any(entry["carried"] for entry in second.values())


def test_places_are_the_same_in_both_sessions_and_do_not_tell_their_category(folder: Path) -> None:
    one, two = (load_layout(folder / f"session-{k}" / "places.json") for k in (1, 2))
    assert one == two
    assert all(place.category is None for place in one.places)


def test_nothing_is_written_into_a_folder_that_holds_something(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(RecordingError, match="is not empty"):
        simulate_house(tmp_path, seed=2, options=SMALL)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_odometry_drifts_from_the_true_poses(folder: Path) -> None:
    trajectory = read_trajectory(folder / "session-1" / "groundtruth.txt")
    true = [T for stamp in trajectory.stamp if (T := trajectory.at(stamp, 0.01)) is not None]
    rng = np.random.default_rng(0)
    exact = list(with_drift(true, 0.0, rng))
    assert np.allclose(exact, true)
    drifted = list(with_drift(true, 0.05, rng))
    away = np.linalg.norm(np.array(drifted)[:, :3, 3] - np.array(true)[:, :3, 3], axis=1)
    assert away[0] == 0 and 0.05 < away[-1] < 8
    assert np.allclose([T[2, 3] for T in drifted], 1.25)
