"""Kill writers, servers and query workers at random moments, and look at the map after each.

    python -m benchmarks.kills [--writer 600] [--server 200] [--worker 200] [--seed 1]

Run it from the repository's root. It prints a table, names every violation on stderr, and exits 1
where there is one.
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from benchmarks.kills.asking import kill_workers
from benchmarks.kills.serving import kill_servers
from benchmarks.kills.tally import HEAD, Tally
from benchmarks.kills.writing import kill_writers

Round = Callable[[Path, int, random.Random, Callable[[], None]], Tally]
_ROUNDS: tuple[tuple[str, int, Round], ...] = (
    ("writer", 600, kill_writers),
    ("server", 200, kill_servers),
    ("worker", 200, kill_workers),
)


def main() -> int:
    """Run the rounds; 1 where anything was lost."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.kills", description=__doc__)
    for name, kills, _ in _ROUNDS:
        parser.add_argument(f"--{name}", type=int, default=kills, metavar="N", help="kills of one")
    parser.add_argument("--seed", type=int, default=1, help="of the moments (1)")
    arguments = parser.parse_args()
    started = time.monotonic()
    tallies = []
    for name, _, kill in _ROUNDS:
        kills = getattr(arguments, name)
        if kills:
            with tempfile.TemporaryDirectory(prefix="kills-") as folder:
                rng = random.Random(f"{arguments.seed} {name}")
                tallies.append(kill(Path(folder), kills, rng, _Progress(name, kills)))
    sys.stdout.write(HEAD + "\n" + "".join(tally.row() + "\n" for tally in tallies))
    total = sum(tally.kills for tally in tallies)
    minutes = (time.monotonic() - started) / 60
    sys.stdout.write(f"\n{total:,} kills, seed {arguments.seed}, {minutes:.1f} minutes\n")
    wrong = [f"{tally.what}: {line}" for tally in tallies for line in tally.wrong]
    sys.stderr.write("".join(line + "\n" for line in wrong))
    return 1 if wrong else 0


class _Progress:
    """Says on stderr how many kills are done: a line that overwrites itself on a terminal."""

    def __init__(self, name: str, kills: int) -> None:
        self._name, self._kills, self._done = name, kills, 0

    def __call__(self) -> None:
        self._done += 1
        last = self._done == self._kills
        if sys.stderr.isatty():
            end = "\n" if last else ""
            sys.stderr.write(f"\r{self._name}: {self._done} of {self._kills} kills{end}")
        elif last or self._done % 50 == 0:
            sys.stderr.write(f"{self._name}: {self._done} of {self._kills} kills\n")
        sys.stderr.flush()


if __name__ == "__main__":
    sys.exit(main())
