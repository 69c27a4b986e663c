"""why, log, diff, compact and ask --at on a real map."""

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from hereabouts.cli import main
from kg.serving.opening import open_map

Prints = Callable[..., str]
Fails = Callable[..., str]


@pytest.fixture
def mapped(kitchen_map: Path, tmp_path: Path) -> Path:
    """Eight frames of the real kitchen, mapped."""
    return shutil.copytree(kitchen_map, tmp_path / "kitchen.map")


def test_from_an_object_to_the_frame_behind_it(mapped: Path, prints: Prints) -> None:
    (first, *_) = json.loads(prints("ask", mapped, "objects", "--format", "json"))
    name = "/".join(first["object"].split("/")[-2:])
    told = prints("why", mapped, name)
    assert told.startswith(f"{first['label']} in ") and "seen best in frame-0000" in told
    assert len(told.splitlines()) < 10 and "transaction" not in told and "px" not in told
    tree = prints("why", mapped, name, "--explain")
    assert tree.startswith(f"{first['label']} in ") and "evidence: seen best in frame-0000" in tree
    assert "of kitchen at" in tree and "pose: camera at" in tree
    assert "written: transaction #" in tree
    (explained,) = json.loads(prints("why", mapped, name, "--format", "json"))
    assert explained["iri"] == first["object"]
    turtle = prints("why", mapped, name, "here:x", "--format", "ttl")
    assert "sosa:madeBySensor" in turtle and "prov:wasGeneratedBy" in turtle


def test_the_past_of_a_map(mapped: Path, prints: Prints) -> None:
    robot = json.loads(prints("log", mapped, "robot", "--json"))
    assert [entry["sequence"] for entry in robot][:2] == [1, 2]
    assert len(json.loads(prints("log", mapped, "robot", "--json", "--last", 3))) == 3
    assert json.loads(prints("log", mapped, "robot", "--json", "--last", 0)) == []
    assert "frame kitchen/frame-000224" in prints("log", mapped, "robot", "--explain")
    brief = prints("log", mapped, "object/1")
    assert "observation count" not in brief and "new: " in brief
    assert not re.search(r"object/|place/|here:|https:", brief + prints("why", mapped, "object/1"))
    assert "observation count" in prints("log", mapped, "object/1", "--explain")
    earlier = json.loads(prints("ask", mapped, "robot", "--format", "json", "--at", "#2"))
    timed = json.loads(prints("ask", mapped, "robot", "--format", "json", "--at", robot[1]["time"]))
    latest = json.loads(prints("ask", mapped, "robot", "--format", "json"))
    assert earlier == timed != latest
    rows = json.loads(prints("diff", mapped, "#2", "#8", "--facts", "--json"))
    (moved,) = [r for r in rows if (r["subject"], r["predicate"]) == ("robot", "x")]
    assert float(moved["before"]) == pytest.approx(earlier[0]["x"])
    assert float(moved["after"]) == pytest.approx(latest[0]["x"])
    table = prints("diff", mapped, "#2", "#8", "--facts")
    assert "robot" in table
    cells = next(line for line in table.splitlines() if "floor cells" in line)
    assert cells.rstrip().endswith(" characters")


def test_compacting_a_map(mapped: Path, prints: Prints, fails: Fails) -> None:
    before = prints("ask", mapped, "objects")
    done = json.loads(prints("compact", mapped, "--keep", "0s", "--json"))
    last = done["floor"]  # eight frames, and what was left of the floor after them
    assert done["dropped"] == last >= 8
    assert prints("ask", mapped, "objects") == before
    assert f"#{last} to #{last}" in fails("ask", mapped, "objects", "--at", "#7")
    assert "no duration" in fails("compact", mapped, "--keep", "soon")


def test_mapping_with_a_bounded_past(kitchen: Path, tmp_path: Path, fails: Fails) -> None:
    into = tmp_path / "bounded.map"
    assert "no duration 'soon'" in fails("map", kitchen, "--into", into, "--keep", "soon")
    assert not into.exists()
    words = ["--no-check", "--limit", "4", "--keep", "0s", "--power-safe"]
    assert main(["map", str(kitchen), "--into", str(into), *words]) == 0
    with open_map(into, read_only=True) as bounded:
        last = bounded.sequence
    assert last >= 4
    assert f"#{last} to #{last}" in fails("ask", into, "objects", "--at", "#1")


def test_a_past_that_is_not_there(mapped: Path, fails: Fails) -> None:
    assert "no moment" in fails("ask", mapped, "objects", "--at", "noon")
    assert "no transaction #99" in fails("diff", mapped, "#1", "#99")
    assert "nothing is called" in fails("why", mapped, "nonsense")
    assert "knows nothing of object/999" in fails("log", mapped, "object/999")
