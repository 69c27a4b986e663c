"""Kills of writer, server and query worker, and a check that the check would notice."""

from __future__ import annotations

import os
import random
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


def test_nothing_is_lost_to_kills() -> None:
    words = ["--rounds", str(2 * len(KINDS)), "--seed", "5"]
    words += [word for kind in KINDS for word in ("--kind", kind)]
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
    assert [(row[0].strip("| "), row[1]) for row in rows] == [(row, "2") for row in KINDS.values()]


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


def test_a_cut_of_the_power_loses_what_was_not_synced(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.syspath_prepend(str(ROOT))
    from benchmarks.kills.disk import Disk, File

    def after(kept: float) -> dict[str, bytes]:
        disk, folder = Disk(Path("/d")), tmp_path / str(kept)
        synced, unsynced = disk.create("/d/synced"), disk.create("/d/unsynced")
        synced.write(0, b"one")
        disk.sync(synced, 1, disk.entries)
        synced.write(3, b"two")
        unsynced.write(0, b"three")
        disk.rename("/d/synced", "/d/renamed")
        assert isinstance(disk.at("/d/renamed"), File)
        disk.after_cut(folder, random.Random(1), kept)
        return {file.name: file.read_bytes() for file in folder.iterdir()}

    assert after(0.0) == {"synced": b"one", "unsynced": b""}
    assert after(1.0) == {"renamed": b"onetwo", "unsynced": b"three"}


def test_the_recorded_writer_outlives_cuts_of_the_power() -> None:
    if shutil.which("strace") is None:
        pytest.skip("strace is not installed")
    words = ["--rounds", "6", "--kind", "power-safe", "--kind", "power"]
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
