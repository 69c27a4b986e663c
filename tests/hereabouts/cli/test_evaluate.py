"""`hereabouts evaluate map` on eight frames of a real kitchen, with the bundled detector."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from hereabouts.cli import main
from hereabouts.cli.mapping_options import MODES
from mapping.runs.progress_report import STAGES

Shared = Callable[[str], Path]


@pytest.fixture
def truth(shared: Shared) -> Path:
    return shared("data/rgbd/redkitchen/objects_full_gt.json")


@pytest.fixture
def mapped(kitchen_map: Path, tmp_path: Path) -> Path:
    return shutil.copytree(kitchen_map, tmp_path / "mapped.map")


def scores_of(run: dict[str, object]) -> dict[str, object]:
    """What does not depend on how the map came to be."""
    keys = ("thresholds", "switches", "calibration", "coverage", "average_precision", "best_f1")
    return {key: run[key] for key in keys}


def test_truth_by_class_counts_what_the_map_holds(kitchen, prints, shared):
    truth = shared("data/rgbd/redkitchen/objects_gt.json")
    detector = shared("models/nanodet_plus_m_416.onnx")
    answer = json.loads(
        prints(
            *("evaluate", "map", "--recording", kitchen, "--no-check", "--truth", truth),
            *("--detector", detector, "--json"),
        )
    )
    (score,) = answer["runs"]
    assert score["frames"] == 8
    assert set(score["milliseconds_per_frame"]) == set(STAGES)
    assert 0 < score["recall"] <= 1
    matched = sum(row["matched"] for row in score["per_class"].values())
    assert score["recall"] == pytest.approx(matched / 14)


def test_a_map_scores_as_its_recording_does_and_modes_are_compared(kitchen, mapped, truth, prints):
    words = ("--truth", truth, "--json")
    (given,) = json.loads(prints("evaluate", "map", mapped, *words))["runs"]
    compared = json.loads(
        prints("evaluate", "map", "--recording", kitchen, *words, "--compare", "--no-check")
    )
    fresh, other = compared["runs"]
    assert scores_of(given) == scores_of(fresh) != scores_of(other)
    assert [fresh["mode"], other["mode"]] == list(MODES)
    assert given["name"] == "mapped" and "mode" not in given
    assert fresh["frames"] == 8
    assert given["thresholds"][0]["matched"] >= 1
    assert 0 < given["average_precision"] <= given["best_f1"] < 1
    assert given["switches"] >= 0 and 0 <= given["calibration"]["ece"] <= 1


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--truth", "t"], "MAP or --recording"),
        (["a.map", "--truth", "t", "--truth", "u"], "--truth of its own"),
        (["a.map", "b.map", "--recording", "r", "--truth", "t", "--truth", "u"], "--recording of"),
        (["a.map", "--truth", "t", "--compare"], "no MAP"),
    ],
)
def test_options_that_do_not_fit_together(words, says, capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["evaluate", "map", *words])
    assert stopped.value.code == 2
    assert says in capsys.readouterr().err


def test_a_map_without_a_recording_needs_the_transform_of_one(lab, kitchen, truth, prints, fails):
    assert "--recording DIR" in fails("evaluate", "map", lab, "--truth", truth)
    table = prints("evaluate", "map", lab, "--recording", kitchen, "--truth", truth)
    assert "lab" in table


def test_pictures_of_one_map_and_of_several(mapped, truth, prints, tmp_path):
    picture, plot = tmp_path / "above.png", tmp_path / "reliability.svg"
    words = ("--picture", picture, "--plot", plot)
    prints("evaluate", "map", mapped, "--truth", truth, *words)
    assert picture.exists() and "mapped: ECE" in plot.read_text()
    prints("evaluate", "map", mapped, mapped, "--truth", truth, "--truth", truth, *words)
    assert {path.name for path in tmp_path.glob("above-*")} == {
        "above-1-mapped.png",
        "above-2-mapped.png",
    }
    assert "all: ECE" in plot.read_text()


def test_pictures_that_cannot_be_drawn_are_refused_before_mapping(truth, shared, fails, tmp_path):
    nowhere = ("evaluate", "map", "--recording", tmp_path / "nowhere", "--truth")
    assert ".png, .svg or .pdf" in fails(*nowhere, truth, "--picture", tmp_path / "a.bmp")
    by_class = shared("data/rgbd/redkitchen/objects_gt.json")
    assert "complete truth" in fails(*nowhere, by_class, "--plot", tmp_path / "a.png")


def test_whose_world_the_truth_is_in(kitchen, mapped, truth, prints, fails, tmp_path):
    words = ("evaluate", "map", mapped, "--truth", truth)
    alone = prints(*words)
    transforms = tmp_path / "transforms.json"
    shifted = [[1, 0, 0, 9], [0, 0, 1, 9], [0, -1, 0, 9], [0, 0, 0, 1]]
    transforms.write_text(json.dumps({"sequences": {"kitchen": {"T_map_world": shifted}}}))
    other = ("--name", "shifted", "--transform", transforms)
    prints("map", kitchen, "--no-check", "--limit", 2, "--into", mapped, *other)
    assert "kitchen, shifted; give --name NAME" in fails(*words)
    assert (
        prints(*words, "--name", "kitchen").splitlines()[3].split()[:3]
        == (alone.splitlines()[3].split()[:3])
    )
    prints(*words, "--name", "shifted")
    assert "kitchen, shifted, not 'nobody'" in fails(*words, "--name", "nobody")


def test_each_recording_has_detections_of_its_own(kitchen, truth, prints, fails, tmp_path):
    other = tmp_path / "other"
    shutil.copytree(kitchen, other)
    frames = sorted(path.name.split(".")[0] for path in kitchen.glob("*.color.jpg"))
    box = [120, 100, 520, 400, 0.9, "dining table"]
    for folder, rows in ((kitchen, [box]), (other, [])):
        found = {"name": folder.name, "frames": dict.fromkeys(frames, rows)}
        (folder / "detections.json").write_text(json.dumps(found))
    recordings = ("--recording", kitchen, "--truth", truth, "--recording", other, "--truth", truth)
    words = ("evaluate", "map", *recordings, "--no-check", "--scene", "none", "--detector")
    answer = json.loads(prints(*words, "detections.json", "--json"))
    assert [run["detector"] for run in answer["runs"]] == ["kitchen", "other"]
    mapped = [run["thresholds"][0]["mapped"] for run in answer["runs"]]
    assert mapped[0] > 0 and mapped[1] == 0
    assert "nowhere.json" in fails(*words, "nowhere.json")
