"""Extensions: another distribution adds a format, a detector, an exporter, a robot ..."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.perception.box_room import K, room_frame, round_tour
from tests.waiting import HEREABOUTS

ROOT = Path(__file__).resolve().parent.parent
EXAMPLE = ROOT / "tests" / "example_extension"
PAGE = ROOT / "docs" / "how-to" / "extend.md"
RED = 200, 20, 20


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the example distribution."""
    folder = tmp_path_factory.mktemp("installed")
    options = "--no-deps", "--no-build-isolation", "--no-index", "--quiet", "--target", str(folder)
    subprocess.run([sys.executable, "-m", "pip", "install", *options, str(EXAMPLE)], check=True)
    return folder


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A room with a red pillar, in one file."""
    frames = [room_frame(T, number) for number, T in enumerate(round_tour(20))]
    arrays = {
        "rgb": [np.where(f.rgb == 200, RED, f.rgb).astype(np.uint8) for f in frames],
        "depth": [frame.depth for frame in frames],
        "T_world_cam": [frame.T_map_cam for frame in frames],
        "stamps": [frame.stamp for frame in frames],
    }
    path = tmp_path_factory.mktemp("recordings") / "room.npz"
    np.savez(path, K=K, **arrays)
    return path


def run(extension: Path, *words: str | Path) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": f"{extension}{os.pathsep}{ROOT}"}
    command = [*HEREABOUTS, *map(str, words)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


def test_a_format_a_detector_and_an_exporter_of_another_distribution(
    installed: Path, recording: Path, tmp_path: Path
) -> None:
    seen = run(installed, "info", recording, "--json")
    assert seen.returncode == 0, seen.stderr
    assert json.loads(seen.stdout)["format"] == "npz"

    where = tmp_path / "room.map"
    options = "--detector", "red-things", "--scene", "none"
    mapped = run(installed, "map", recording, "--into", where, *options)
    assert mapped.returncode == 0, mapped.stderr

    written = run(installed, "export", where, "-o", tmp_path / "room.csv")
    assert written.returncode == 0, written.stderr
    head, *rows = (tmp_path / "room.csv").read_text().splitlines()
    assert "label" in head.split(",")
    assert len(rows) == 1
    assert "pillar" in rows[0]
    assert f"{len(rows)} objects" in written.stderr


def test_a_connection_and_a_robot_of_another_distribution(installed, recording, tmp_path):
    pytest.importorskip("rosbags")
    bag, where = tmp_path / "room", tmp_path / "room.map"
    written = run(installed, "convert", recording, "-o", bag)
    assert written.returncode == 0, written.stderr
    options = "--detector", "red-things", "--scene", "none", "--idle", "3"
    mapped = run(installed, "live", f"played://{bag}", "--into", where, *options)
    assert mapped.returncode == 0, mapped.stderr
    (row,) = json.loads(run(installed, "ask", where, "objects", "--format", "json").stdout)
    assert "pillar" in row["label"]
    words = "search", where, "pillar", "--robot", f"oracle://{row['x']},{row['y']}"
    found = run(installed, *words)
    assert found.returncode == 0, found.stderr
    assert "found pillar" in found.stderr + found.stdout
    assert "oracle" in run(installed, "search", where, "pillar", "--robot", "orcale://1").stderr
    wrong = run(installed, "search", where, "pillar", "--robot", "oracle://here")
    assert wrong.returncode == 1
    assert wrong.stderr.count("\n") == 1 and "could not convert" in wrong.stderr


def test_models_list_names_the_detector_and_its_distribution(installed: Path) -> None:
    (row,) = (
        each
        for each in json.loads(run(installed, "models", "list", "--json").stdout)
        if each["name"] == "red-things"
    )
    assert row["where"] == "extension"
    assert row["quality"] == "of hereabouts-example 1.0"


def test_errors_name_what_extensions_add(installed: Path, recording: Path, tmp_path: Path) -> None:
    refused = run(installed, "info", recording, "--format", "nzp")
    assert refused.returncode == 1
    assert "did you mean npz" in refused.stderr
    assert "a .npz file" in refused.stderr
    refused = run(installed, "map", recording, "--into", tmp_path / "m", "--detector", "red-thing")
    assert "did you mean red-things" in refused.stderr


def test_without_the_distribution_its_names_are_unknown(recording: Path, tmp_path: Path) -> None:
    refused = run(tmp_path, "info", recording)
    assert refused.returncode == 1
    assert "is no recording of a known format" in refused.stderr


@pytest.mark.parametrize(
    ("object_path", "complaint"),
    [
        ("absent:THING", "cannot be imported: ModuleNotFoundError"),
        ("json:dumps", "must be a Format, got function"),
    ],
)
def test_a_broken_extension_is_one_line_that_names_it(recording, tmp_path, object_path, complaint):
    folder = tmp_path / "broken-0.1.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 0.1\n")
    (folder / "entry_points.txt").write_text(f"[hereabouts.recordings]\nodd = {object_path}\n")
    refused = run(tmp_path, "info", recording)
    assert refused.returncode == 1
    (line,) = refused.stderr.splitlines()
    assert f"'odd' in hereabouts.recordings of broken ({object_path})" in line
    assert complaint in line


def test_the_page_shows_the_example_as_it_is() -> None:
    page = PAGE.read_text(encoding="utf-8")
    source = (EXAMPLE / "hereabouts_example.py").read_text(encoding="utf-8")
    settings = (EXAMPLE / "pyproject.toml").read_text(encoding="utf-8")
    blocks = re.findall(r"```(python|toml)\n(.*?)```", page, re.DOTALL)
    assert {language for language, _ in blocks} == {"python", "toml"}
    for language, text in blocks:
        assert text in (source if language == "python" else settings)
