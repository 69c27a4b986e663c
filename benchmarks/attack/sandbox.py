"""Family of attacks: acts of who executes code in a query worker, by system calls."""

from __future__ import annotations

import json
from pathlib import Path

from benchmarks.attack.outcome import Outcome
from benchmarks.attack.target import Target
from kg.serving.opening import create_map
from kg.serving.workers import process
from kg.serving.workers.process import WorkerProcess, settings_of
from kg.store.snapshots import Snapshots

_START = "import sys; sys.path[:0] = sys.argv[2:]; from tests.kg.serving.workers.probes import main"
_WITHIN = 120.0  # [s]


def attack(target: Target) -> Outcome:
    """Each act in a worker that was taken over; what succeeded is an escape."""
    with create_map(target.folder / "confined.map") as made:
        done = _acts(Snapshots(made.store, refresh=60))
    return Outcome(len(done), sum(result == "done" for result in done.values()), target.crashed())


def _acts(snapshots: Snapshots) -> dict[str, str]:
    """Results by the names of acts. The worker starts as ever, but with another evaluator."""
    started, process._START = process._START, f"{_START}; main()"
    try:
        worker = WorkerProcess(settings_of(512, (), snapshots.readable, snapshots.writable))
    finally:
        process._START = started
    folder: Path = snapshots.lease().folder
    answer = worker.ask({"folder": str(folder)}, _WITHIN)
    worker.close()
    snapshots.close()
    return dict(json.loads(answer.body))
