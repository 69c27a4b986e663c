"""The gate for object mappers: `python -m benchmarks.rooms [--cache DIR]`.

Maps every real recording that has a complete truth, with every network, and simulated houses drawn
anew each time. Prints the default mapper's scores beside the reference's as Markdown. Exits with 1,
and a line for each reason, where the default falls short (docs/reference/benchmarks.md).
"""

from __future__ import annotations

import argparse
import os
import random
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final, TypeVar

from benchmarks.rooms.gate import report, violations
from benchmarks.rooms.measuring import measured, measured_houses
from benchmarks.rooms.recordings import networks, room_folders
from benchmarks.rooms.stretches import STRETCHES
from hereabouts.cli.arguments import count, whole
from lab.command_line import parser_of, run

HOUSES_DRAWN: Final = 4

T = TypeVar("T")


def _command(arguments: argparse.Namespace) -> int:
    refuse, processes = arguments.usage_error, arguments.processes
    folders = _chosen(room_folders(), arguments.rooms, refuse)
    looking = _chosen(networks(), arguments.networks, refuse)
    seeds = arguments.seeds
    if seeds is None:
        seeds = random.sample(range(1000, 1_000_000), HOUSES_DRAWN)
    with tempfile.TemporaryDirectory() as temporary:
        cache = arguments.cache or Path(temporary)
        cache.mkdir(parents=True, exist_ok=True)
        outcomes = measured([*folders.values()], looking, arguments.stretches, cache, processes)
    outcomes += measured_houses(seeds, processes)
    if not outcomes:
        refuse("neither rooms nor houses: there is nothing to measure")
    failed = [f"- gate: {line}" for line in violations(outcomes)] or ["- gate: passed"]
    drawn = f"- seeds of the houses: {' '.join(map(str, seeds)) or 'none'}"
    sys.stdout.write("\n".join([*report(outcomes), drawn, *failed]) + "\n")
    return 0 if failed == ["- gate: passed"] else 1


def _chosen(
    known: Mapping[str, T], names: Sequence[str] | None, refuse: Callable[[str], None]
) -> dict[str, T]:
    """Those of `known` that are named, all without names."""
    for name in names or ():
        if name not in known:
            refuse(f"no {name!r}; there are: {', '.join(known)}")
    return {name: known[name] for name in (known if names is None else names)}


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, print the table, and judge."""
    parser = parser_of("benchmarks.rooms", __doc__)
    parser.add_argument("--rooms", nargs="*", metavar="NAME", help="recordings (default: all)")
    parser.add_argument("--networks", nargs="*", metavar="NAME", help="detectors (default: all)")
    parser.add_argument("--stretches", nargs="*", default=STRETCHES, choices=STRETCHES)
    parser.add_argument("--seeds", type=count, nargs="*", help="houses (default: 4, drawn anew)")
    parser.add_argument("--cache", type=Path, metavar="DIR", help="keeps what networks saw")
    parser.add_argument("--processes", type=whole, default=os.cpu_count() or 1)
    return run(parser, _command, argv)


if __name__ == "__main__":
    sys.exit(main())
