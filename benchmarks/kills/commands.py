"""Commands killed: `map`, `live`, `compact`, `export` and `publish`, each in a forked process."""

from __future__ import annotations

import importlib
import os
import random
import sqlite3
import sys
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any, Final

from benchmarks.kills.examination import Finding, Known, examine, examine_export, examine_mapped
from benchmarks.kills.frames import frame_update
from benchmarks.kills.processes import Child
from benchmarks.kills.tally import Tally
from benchmarks.kills.writing import create, finding_of
from hereabouts.cli import main
from kg.serving.opening import open_map

MAX_DELAY = 0.4  # [s] from the first frame of a mapper to the kill
A_MAP = 20  # kills of one map
A_STEP = 6  # frames written between two kills of a command
Told = Callable[[Any], None]
OnKill = Callable[[], None]


def kill_mapping(folder: Path, kills: int, rng: random.Random, on_kill: OnKill) -> Tally:
    """`hereabouts map` of a simulated house, killed and gone on with."""
    return _kill_mappers("map", folder, kills, rng, on_kill)


def kill_live(folder: Path, kills: int, rng: random.Random, on_kill: OnKill) -> Tally:
    """`hereabouts live` of a folder, killed and gone on with."""
    return _kill_mappers("live", folder, kills, rng, on_kill)


def kill_compact(folder: Path, kills: int, rng: random.Random, on_kill: OnKill) -> Tally:
    """`hereabouts compact` without and with a bound of the past; nothing of the map is lost."""

    def words(path: Path) -> list[str]:
        return ["compact", str(path), *rng.choice(([], ["--keep", "1s"], ["--keep", "1h"]))]

    return _kill_after_frames("compact", words, folder, kills, rng, on_kill)


def kill_export(folder: Path, kills: int, rng: random.Random, on_kill: OnKill) -> Tally:
    """`hereabouts export`, the backup of a map, over an older one; that or the new one stays."""

    def words(path: Path) -> list[str]:
        return ["export", str(path), "-o", str(path.with_suffix(".trig"))]

    return _kill_after_frames("export", words, folder, kills, rng, on_kill)


def _kill_after_frames(
    what: str,
    words: Callable[[Path], list[str]],
    folder: Path,
    kills: int,
    rng: random.Random,
    on_kill: OnKill,
) -> Tally:
    tally = Tally(what)
    path, frames, longest = folder, 0, 0.0
    while tally.kills < kills:
        if tally.kills % A_MAP == 0:
            path = folder / f"{what}-{tally.kills}.map"
            create(path)
            frames = written(path, 0)
            longest = run(words(path))
        frames = written(path, frames)
        tally.early += not killed(partial(main, words(path)), rng, longest)
        known = Known(frames, 0, frames)
        examined(tally, path.name, partial(examine, path, known, known, read_only=False))
        if what == "export":
            examined(tally, path.name, partial(examine_export, path.with_suffix(".trig"), frames))
        tally.kills += 1
        tally.acknowledged += A_STEP
        on_kill()
    tally.notes = [f"{tally.early} ended before the kill"]
    tally.early = 0
    return tally


def _kill_mappers(
    command: str, folder: Path, kills: int, rng: random.Random, on_kill: OnKill
) -> Tally:
    tally = Tally(command)
    recording = folder / "house"
    run(["simulate", "house", "--seed", "3", "--size", "80x60", "-o", str(recording), "--json"])
    finished, path = 0, folder / f"{command}-0.map"
    run([*_words(command, recording, folder / "first.map"), "--limit", "9"])
    while tally.kills < kills:
        words = _words(command, recording, path)
        before = _commits(path)
        wanted = before + rng.choice((0, 1, 2, 5))
        killed_in_time = killed(partial(main, words), rng, MAX_DELAY, partial(_has, path, wanted))
        told = _commits(path)
        tally.kills += 1
        tally.early += told == before
        tally.acknowledged += told - before
        if path.exists():
            examined(tally, path.name, partial(examine_mapped, path, told))
        on_kill()
        if not killed_in_time:
            finished += 1
            path = folder / f"{command}-{tally.kills}.map"
    tally.notes = [f"{finished} recordings finished"]
    return tally


_END: Final = {"map": [], "live": ["--idle", "1"]}
_PACKAGES: Final = ("hereabouts", "kg", "mapping", "perception", "planner", "cv2", "scipy", "numpy")


def _words(command: str, recording: Path, path: Path) -> list[str]:
    words = [command, str(recording), "--into", str(path), "--json", *_END[command]]
    words += ["--detector", str(recording / "detections.json")]
    return [*words, "--places", str(recording / "places.json")]


def killed(
    work: Callable[[], object],
    rng: random.Random,
    longest: float,
    begun: Callable[[], bool] = lambda: True,
) -> bool:
    """Run `work` in a fork and kill it within `longest` [s] from when it has `begun`.

    Whether it was still at work.
    """

    def silent(told: Told) -> None:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        work()
        told("done")

    child = Child(silent)
    while not begun() and not child.ended():
        time.sleep(0.005)
    time.sleep(rng.uniform(0.0, longest))
    child.kill()
    done = "done" in list(child.rest())
    child.close()
    return not done


def examined(tally: Tally, where: str, look: Callable[[], Finding]) -> None:
    """Look at the map in a child, and count what was found."""
    finding = finding_of(Child(lambda told: told(asdict(look()))))
    tally.checks += 1
    tally.opened.append(finding.seconds)
    tally.wrong += [f"{where}, kill {tally.kills + 1}: {line}" for line in finding.wrong]


def run(words: list[str]) -> float:
    """A command from its beginning to its end; its time [s]. Raises RuntimeError."""
    started = time.monotonic()

    def work(told: Told) -> None:
        os.dup2(2, 1)
        told([main(words), *sys.modules])

    child = Child(work)
    done, *modules = child.hear(600.0)
    seconds = time.monotonic() - started
    child.end()
    child.close()
    if done != 0:
        raise RuntimeError(f"hereabouts {' '.join(words)} failed")
    for name in modules:  # so that the processes that are killed need not import them
        if name.partition(".")[0] in _PACKAGES:
            importlib.import_module(name)
    return seconds


def written(path: Path, frames: int) -> int:
    """Write some frames; how many there are then."""

    def work(told: Told) -> None:
        with open_map(path) as semantic_map:
            for number in range(frames, frames + A_STEP):
                semantic_map.apply(frame_update(number))

    child = Child(work)
    if child.end() != 0:
        raise RuntimeError(f"the map at {path} could not be written")
    child.close()
    return frames + A_STEP


def _has(path: Path, commits: int) -> bool:
    return _commits(path) >= commits


def _commits(path: Path) -> int:
    """Transactions in the log of a map; 0 where there is none."""
    try:
        with closing(sqlite3.connect(f"file:{path / 'history.sqlite'}?mode=ro", uri=True)) as log:
            return int(log.execute("SELECT coalesce(max(sequence), 0) FROM commits").fetchone()[0])
    except sqlite3.OperationalError:
        return 0
