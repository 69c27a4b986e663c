import json
from pathlib import Path

import pytest

from hereabouts.cli import main
from kg.serving.opening import open_map


@pytest.fixture
def house(sessions: tuple[Path, Path]) -> Path:
    return sessions[0]


def test_a_simulated_house_is_mapped_with_its_own_detections(house: Path, tmp_path: Path) -> None:
    into = tmp_path / "house.map"
    detections = ["--detector", str(house / "detections.json"), "--scene", "none"]
    places = ["--places", str(house / "places.json")]
    assert main(["map", str(house), "--into", str(into), *detections, *places]) == 0
    with open_map(into, read_only=True) as semantic_map:
        assert len(semantic_map.objects()) >= 3
        assert len(semantic_map.places()) >= 4


def test_its_truth_scores_a_map_of_it(house: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--recording", str(house), "--truth", str(house / "objects_full_gt.json"), "--json"]
    words += ["--detector", str(house / "detections.json"), "--scene", "none"]
    assert main(["evaluate", "map", *words]) == 0
    lowest = json.loads(capsys.readouterr().out)["runs"][0]["thresholds"][0]
    assert lowest["true"] > 0 and lowest["recall"] > 0.2


def test_the_command_writes_a_recording(tmp_path, capsys):
    words = ["simulate", "house", "--seed", "2", "--size", "80x60", "-o", str(tmp_path / "house")]
    assert main([*words, "--json"]) == 0
    (told,) = json.loads(capsys.readouterr().out)
    assert told["frames"] == len(list((tmp_path / "house" / "rgb").iterdir())) > 100
    assert told["objects"] > 20 and told["detections"] > told["objects"]


def test_a_folder_in_use_is_left_alone(house: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = sorted(path.name for path in house.iterdir())
    assert main(["simulate", "house", "--seed", "1", "-o", str(house)]) == 1
    assert "is not empty; a new or an empty folder would work" in capsys.readouterr().err
    assert sorted(path.name for path in house.iterdir()) == before


@pytest.mark.parametrize("size", ["640", "640x481", "0x0", "99999x1", "axb"])
def test_sizes_that_are_none_are_wrong_usage(size: str, tmp_path: Path) -> None:
    words = ["simulate", "house", "--seed", "1", "--size", size, "-o", str(tmp_path / "new")]
    with pytest.raises(SystemExit) as stop:
        main(words)
    assert stop.value.code == 2


def test_detections_of_another_recording_leave_no_map(house: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.json"
    other.write_text('{"frames": {"x": []}}')
    into = tmp_path / "house.map"
    words = ["map", str(house), "--into", str(into), "--detector", str(other), "--scene", "none"]
    assert main(words) == 1
    assert not into.exists()


def test_identity_between_two_sessions_is_scored(sessions, capsys):
    words = ["--sessions", "2", "--same-frame", "--scene", "none", "--no-floor", "--json"]
    for place in sessions:
        words += ["--recording", str(place), "--truth", str(place / "objects_full_gt.json")]
    assert main(["evaluate", "map", "--detector", "detections.json", *words]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert [run["name"] for run in answer["runs"]] == ["session-1", "session-2"]
    (identity,) = answer["identity"]
    assert identity["all"]["things"] >= identity["all"]["right"] > 0
    assert identity["moved"]["things"] < identity["all"]["things"]


@pytest.mark.parametrize("number", ["0", "2"])
def test_sessions_need_as_many_recordings(number: str, house: Path) -> None:
    words = ["--recording", str(house), "--truth", str(house / "objects_full_gt.json")]
    with pytest.raises(SystemExit) as stop:
        main(["evaluate", "map", *words, "--sessions", number])
    assert stop.value.code == 2
