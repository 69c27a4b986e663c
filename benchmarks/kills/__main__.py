"""Kill processes of a map at random moments, cut its power, and look at the map after each.

    python -m benchmarks.kills [--rounds 600] [--seed 1] [--kind server ...]

Run it from the repository's root. The rounds are shared by the kinds; each kills one process. It
prints a table, names every violation on stderr, and exits 1 where there is one.
"""

from __future__ import annotations

import random
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

from benchmarks.kills.asking import kill_workers
from benchmarks.kills.commands import kill_compact, kill_export, kill_live, kill_mapping
from benchmarks.kills.cutting import cut_plain, cut_power_safe
from benchmarks.kills.publishing import kill_publishing
from benchmarks.kills.serving import kill_servers
from benchmarks.kills.tally import HEAD, Tally
from benchmarks.kills.writing import kill_writers
from lab.command_line import parser_of

Round = Callable[[Path, int, random.Random, Callable[[], None]], Tally]
KINDS: Final[dict[str, Round]] = {
    "writer": kill_writers,
    "server": kill_servers,
    "worker": kill_workers,
    "map": kill_mapping,
    "live": kill_live,
    "compact": kill_compact,
    "export": kill_export,
    "publish": kill_publishing,
    "power-safe": cut_power_safe,
    "power": cut_plain,
}


def main() -> int:
    """Run the rounds; 1 where anything was lost."""
    parser = parser_of("benchmarks.kills", __doc__)
    parser.add_argument("--rounds", type=int, default=600, help="of all kinds together (600)")
    parser.add_argument("--seed", type=int, default=1, help="of the moments (1)")
    parser.add_argument("--kind", action="append", choices=KINDS, help="only this (again)")
    arguments = parser.parse_args()
    started = time.monotonic()
    names = arguments.kind or list(KINDS)
    sys.stdout.write(HEAD + "\n")
    tallies = []
    for at, name in enumerate(names):
        rounds = arguments.rounds // len(names) + (at < arguments.rounds % len(names))
        if rounds:
            tallies.append(_run(name, rounds, arguments.seed))
    total = sum(tally.kills for tally in tallies)
    minutes = (time.monotonic() - started) / 60
    sys.stdout.write(f"\n{total:,} rounds, seed {arguments.seed}, {minutes:.1f} minutes\n")
    return 1 if any(tally.wrong for tally in tallies) else 0


def _run(name: str, rounds: int, seed: int) -> Tally:
    with tempfile.TemporaryDirectory(prefix="kills-") as folder:
        rng = random.Random(f"{seed} {name}")
        tally = KINDS[name](Path(folder), rounds, rng, _Progress(name, rounds))
    sys.stdout.write(tally.row() + "\n")
    sys.stdout.flush()
    sys.stderr.write("".join(f"{tally.what}: {line}\n" for line in tally.wrong))
    return tally


class _Progress:
    """Says on stderr how many rounds are done: a line that overwrites itself on a terminal."""

    def __init__(self, name: str, kills: int) -> None:
        self._name, self._kills, self._done = name, kills, 0

    def __call__(self) -> None:
        self._done += 1
        last = self._done == self._kills
        if sys.stderr.isatty():
            end = "\n" if last else ""
            sys.stderr.write(f"\r{self._name}: {self._done} of {self._kills} rounds{end}")
        elif last or self._done % 50 == 0:
            sys.stderr.write(f"{self._name}: {self._done} of {self._kills} rounds\n")
        sys.stderr.flush()


if __name__ == "__main__":
    sys.exit(main())
