"""Kills of writer, server and query worker, and a check that the check would notice."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from pyoxigraph import Quad

from kg.serving.opening import create_map, open_map

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture
def kills(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The benchmark's own examination, and its frames."""
    monkeypatch.syspath_prepend(str(ROOT))
    import benchmarks.kills.examination as examination
    import benchmarks.kills.frames as frames

    return examination, frames


def test_nothing_is_lost_to_kills() -> None:
    words = ["--writer", "3", "--server", "2", "--worker", "2", "--seed", "5"]
    run = subprocess.run(
        [sys.executable, "-m", "benchmarks.kills", *words],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=800,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    rows = [row.split(" | ") for row in run.stdout.splitlines() if row.startswith("| ")][1:]
    assert [(row[0].strip("| "), row[1]) for row in rows] == [
        ("writer of frames", "3"),
        ("server, with a follower", "2"),
        ("query worker", "2"),
    ]


def test_an_examination_notices_what_is_missing(kills: Any, tmp_path: Path) -> None:
    examination, frames = kills
    known = examination.Known
    path = tmp_path / "killed.map"
    with create_map(path, base=frames.BASE) as semantic_map:
        for number in range(3):
            semantic_map.apply(frames.frame_update(number))
        semantic_map.update(frames.note_update(1))

    def wrong(acknowledged: Any) -> str:
        finding = examination.examine(path, known(), acknowledged, read_only=False)
        assert finding.known == known(3, 1, 4)
        return "\n".join(finding.wrong)

    assert wrong(known(3, 1)) == wrong(known(2, 1)) == ""
    assert "4 frames were acknowledged, 3 are there" in wrong(known(4, 1))
    with open_map(path) as semantic_map:
        lost = min((q for q in semantic_map.engine if "object/2" in str(q.subject)), key=str)
        semantic_map.engine.remove(lost)
    assert isinstance(lost, Quad)
    found = wrong(known(3, 1))
    assert "the graph after 3 frames and 1 notes of 5 facts: 1 facts lack, 0 too many" in found
    assert "the history at #4: 0 facts lack, 1 too many" in found
    assert "the changes since #0: 0 facts lack, 1 too many" in found
