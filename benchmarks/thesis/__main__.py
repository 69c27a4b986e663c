"""`python -m benchmarks.thesis`: the thesis' Table 4.5, computed beside the published numbers."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from benchmarks import command_line
from benchmarks.thesis.table_4_5 import run_table_4_5
from planner.cli.arguments import add_json
from planner.cli.console import write, write_json


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark; returns its exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.thesis",
        description="Run the 18 searches of the thesis' Table 4.5 through the query files.",
    )
    add_json(parser)
    return command_line.run(parser, run, argv)


def run(arguments: argparse.Namespace) -> int:
    """Compute the table, print it."""
    table = run_table_4_5()
    if arguments.json:
        write_json(table.to_json())
    else:
        write(table.to_markdown())
    return 0


if __name__ == "__main__":
    sys.exit(main())
