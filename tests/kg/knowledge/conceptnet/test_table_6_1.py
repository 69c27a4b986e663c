"""lab/research/table_6_1.md is what its script prints, and what the thesis missed is there."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[4]


def test_the_table_in_the_documentation_is_the_one_computed(shared: Callable[[str], Path]) -> None:
    graph = shared("data/conceptnet/conceptnet4_en.graph.gz")
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.conceptnet", "table", str(graph)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == (ROOT / "lab/research/table_6_1.md").read_text()
    assert "bed in bedroom" in done.stdout.partition("here now")[2].partition("In the thesis")[0]
