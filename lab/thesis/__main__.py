"""`python -m lab.thesis [TABLE]`: tables of the thesis beside the published numbers."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from hereabouts.cli.arguments import declare
from hereabouts.cli.console import write, write_json
from lab import command_line
from lab.thesis import categorisation, localisation, registration
from lab.thesis.table_4_5 import run_table_4_5

TABLES = ("4.1", "4.2", "4.3", "4.4", "4.5")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark; returns its exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m lab.thesis",
        description="Compute a table of the thesis' chapter 4 beside the published one: 4.1 and "
        "4.2 (localisation, together), 4.3 (objects by detector), 4.4 (places), 4.5 (searches).",
    )
    parser.add_argument("table", nargs="?", choices=TABLES, default="4.5", help="default: 4.5")
    parser.add_argument("--recording", type=Path, metavar="DIR", help="of table 4.3")
    parser.add_argument("--truth", type=Path, metavar="FILE", help="of table 4.3, complete")
    parser.add_argument(
        "--detector", action="append", metavar="NAME|FILE", help="of table 4.3; repeatable"
    )
    parser.add_argument(
        "--photographs",
        type=Path,
        nargs="+",
        default=[],
        metavar="DIR",
        help="of table 4.4: folders named as place categories, with images",
    )
    parser.add_argument(
        "--scene", default="default", metavar="NAME|FILE", help="scene classifier of table 4.4"
    )
    declare(parser, "--json")
    return command_line.run(parser, run, argv)


def run(arguments: argparse.Namespace) -> int:
    """Compute the table, print it."""
    if arguments.table == "4.5":
        table = run_table_4_5()
        if arguments.json:
            write_json(table.to_json())
        else:
            write(table.to_markdown())
        return 0
    if arguments.json:
        arguments.usage_error("--json is for table 4.5")
    if arguments.table == "4.3":
        if not (arguments.recording and arguments.truth):
            arguments.usage_error("table 4.3 needs --recording DIR and --truth FILE")
        detectors = arguments.detector or ["default"]
        lines = registration.report(arguments.recording, arguments.truth, detectors)
    elif arguments.table == "4.4":
        lines = categorisation.report(arguments.photographs, arguments.scene)
    else:
        lines = localisation.report()
    write("\n".join(lines))
    return 0


if __name__ == "__main__":
    sys.exit(main())
