"""Attack a served map on this machine, and count what got out, broke, stopped or was lost.

    python -m benchmarks.attack [--family NAME ...] [--seed N]

Run it from the repository's root. Everything happens on the loopback, in bounded numbers. A family
is a module with a function `attack(target) -> Outcome`. It exits 1 where a count is not 0.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from dataclasses import astuple
from pathlib import Path
from typing import Final

from benchmarks.attack import (
    connections,
    exhaustion,
    files,
    iris,
    network,
    ontologies,
    sandbox,
    strangers,
    writers,
)
from benchmarks.attack.outcome import HEAD, Outcome
from benchmarks.attack.target import Target
from lab.command_line import parser_of

FAMILIES: Final[dict[str, Callable[[Target], Outcome]]] = {
    "network": network.attack,
    "exhaustion": exhaustion.attack,
    "strangers": strangers.attack,
    "ontologies": ontologies.attack,
    "iris": iris.attack,
    "files": files.attack,
    "connections": connections.attack,
    "sandbox": sandbox.attack,
    "writers": writers.attack,
}


def main() -> int:
    """Run the families; 1 where one of them got anywhere."""
    parser = parser_of("benchmarks.attack", __doc__)
    parser.add_argument("--family", action="append", choices=FAMILIES, help="only this (again)")
    parser.add_argument("--seed", default="1", help="of the spellings: another makes others (1)")
    arguments = parser.parse_args()
    names = arguments.family or list(FAMILIES)
    total = Outcome()
    _line("family", *HEAD)
    for name in names:
        with (
            tempfile.TemporaryDirectory() as folder,
            Target(Path(folder), arguments.seed) as target,
        ):
            outcome = FAMILIES[name](target)
        _line(name, *astuple(outcome))
        total += outcome
    _line("all", *astuple(total))
    return 0 if total.held else 1


def _line(*cells: object) -> None:
    sys.stdout.write("".join(f"{cell!s:>12}" for cell in cells).rstrip() + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    raise SystemExit(main())
