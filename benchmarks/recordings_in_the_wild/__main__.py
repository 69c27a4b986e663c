"""Recordings in the wild: bags as other programs write them, mapped without options.

    python -m benchmarks.recordings_in_the_wild RECORDING [--kind WORD ...]

Writes the frames of a real recording by third-party writers in each kind of file, encoding, naming
and source of poses, maps each, and compares the map with that of the plain recording: positions of
things within 10 cm, colours, depth, up. A kind is mapped rightly, or refused with a line that names
an option, which is tried then. `--json FILE` keeps the verdicts. Prints
Markdown; exit code 1 where a map is silently wrong, or an option does not work.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path

from benchmarks.recordings_in_the_wild.kinds import kinds
from benchmarks.recordings_in_the_wild.live import live_trial
from benchmarks.recordings_in_the_wild.robot import shots, write_plain
from benchmarks.recordings_in_the_wild.trial import Outcome, plain, trial
from lab.command_line import parser_of
from lab.command_line import run as run_benchmark


def compare(arguments: argparse.Namespace) -> int:
    """Print the table."""
    words = [word.lower() for word in arguments.kind]
    chosen = [k for k in kinds() if not words or any(w in k.name.lower() for w in words)]
    frames, found = shots(arguments.recording)
    outcomes = list[Outcome]()
    with tempfile.TemporaryDirectory(dir=arguments.scratch) as scratch:
        true = plain(write_plain(frames, Path(scratch) / "plain"), frames, found)
        sys.stdout.write("| kind | result |\n|---|---|\n")
        for kind in chosen:
            with tempfile.TemporaryDirectory(dir=scratch) as folder:
                try_one = live_trial if kind.live else trial
                outcomes.append(one := try_one(kind, true, Path(folder)))
            sys.stdout.write(f"| {one.name} | {one.verdict} |\n")
            sys.stdout.flush()
            if arguments.lines and one.line:
                sys.stderr.write(f"    {one.line}\n")
    good = sum(one.good for one in outcomes)
    right = sum(one.verdict == "right" for one in outcomes)
    sys.stdout.write(f"\n{right} of {len(outcomes)} right without options, {good} good\n")
    if arguments.json:
        arguments.json.write_text(json.dumps({o.name: o.verdict for o in outcomes}, indent=1))
    return 0 if good == len(outcomes) else 1


def main() -> int:
    """Parse the command line."""
    parser = parser_of("benchmarks.recordings_in_the_wild", __doc__)
    parser.add_argument("recording", type=Path, help="folder of the kitchen")
    parser.add_argument("--kind", action="append", default=[], help="words of names (again)")
    parser.add_argument("--json", type=Path, help="file for the verdicts")
    parser.add_argument("--lines", action="store_true", help="print what was said")
    parser.add_argument("--scratch", type=Path, help="folder for bags and maps")
    return run_benchmark(parser, compare)


if __name__ == "__main__":
    sys.exit(main())
