"""Processor time of commands that start, work and end, of several installations by turns.

    python -m benchmarks.start_up NAME=ENVIRONMENT=FOLDER [...] [--runs 9]

ENVIRONMENT is a virtual environment, FOLDER one in which its `hereabouts demo` was run.
Prints the median of user and system time [s]; the first run of each is not counted.
"""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys
from pathlib import Path

from lab.command_line import parser_of

COMMANDS = (
    ("--version",),
    ("ask", "demo.map", "objects"),
    ("find", "demo.map", "banana"),
    ("find", "demo.map", "apple"),
)


def seconds(environment: Path, folder: Path, words: tuple[str, ...]) -> float:
    """Processor time [s] of one run; raises CalledProcessError where it fails."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [str(environment / "bin" / "hereabouts"), *words]
    settings = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    subprocess.run(command, cwd=folder, env=settings, capture_output=True, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> int:
    """Run the commands by turns and print the table."""
    parser = parser_of("benchmarks.start_up", __doc__)
    parser.add_argument("sides", nargs="+", metavar="NAME=ENVIRONMENT=FOLDER")
    parser.add_argument("--runs", type=int, default=9)
    arguments = parser.parse_args()
    sides = [side.split("=") for side in arguments.sides]
    rows = [["s of processor time", *(name for name, _, _ in sides)], ["---"] * (len(sides) + 1)]
    for words in COMMANDS:
        runs = [
            [seconds(Path(environment), Path(folder), words) for _, environment, folder in sides]
            for _ in range(arguments.runs + 1)
        ]
        medians = (statistics.median(column) for column in zip(*runs[1:], strict=True))
        rows.append([" ".join(words), *(f"{median:.2f}" for median in medians)])
    sys.stdout.write("".join(f"| {' | '.join(row)} |\n" for row in rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
