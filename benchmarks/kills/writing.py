"""The writer killed: a process that applies frames as fast as it can, power-safe."""

from __future__ import annotations

import random
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from benchmarks.kills.examination import Finding, Known, examine, replay
from benchmarks.kills.frames import BASE, frame_update
from benchmarks.kills.processes import Child
from benchmarks.kills.tally import Tally
from kg.serving.opening import create_map, open_map

MAX_DELAY = 0.5  # [s] from the fork, or from the first frame, to the kill
AT_WORK = 0.7  # share of the kills that wait for the first frame
WITHIN = 120.0  # [s] in which it comes
A_MAP = 100  # kills of one map; then another begins
Told = Callable[[Any], None]


def kill_writers(
    folder: Path, kills: int, rng: random.Random, on_kill: Callable[[], None]
) -> Tally:
    """So many kills at moments drawn from `rng`, each followed by an examination."""
    tally = Tally("writer of frames")
    while tally.kills < kills:
        path = folder / f"writer-{tally.kills}.map"
        create(path)
        known = Known()
        for _ in range(min(A_MAP, kills - tally.kills)):
            known = _one(path, known, rng, tally)
            on_kill()
        tally.wrong += replayed(path)[1]
    return tally


def create(path: Path) -> None:
    """A new map at `path`, made by a child."""
    child = Child(lambda told: create_map(path, base=BASE, power_safe=True).close())
    if child.end() != 0:
        raise RuntimeError(f"the map at {path} could not be made")
    child.close()


def examined(path: Path, before: Known, acknowledged: Known, rng: random.Random) -> list[Finding]:
    """The findings of one child, or of two readers that open the map in the same moment."""
    read_only, beside = rng.random() < 0.6, rng.random() < 0.5

    def work(told: Told) -> None:
        told(asdict(examine(path, before, acknowledged, read_only=read_only)))

    children = [Child(work) for _ in range(2 if read_only and beside else 1)]
    return [finding_of(child) for child in children]


def replayed(path: Path) -> tuple[str, list[str]]:
    """Digest of a map, and what is wrong with its history from beginning to end."""
    child = Child(lambda told: told(replay(path)))
    try:
        found, wrong = child.hear(WITHIN)
        return found, wrong
    except EOFError:
        return "", [f"{path.name}: the history could not be replayed"]
    finally:
        child.end()
        child.close()


def _one(path: Path, known: Known, rng: random.Random, tally: Tally) -> Known:
    def work(told: Told) -> None:
        with open_map(path, power_safe=True) as semantic_map:
            number = known.frames
            while True:
                semantic_map.apply(frame_update(number))
                number += 1
                told(number)

    child = Child(work)
    told = [child.hear(WITHIN)] if rng.random() < AT_WORK else []
    time.sleep(rng.uniform(0.0, MAX_DELAY))
    child.kill()
    told += child.rest()
    child.close()
    acknowledged = replace(known, frames=max(told, default=known.frames))
    return settle(path, known, acknowledged, rng, tally).known


def settle(
    path: Path, known: Known, acknowledged: Known, rng: random.Random, tally: Tally
) -> Finding:
    """Examine the map after a kill, and count what was found."""
    tally.kills += 1
    told = acknowledged.frames + acknowledged.notes - known.frames - known.notes
    tally.acknowledged += told
    tally.early += told == 0
    findings = examined(path, known, acknowledged, rng)
    tally.checks += len(findings)
    where = f"{path.name}, kill {tally.kills}"
    tally.wrong += [f"{where}: {line}" for finding in findings for line in finding.wrong]
    if len({finding.digest for finding in findings}) > 1:
        tally.wrong.append(f"{where}: two readers of the same moment saw different graphs")
    tally.opened += [finding.seconds for finding in findings]
    found = findings[0]
    tally.unheard += found.known.sequence - acknowledged.frames - acknowledged.notes
    return found


def finding_of(child: Child) -> Finding:
    """The finding that a child tells of; one of a map that cannot be opened where it ended."""
    try:
        found = child.hear(WITHIN)
    except EOFError:
        return Finding(
            Known(), "", ("the map could not be opened and read; its traceback is above",)
        )
    finally:
        child.end()
        child.close()
    return Finding(
        Known(**found["known"]), found["digest"], tuple(found["wrong"]), found["seconds"]
    )
