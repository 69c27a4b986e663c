"""Command lines of benchmarks and trials: help, exit codes and errors as of `hereabouts`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence

from kg.model.errors import HereaboutsError


def parser_of(program: str, text: str | None) -> argparse.ArgumentParser:
    """Parser of ``python -m PROGRAM``; `text`, the module's docstring, is its help as it stands."""
    return argparse.ArgumentParser(
        prog=f"python -m {program}",
        description=text,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )


def run(
    parser: argparse.ArgumentParser,
    command: Callable[[argparse.Namespace], int],
    argv: Sequence[str] | None = None,
) -> int:
    """Exit code of `command`: 1 for a HereaboutsError, which is printed as one line."""
    arguments = parser.parse_args(argv)
    arguments.usage_error = parser.error
    try:
        return command(arguments)
    except HereaboutsError as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)  # noqa: T201
        return 1
