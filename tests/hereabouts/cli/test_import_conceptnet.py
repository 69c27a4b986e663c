"""`hereabouts import conceptnet`: tables, JSON, a dry run, and one line where it goes wrong."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from hereabouts.cli import main

Prints = Callable[..., str]
Fails = Callable[..., str]


@pytest.fixture
def graph(tmp_path: Path) -> Path:
    path = tmp_path / "some graph"
    path.write_text(
        "cup\tkitchen\t{'freq': 5, 'score': 9, 'rel': u'AtLocation'}\n"
        "cup\tkitchen\tnothing\n"
        "bed\tbedroom\t{'freq': 5, 'score': 12, 'rel': u'AtLocation'}\n"
    )
    return path


def test_without_a_file_to_write_it_prints_what_it_found(prints: Prints, graph: Path) -> None:
    text = prints("import", "conceptnet", "--from", graph)
    assert [line.split()[:4] for line in text.splitlines() if "Bed" in line] == [
        ["Bed", "located", "at", "Bedroom"]
    ]


def test_a_dry_run_prints_the_difference_and_leaves_the_file(capsys, graph, tmp_path):
    words = ["import", "conceptnet", "--from", str(graph), "--into", str(tmp_path / "out.ttl")]
    assert main([*words, "--dry-run"]) == 0
    out, err = capsys.readouterr()
    assert "added" in out
    assert "skipped 1 lines: 1 no data in it" in err
    assert not (tmp_path / "out.ttl").exists()
    assert main(words) == 0
    assert "wrote" in capsys.readouterr().err
    assert main(words) == 0
    assert "is up to date" in capsys.readouterr().err


def test_json_holds_all_that_was_found(prints: Prints, graph: Path, tmp_path: Path) -> None:
    into = tmp_path / "out.ttl"
    said = json.loads(prints("import", "conceptnet", "--from", graph, "--into", into, "--json"))
    assert said["written"] is True
    assert said["skipped"] == {"no data in it": 1}
    bed = next(found for found in said["found"] if found["subject"].endswith("#Bed"))
    assert bed["relation"] == "locatedAt"
    assert bed["weight"] == 6.633
    assert {change["change"] for change in said["changes"]} == {"added"}


def test_what_cannot_be_read_is_one_line(fails: Fails, graph: Path, tmp_path: Path) -> None:
    assert "No such file" in fails("import", "conceptnet", "--from", tmp_path / "absent")
    assert "no file of this importer" in fails(
        *("import", "conceptnet", "--from", graph, "--into", _other(tmp_path))
    )
    assert "no ontologies in" in fails(
        *("import", "conceptnet", "--from", graph, "--ontologies", tmp_path / "none")
    )


def _other(folder: Path) -> Path:
    path = folder / "other.ttl"
    path.write_text("<urn:a> <urn:b> <urn:c> .\n")
    return path


def test_a_language_nobody_speaks_leaves_the_file_as_it_is(prints, fails, graph, tmp_path):
    into = tmp_path / "conceptnet.ttl"
    prints("import", "conceptnet", "--from", graph, "--into", into)
    before = into.read_bytes()
    words = ("import", "conceptnet", "--from", graph, "--into", into, "--language", "xx")
    assert "no assertion about these categories in the language 'xx'" in fails(*words)
    assert into.read_bytes() == before
