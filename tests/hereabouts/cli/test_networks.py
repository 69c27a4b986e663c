"""Commands about networks: `evaluate detector`, `evaluate scene`, `teach`, `--device`, `best`."""

import json
import shutil
import socket
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from hereabouts.cli import main
from perception.inference import model_zoo

Prints = Callable[..., str]
Fails = Callable[..., str]
Shared = Callable[[str], Path]


def test_detectors_are_scored_side_by_side(prints: Prints, shared: Shared, tmp_path: Path) -> None:
    words = ("evaluate", "detector", "--coco", shared("data/images/coco"), "--limit", "3")
    table = prints(*words)
    assert "ssdlite_mobilenet_v2_coco_300" in table and "nanodet_g_416" in table
    results = tmp_path / "results.json"
    network = shared("models/deimv2_femto_416.onnx")
    answer = prints(*words, "--detector", network, "--results", results, "--json")
    (one,) = json.loads(answer)
    assert one["images"] == 3 and 0 < one["ap"] < one["ap50"] <= 1
    assert {c["name"] for c in one["classes"]} >= {"person", "cup"}
    assert {"image_id", "category_id", "bbox", "score"} == set(json.loads(results.read_text())[0])


def test_scene_classifiers_are_scored(prints: Prints, shared: Shared, tmp_path: Path) -> None:
    for room in ("bathroom", "kitchen"):
        (tmp_path / room).mkdir()
        for path in sorted(shared(f"data/images/places365_val120/{room}").glob("*.jpg"))[:3]:
            shutil.copy(path, tmp_path / room)
    (one,) = json.loads(prints("evaluate", "scene", "--images", tmp_path, "--json"))
    assert one["images"] == 6 and one["top1"] > 0.5
    assert sum(one["confusion"]["kitchen"].values()) == 3
    assert "kitchen" in prints("evaluate", "scene", "--images", tmp_path)


def test_devices_that_are_not_there_are_told_those_that_are(fails: Fails, kitchen: Path) -> None:
    told = fails("map", kitchen, "--into", kitchen.parent / "k.map", "--device", "abacus")
    assert "no device 'abacus'" in told and "cpu" in told
    assert not (kitchen.parent / "k.map").exists()


def test_the_best_detector_cannot_be_fetched_without_a_network(
    fails: Fails, kitchen: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        nobody = f"http://127.0.0.1:{closed.getsockname()[1]}/n.onnx"
        cards = tuple(replace(card, url=card.url and nobody) for card in model_zoo.cards())
        monkeypatch.setattr(model_zoo, "cards", lambda: cards)
        monkeypatch.setenv("HEREABOUTS_CACHE", str(tmp_path / "cache"))
        assert "no connection" in fails("models", "fetch", "best")
        told = fails("map", kitchen, "--into", tmp_path / "k.map", "--detector", "best")
    assert "no connection" in told and "the bundled ones run" in told
    assert not (tmp_path / "k.map").exists()


def test_a_better_detector_is_told_of_once_on_a_machine(kitchen, monkeypatch, tmp_path, capsys):
    name = "deimv2_femto_coco"
    card = model_zoo.find_model(name)
    assert card.sha256 and (card.ap or 0) > max(
        model_zoo.find_model(bundled).ap or 0 for bundled in model_zoo.bundled_pair()
    )

    def told(*words: str) -> str:
        words = ("map", str(kitchen), "--into", str(tmp_path / "k.map"), "--again", *words)
        assert main([*words, "--limit", "1", "--no-floor"]) == 0
        lines = [one for one in capsys.readouterr().err.splitlines() if name in one]
        assert len(lines) <= 1
        return "".join(lines)

    cache = tmp_path / "cache"
    monkeypatch.setenv("HEREABOUTS_CACHE", str(cache))
    network = shutil.copy(model_zoo.model_path(model_zoo.bundled_pair()[0]), tmp_path)
    assert told("--detector", str(network)) == "", "another detector was chosen"
    assert f"`hereabouts models fetch {name}` downloads it" in told()
    assert told() == ""
    for mark in cache.iterdir():
        mark.unlink()
    model_zoo.cached_path(card).touch()
    assert "fetch" not in (line := told()) and f"--detector {name} uses it" in line


def test_the_best_detector_is_the_one_of_highest_published_precision() -> None:
    best = model_zoo.best_detector()
    fetchable = [c for c in model_zoo.known_models() if c.kind == "detector" and c.url]
    assert best.ap == max(c.ap or 0 for c in fetchable) and best.url


def test_rooms_are_taught_to_a_map_and_used_by_the_next_run(
    kitchen: Path, kitchen_map: Path, tmp_path: Path, shared: Shared, capsys, fails: Fails
) -> None:
    mapped = shutil.copytree(kitchen_map, tmp_path / "home.map")
    capsys.readouterr()
    assert main(["rooms", str(mapped), "--json"]) == 0
    place = json.loads(capsys.readouterr().out)[0]["place"]
    images = str(shared("data/images/places365_val120/bathroom"))
    before = sorted(p.name for p in mapped.iterdir())
    for wrong, told in (
        ([place, "gizmo", "--images", images], "no kind of place 'gizmo'"),
        (["place/99", "kitchen", "--images", images], "no place 'place/99'"),
        ([place, "kitchen", "--images", str(tmp_path / "none")], "cannot read"),
    ):
        assert told in fails("teach", mapped, *wrong)
    assert sorted(p.name for p in mapped.iterdir()) == before
    assert main(["teach", str(mapped), place, "kitchen", "--recording", str(kitchen)]) == 0
    assert "one kind of room has no effect" in capsys.readouterr().err
    assert main(["teach", str(mapped), place, "bathroom", "--images", images, "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["taught"] == {"bathroom": 20}  # instead of what the place was taught by
    other = str(shared("data/images/places365_val120/kitchen"))
    folder = mapped / "taught_rooms.npz"
    assert folder.stat().st_size > 0
    assert main(["map", str(kitchen), "--into", str(mapped), "--again", "--limit", "1"]) == 0
    assert "rooms taught" not in capsys.readouterr().err  # one kind alone
    from perception.inference.scene_classifier import RoomExamples

    examples = RoomExamples.load(mapped)
    assert examples is not None
    moved = replace(examples, place=("elsewhere",) * len(examples.place))
    moved.save(mapped)
    assert main(["teach", str(mapped), place, "kitchen", "--images", other]) == 0
    assert main(["map", str(kitchen), "--into", str(mapped), "--again", "--limit", "1"]) == 0
    assert "rooms taught in this map: bathroom, kitchen" in capsys.readouterr().err
    folder.write_bytes(b"damaged")
    assert "taught_rooms.npz is damaged" in fails("map", kitchen, "--into", mapped, "--again")
