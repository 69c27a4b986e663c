"""The command line: a module for each command, with `add(subparsers)` and `run(arguments) -> int`.

stdout carries the answer, stderr everything else. Exit code 0: done; 1: a `HereaboutsError`,
printed as one line; 2: wrong usage. A bug keeps its traceback.
"""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Iterable, Sequence
from itertools import chain
from pathlib import Path

from kg.errors import HereaboutsError, MapNotFoundError
from planner.cli.arguments import join_signed
from planner.cli.text_table import printable

#: command modules, in the order `hereabouts --help` lists them
COMMANDS = (
    "demo",
    "map_recording",
    "live",
    "info",
    "convert",
    "ask",
    "queries",
    "find",
    "search",
    "status",
    "why",
    "log",
    "diff",
    "compact",
    "assert_",
    "retract",
    "update",
    "restore",
    "plot",
    "floor",
    "places",
    "serve",
    "mcp",
    "publish",
    "export",
    "import_maps",
    "describe",
    "check",
    "ontology",
    "models",
    "teach",
    "evaluate",
    "simulate",
)


#: command of each module whose name is not the command's
_NAMED = {"map_recording": "map", "assert_": "assert", "import_maps": "import"}


def build_parser(modules: Iterable[str] = COMMANDS) -> argparse.ArgumentParser:
    """The parser of the command line, with the commands of `modules`; by default all."""
    parser = argparse.ArgumentParser(
        prog="hereabouts",
        description="The map a robot can be asked about: RGB-D frames in, a live knowledge graph "
        "of what stands where out.",
        epilog="`hereabouts COMMAND --help` shows a command's options and an example.",
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and exit")
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name in modules:
        importlib.import_module(f"planner.cli.{name}").add(subparsers)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; the entry point of the console script."""
    words = sys.argv[1:] if argv is None else argv
    arguments = build_parser(_modules_for(words)).parse_args(join_signed(words))
    try:
        return int(arguments.run(arguments))
    except HereaboutsError as error:
        text = printable(" ".join(str(error).split()))
        print(f"error: {text}{_swapped(arguments, error)}", file=sys.stderr)  # noqa: T201
        return 1
    except BrokenPipeError:
        # the reader of our stdout left (| head): nobody to tell, and Python must not try to flush
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except KeyboardInterrupt:
        print("interrupted: whole frames so far are kept", file=sys.stderr)  # noqa: T201
        return 130


def _swapped(arguments: argparse.Namespace, error: HereaboutsError) -> str:
    """A hint where the map was given after what is asked of it."""
    if not isinstance(error, MapNotFoundError):
        return ""
    values = (v if isinstance(v, list) else [v] for v in vars(arguments).values())
    for word in chain.from_iterable(values):
        is_map = isinstance(word, str) and word != getattr(arguments, "map", None)
        if is_map and (Path(word) / "store").is_dir():
            return f"; the map comes first: hereabouts {arguments.command} {word} ..."
    return ""


def _modules_for(words: Sequence[str]) -> Sequence[str]:
    """The modules that parsing `words` needs; all of them where no command comes first."""
    if words and words[0] == "--version":
        return ()
    return [name for name in COMMANDS if words[:1] == [_NAMED.get(name, name)]] or COMMANDS


class _Version(argparse.Action):
    """Looks the version up when it is asked for: that takes longer than all other arguments."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        print(f"hereabouts {_version()}")  # noqa: T201
        parser.exit()


def _version() -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("hereabouts")
    except PackageNotFoundError:
        return "(not installed)"
