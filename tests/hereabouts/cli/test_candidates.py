"""Why is nothing here: the line after mapping, `why --candidates`, "perhaps" of find and status."""

import json
import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from hereabouts.cli import main
from kg.model.records import MapUpdate
from kg.serving.opening import create_map, open_map

Prints = Callable[..., str]
Fails = Callable[..., str]


@pytest.fixture
def mapped(kitchen_map: Path, tmp_path: Path) -> Path:
    return shutil.copytree(kitchen_map, tmp_path / "kitchen.map")


@pytest.fixture
def doubted(mapped: Path) -> tuple[str, str]:
    """Category and name (object/12) of an object of the map that is of a doubted category."""
    with open_map(mapped, read_only=True) as semantic_map:
        objects = semantic_map.objects()
        likely = {one.category for one in objects if one.existence >= 0.5}
        records = [o for o in objects if o.category not in likely and o.existence >= 0.1]
        best = max(records, key=lambda one: one.existence)
        return semantic_map.catalogue.label(best.category), best.iri.removeprefix(semantic_map.base)


def test_mapping_ends_with_what_is_not_believed(kitchen, tmp_path, capsys):
    into = tmp_path / "k.map"
    words = ["map", str(kitchen), "--no-check", "--limit", "4", "--into", str(into)]
    assert main(words) == 0
    (line,) = [one for one in capsys.readouterr().err.splitlines() if "not believed" in one]
    assert " things seen but not believed: " in line
    assert line.endswith(f"(hereabouts why {into} --candidates)")
    assert len(line) < 400
    assert (into / "detections.json").stat().st_size < 200_000

    assert main([*words, "--json", "--again"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["doubted"] >= len(report["most_probable_doubted"]) > 0
    existences = [one["existence"] for one in report["most_probable_doubted"]]
    assert existences == sorted(existences, reverse=True)


def test_why_tells_what_became_of_all_detections(mapped: Path, prints: Prints) -> None:
    told = prints("why", mapped, "--candidates")
    assert told.splitlines()[0].endswith(" detections in 8 frames")
    assert "too weak" in told and "Seen but not believed" in told
    report = json.loads(prints("why", mapped, "--candidates", "--json"))
    assert report["categories"]["chair"]["object"] > 0


def test_why_tells_what_became_of_one_category(mapped: Path, prints: Prints) -> None:
    told = prints("why", mapped, "--candidates", "chair")
    assert told.startswith("chair: ") and told.splitlines()[0].endswith(" in 8 frames")
    assert "too weak" in told and "Seen but not believed" in told
    assert prints("why", mapped, "chairs", "--candidates") == told, "a plural, before the option"
    assert prints("why", mapped, "--candidates", "dining", "table").startswith("dining table: ")
    report = json.loads(prints("why", mapped, "--candidates", "chair", "--json"))
    assert list(report["categories"]) == ["chair"]
    assert {one["category"] for one in report["things"]} <= {"chair"}


def test_what_was_never_detected_is_said_to_be_so(mapped: Path, prints: Prints) -> None:
    assert "giraffe: 0 detections in 8 frames" in prints("why", mapped, "--candidates", "giraffe")


def test_what_is_doubted_is_found_perhaps(mapped, doubted, prints):
    category, name = doubted
    (first, *_) = prints("find", mapped, category).splitlines()
    number = name.rpartition("/")[2]
    assert first.startswith("Perhaps ")
    assert f": {category} {number}, which may be no {category}, was seen there " in first
    assert prints("why", mapped, name).startswith(f"{category} {number} ")

    status = prints("status", mapped, category).splitlines()
    assert not status[0].startswith(f"{category}: present")
    assert status[1].partition(", last ")[0] == first.partition(", last ")[0]
    (one, *_) = json.loads(prints("status", mapped, category, "--json"))["perhaps"]
    assert one["object"].endswith(name) and 0.1 <= one["existence"] < 0.5


def test_what_is_present_is_not_perhaps(mapped, doubted, prints):
    category, name = doubted
    with open_map(mapped) as semantic_map:
        (record,) = semantic_map.perceived.objects((semantic_map.base + name,))
        semantic_map.apply(MapUpdate(objects=(replace(record, existence=0.8, confidence=2.4),)))
    assert "Perhaps" not in prints("status", mapped, category)
    assert json.loads(prints("status", mapped, category, "--json"))["perhaps"] == []


def test_detections_that_made_no_object_are_told_of(mapped: Path, prints: Prints) -> None:
    report = json.loads(prints("why", mapped, "--candidates", "--json"))
    found = next(n for n, of in report["categories"].items() if list(of) == ["too weak"])
    hint = f"(hereabouts why {mapped} --candidates {found})"
    for command in ("find", "status"):
        told = prints(command, mapped, found)
        assert f"The detector reported {found} " in told and hint in told
    (mapped / "detections.json").write_text("[]")
    assert hint not in prints("status", mapped, found)


def test_words_that_nobody_knows_are_refused(mapped: Path, fails: Fails) -> None:
    assert "no category 'qwertz'" in fails("why", mapped, "--candidates", "qwertz")


def test_a_map_that_nothing_was_mapped_into_says_so(tmp_path: Path, fails: Fails) -> None:
    with create_map(tmp_path / "new.map"):
        pass
    assert "has no detections.json" in fails("why", tmp_path / "new.map", "--candidates")


def test_a_damaged_report_is_one_line(mapped: Path, fails: Fails, prints: Prints) -> None:
    file = mapped / "detections.json"
    whole = file.read_text()
    for content in ("", "[" * 100_000, " " * 3_000_000, whole[:-20], '{"version": 99}'):
        file.write_text(content)
        line = fails("why", mapped, "--candidates")
        assert "detections.json" in line
        assert len(line) < 600
    file.unlink()
    os.mkfifo(file)
    assert "detections.json, a pipe" in fails("why", mapped, "--candidates")
    file.unlink()
    prints("find", mapped, "giraffe")


def test_labels_cannot_control_the_terminal(mapped: Path, prints: Prints) -> None:
    file = mapped / "detections.json"
    report = json.loads(file.read_text())
    report["categories"]["\x1b[2Jgizmo"] = report["categories"]["chair"]
    report["things"][0]["category"] = "\x1b]0;gizmo\x07"
    report["things"][0]["frame"] = "\x1b[31m"
    file.write_text(json.dumps(report))
    assert "\x1b" not in prints("why", mapped, "--candidates")
    assert "\x1b" not in prints("why", mapped, "--candidates", "\x1b[2Jgizmo")


@pytest.mark.parametrize(
    "words", [(), ("object/1", "--candidates", "--format", "ttl")], ids=["nothing", "turtle"]
)
def test_wrong_usage(mapped: Path, words: tuple[str, ...]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["why", str(mapped), *words])
    assert ended.value.code == 2
