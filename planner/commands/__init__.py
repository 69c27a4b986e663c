"""The command line: a module for each command, with `add(subparsers)` and `run(arguments) -> int`.

stdout carries the answer, stderr everything else. Exit code 0: done; 1: a `HereaboutsError`,
printed as one line; 2: wrong usage. A bug keeps its traceback.
"""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version

from kg.errors import HereaboutsError
from planner.commands.arguments import join_signed

#: command modules, in the order `hereabouts --help` lists them
COMMANDS = (
    "demo",
    "map_recording",
    "ask",
    "queries",
    "find",
    "search",
    "why",
    "log",
    "diff",
    "compact",
    "assert_",
    "retract",
    "update",
    "plot",
    "floor",
    "serve",
    "export",
    "import_maps",
    "check",
    "ontology",
    "models",
    "bench",
)


def build_parser() -> argparse.ArgumentParser:
    """The parser of the whole command line."""
    parser = argparse.ArgumentParser(
        prog="hereabouts",
        description="The map a robot can be asked about: RGB-D frames in, a live knowledge graph "
        "of what stands where out.",
        epilog="`hereabouts COMMAND --help` shows a command's options and an example.",
    )
    parser.add_argument("--version", action="version", version=f"hereabouts {_version()}")
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name in COMMANDS:
        importlib.import_module(f"planner.commands.{name}").add(subparsers)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; the entry point of the console script."""
    words = sys.argv[1:] if argv is None else argv
    arguments = build_parser().parse_args(join_signed(words))
    try:
        return int(arguments.run(arguments))
    except HereaboutsError as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)  # noqa: T201
        return 1
    except BrokenPipeError:
        # the reader of our stdout left (| head): nobody to tell, and Python must not try to flush
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except KeyboardInterrupt:
        print("interrupted: whole frames so far are kept", file=sys.stderr)  # noqa: T201
        return 130


def _version() -> str:
    try:
        return version("hereabouts")
    except PackageNotFoundError:
        return "(not installed)"
