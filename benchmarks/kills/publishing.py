"""`hereabouts publish` killed: the copy on the server is of one transaction, and catches up."""

from __future__ import annotations

import random
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from benchmarks.kills.commands import A_STEP, examined, killed, run, written
from benchmarks.kills.examination import Finding, Known, differs, own_facts, stated
from benchmarks.kills.frames import BASE, expected
from benchmarks.kills.tally import Tally
from benchmarks.kills.writing import create
from hereabouts.cli import main
from kg.maps.semantic_map import SemanticMap
from kg.serving.opening import open_map
from kg.serving.publishing import PublishTarget
from tests.conftest import running_server

A_SERVER = 50  # kills


def kill_publishing(
    folder: Path, kills: int, rng: random.Random, on_kill: Callable[[], None]
) -> Tally:
    """So many kills of a publisher, the frames before each unpublished."""
    tally = Tally("publish")
    if not _oxigraph().is_file():
        tally.notes = ["not run: there is no oxigraph server in this environment"]
        return tally
    while tally.kills < kills:
        path = folder / f"published-{tally.kills}.map"
        create(path)
        with running_server(folder / f"server-{tally.kills}") as url:
            frames, longest = 0, run(["rooms", str(path)])
            for _ in range(min(A_SERVER, kills - tally.kills)):
                frames = written(path, frames)
                words = ["publish", str(path), "--to", url, "--once"]
                tally.early += not killed(partial(main, words), rng, longest)
                examined(tally, path.name, partial(_published, url, frames))
                tally.kills += 1
                tally.acknowledged += A_STEP
                on_kill()
            examined(tally, path.name, partial(_caught_up, url, path, frames))
    tally.notes = [f"{tally.early} ended before the kill"]
    tally.early = 0
    return tally


def _published(url: str, frames: int) -> Finding:
    """The copy is of one transaction; before the first copy is complete it has no number."""
    target, started = PublishTarget(url), time.monotonic()
    number = target.acknowledged(BASE)
    target.close()
    wrong = []
    if number is not None:
        if number > frames:
            wrong.append(f"the copy is at #{number}, the map at #{frames}")
        with open_map(url, read_only=True) as copy:
            wrong += _differences(copy, number)
    return Finding(Known(), "", tuple(wrong), time.monotonic() - started)


def _caught_up(url: str, path: Path, frames: int) -> Finding:
    if main(["publish", str(path), "--to", url, "--once"]) != 0:
        return Finding(Known(), "", ("the map could not be published after the kills",))
    with open_map(url, read_only=True) as copy:
        return Finding(Known(), "", tuple(_differences(copy, frames)))


def _differences(copy: SemanticMap, number: int) -> list[str]:
    name = f"the copy at #{number}"
    written, wanted = stated(copy.engine), stated(expected(number, 0))
    return differs(name, own_facts(written), own_facts(wanted))


def _oxigraph() -> Path:
    return Path(sys.executable).with_name("oxigraph")
