"""The commands of the tutorial run, in their order, and leave what the page says they leave."""

import re
import shlex
from pathlib import Path

import pytest

pytest.importorskip("rosbags")
PAGE = Path(__file__).resolve().parents[3] / "docs" / "tutorial" / "from-a-bag.md"
ENDLESS = "serve"  # tests of the server run it


def test_the_tutorial_runs_from_a_bag_to_an_answer(kitchen, tmp_path, prints, monkeypatch):
    (tmp_path / "recordings").mkdir()
    kitchen.rename(tmp_path / "recordings" / "kitchen")
    monkeypatch.chdir(tmp_path)
    lines = re.findall(r"^    hereabouts (.*)$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    commands = [shlex.split(line) for line in lines]
    said = {command[0]: prints(*command) for command in commands if command[0] != ENDLESS}
    assert list(said) == ["convert", "info", "map", "plot", "ask", "status", "find"]
    assert "/camera/color/image_raw/compressed" in said["info"]
    assert "chair" in said["map"]
    assert "object/" in said["ask"]
    assert "banana" in said["status"]
    for picture in ("kitchen.png", "plan.png"):
        assert (tmp_path / picture).read_bytes().startswith(b"\x89PNG")
