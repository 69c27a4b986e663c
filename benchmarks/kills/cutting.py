"""Power cuts: the calls of a writer repeated up to a random moment, without what was not synced.

This is no real device: the calls are recorded once with strace and repeated on the model of a disk
(`benchmarks.kills.disk`), which loses all that was not synced, or random parts of it.
"""

from __future__ import annotations

import random
import shutil
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.kills.disk import Disk
from benchmarks.kills.examination import Known, examine_after_cut
from benchmarks.kills.processes import Child
from benchmarks.kills.recorded_calls import Call, Repetition, available, recorded, told
from benchmarks.kills.tally import Tally
from benchmarks.kills.writing import finding_of

A_RECORDING = 100  # cuts; then another is made
KEPT = (0.0, 0.0, 0.5, 0.9)  # probabilities that something unsynced is kept
Told = Callable[[Any], None]


def cut_power_safe(
    folder: Path, cuts: int, rng: random.Random, on_cut: Callable[[], None]
) -> Tally:
    """Cuts under a writer whose transactions wait for the disk: none of them is lost."""
    return _cut(folder, cuts, rng, on_cut, power_safe=True)


def cut_plain(folder: Path, cuts: int, rng: random.Random, on_cut: Callable[[], None]) -> Tally:
    """Cuts under a writer that does not wait: the last transactions may be lost, whole ones."""
    return _cut(folder, cuts, rng, on_cut, power_safe=False)


def _cut(
    folder: Path, cuts: int, rng: random.Random, on_cut: Callable[[], None], *, power_safe: bool
) -> Tally:
    tally = Tally(f"power, {'power-safe writer' if power_safe else 'plain writer'}")
    if not available():
        tally.notes = ["not run: there is no strace on this machine"]
        return tally
    lost = 0
    while tally.kills < cuts:
        root = folder / f"recorded-{tally.kills}"
        calls = _recording(root, rng, power_safe=power_safe)
        changes = sum(map(Repetition(Disk(root)).changes, calls))
        for _ in range(min(A_RECORDING, cuts - tally.kills)):
            disk, said = _until(root, calls, rng.randrange(changes))
            lost += _one(root, disk, said, rng, tally, power_safe=power_safe)
            on_cut()
    if not power_safe:
        tally.notes = [f"{lost:,} acknowledged transactions lost, as is said of this writer"]
    return tally


def _recording(root: Path, rng: random.Random, *, power_safe: bool) -> list[Call]:
    """Calls of a writer of a new map in `root`, which is removed afterwards."""
    root.mkdir()
    words = ["-m", "benchmarks.kills.recorded_work", str(root / "cut.map"), str(rng.random())]
    calls = recorded([*words, *(["power-safe"] if power_safe else [])], root.with_suffix(".txt"))
    shutil.rmtree(root)
    return calls


def _one(
    root: Path,
    disk: Disk,
    said: Known | None,
    rng: random.Random,
    tally: Tally,
    *,
    power_safe: bool,
) -> int:
    """One cut and what is there afterwards; the number of transactions that are not."""
    kept = rng.choice(KEPT)
    disk.after_cut(root, rng, kept)
    tally.kills += 1
    path = root / "cut.map"
    where = f"cut {tally.kills}, {kept:g} of what was not synced kept"
    try:
        if said is None and not path.exists():
            tally.early += 1
            return 0
        acknowledged = said or Known()

        def work(tell: Told) -> None:
            tell(asdict(examine_after_cut(path, acknowledged, power_safe=power_safe)))

        finding = finding_of(Child(work))
    finally:
        shutil.rmtree(root)
    there, promised = finding.known, acknowledged.frames + acknowledged.notes
    tally.checks += 1
    tally.acknowledged += promised
    tally.opened.append(finding.seconds)
    tally.unheard += max(0, there.frames + there.notes - promised)
    tally.wrong += [f"{where}: {line}" for line in finding.wrong]
    return max(0, promised - there.frames - there.notes)


def _until(root: Path, calls: list[Call], count: int) -> tuple[Disk, Known | None]:
    """The disk before so many changes of a recording, and what the writer had told by then."""
    disk, said = Disk(root), None
    repetition = Repetition(disk)
    for call in calls:
        if (text := told(call)).startswith(b"told "):
            frames, notes = map(int, text.split()[1:])
            said = Known(frames, notes, frames + notes)
        if repetition.changes(call):
            count -= 1
            if count < 0:
                break
    return disk, said
