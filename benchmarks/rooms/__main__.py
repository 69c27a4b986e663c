"""The gate for maps: `python -m benchmarks.rooms [--cache DIR] [--seeds N N ...]`.

Maps every real recording that has a complete truth, with every network, in stretches: whole, every
4th frame, each half, backwards, where the camera only turns, where it stands, and single frames;
and simulated houses, drawn anew each time. Prints the default mapper's scores beside the
reference's as Markdown. Exits with 1, and a line for each reason, where the default is worse than
the reference in a room, misses its goals in houses, or is badly calibrated (docs/reference/
benchmarks.md).
"""

from __future__ import annotations

import argparse
import os
import random
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final, TypeVar

from benchmarks.command_line import run
from benchmarks.rooms.gate import violations
from benchmarks.rooms.looks import networks
from benchmarks.rooms.measuring import measured
from benchmarks.rooms.real_room import room_folders
from benchmarks.rooms.report import report
from benchmarks.rooms.stretches import STRETCHES

HOUSES_DRAWN: Final = 4

T = TypeVar("T")

def _command(arguments: argparse.Namespace) -> int:
    folders = _chosen(room_folders(), arguments.rooms, "room", arguments)
    chosen = _chosen(networks(), arguments.networks, "network", arguments)
    if arguments.seeds is None:
        arguments.seeds = random.sample(range(1000, 1_000_000), HOUSES_DRAWN)
    with tempfile.TemporaryDirectory() as temporary:
        cache = arguments.cache or Path(temporary)
        cache.mkdir(parents=True, exist_ok=True)
        outcomes = measured(
            (list(folders.values()), chosen, tuple(arguments.stretches), arguments.seeds),
            cache,
            arguments.processes,
        )
    lines = [*report(outcomes), f"- seeds of the houses: {' '.join(map(str, arguments.seeds))}"]
    failed = [f"- gate: {line}" for line in violations(outcomes)]
    sys.stdout.write("\n".join([*lines, *(failed or ["- gate: passed"])]) + "\n")
    return 1 if failed else 0


def _chosen(
    known: dict[str, T], names: Sequence[str] | None, kind: str, arguments: argparse.Namespace
) -> dict[str, T]:
    for name in names or ():
        if name not in known:
            arguments.usage_error(f"no {kind} {name!r}; there are: {', '.join(known)}")
    return known if names is None else {name: known[name] for name in names}


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, print the table, and judge."""
    parser = argparse.ArgumentParser(prog="benchmarks.rooms", description=__doc__)
    parser.add_argument("--rooms", nargs="*", metavar="NAME", help="recordings (default: all)")
    parser.add_argument("--networks", nargs="*", metavar="NAME", help="detectors (default: all)")
    parser.add_argument("--stretches", nargs="*", default=STRETCHES, choices=STRETCHES)
    parser.add_argument("--seeds", type=int, nargs="*", help="houses (default: 4, drawn anew)")
    parser.add_argument("--cache", type=Path, metavar="DIR", help="keeps what networks saw")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    return run(parser, _command, argv)


if __name__ == "__main__":
    sys.exit(main())
