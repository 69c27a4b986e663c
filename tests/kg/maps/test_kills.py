"""Kills of writer, server and query worker, and a check that the check would notice."""

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from pyoxigraph import Quad

from kg.model import vocabulary as v
from kg.serving.opening import create_map, open_map

KINDS = {
    "writer": "writer of frames",
    "server": "server, with a follower",
    "worker": "query worker",
    "compact": "compact",
    "export": "export",
}
ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture
def kills(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The benchmark's own examination, and its frames."""
    monkeypatch.syspath_prepend(str(ROOT))
    import benchmarks.kills.examination as examination
    import benchmarks.kills.frames as frames

    return examination, frames


def kill(*words: str) -> str:
    run = subprocess.run(
        [sys.executable, "-m", "benchmarks.kills", *words],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=800,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    return run.stdout


def test_nothing_is_lost_to_kills() -> None:
    kinds = [word for kind in KINDS for word in ("--kind", kind)]
    told = kill("--rounds", str(len(KINDS)), "--seed", "5", *kinds)
    rows = [row.split(" | ") for row in told.splitlines() if row.startswith("| ")][1:]
    assert [(row[0].strip("| "), row[1]) for row in rows] == [(row, "1") for row in KINDS.values()]


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
        facts = (q for q in semantic_map.engine if "object/2" in str(q.subject))
        lost = min((q for q in facts if q.predicate != v.RDF_TYPE), key=str)  # implies no other
        semantic_map.engine.remove(lost)
    assert isinstance(lost, Quad)
    found = wrong(known(3, 1))
    assert "the graph after 3 frames and 1 notes of 5 facts: 1 facts lack, 0 too many" in found
    assert "the history at #4: 0 facts lack, 1 too many" in found
    assert "the changes since #0: 0 facts lack, 1 too many" in found


def test_the_recorded_writer_outlives_cuts_of_the_power() -> None:
    if shutil.which("strace") is None:
        pytest.skip("strace is not installed")
    kill("--rounds", "2", "--kind", "power-safe", "--kind", "power")
