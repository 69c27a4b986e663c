"""`python -m lab.placement`: how good the probabilities of places are, on real buildings."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from hereabouts.cli.arguments import declare
from hereabouts.cli.console import heading, note, print_table, progress, write_json
from lab import command_line

if TYPE_CHECKING:
    from lab.placement.trial import Result, Row


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark; returns its exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m lab.placement",
        description="Leave one building out: log loss, Brier score, calibration, rooms visited "
        "until found, for the thesis' edges, ConceptNet, statistics, the model as it ships and "
        "with statistics, and after some rooms were seen.",
        epilog="example: python -m lab.placement --homes homes --s3dis rooms_objects.csv",
    )
    parser.add_argument("--homes", required=True, metavar="DIR", help="homes, one JSON file each")
    parser.add_argument(
        "--statistics",
        metavar="CSV",
        help="rooms counted (default: hm3d_room_object_counts.csv in the folder of homes)",
    )
    parser.add_argument("--s3dis", metavar="CSV", help="rooms of office areas")
    parser.add_argument(
        "--apart", action="store_true", help="the statistics do not count these homes"
    )
    parser.add_argument(
        "--shipped-parameters",
        action="store_true",
        help="judge the numbers that ship instead of fitting to the other buildings each time",
    )
    parser.add_argument(
        "--bootstrap", type=int, default=1000, metavar="N", help="resamplings (default: 1000)"
    )
    parser.add_argument("--seed", type=int, default=0, help="which rooms were seen (default: 0)")
    declare(parser, "--json")
    return command_line.run(parser, run, argv)


def run(arguments: argparse.Namespace) -> int:
    """Load, cross-validate, print."""
    from kg.knowledge.placement.belief_model import FITTED
    from lab.placement.data import Sources, load
    from lab.placement.trial import run as run_trial

    if arguments.bootstrap < 0 or arguments.seed < 0:
        arguments.usage_error("--bootstrap and --seed must be 0 or more")
    homes = Path(arguments.homes)
    sources = Sources(
        homes=homes,
        statistics=Path(arguments.statistics or homes / "hm3d_room_object_counts.csv"),
        s3dis=Path(arguments.s3dis) if arguments.s3dis else None,
        counted=False if arguments.apart else None,
    )
    data = load(sources)
    note(
        "the homes' own rooms are taken out of the statistics"
        if data.counted
        else "the statistics are taken not to count these homes"
    )
    with progress() as bar:
        task = bar.add_task("buildings", total=len(data.buildings), status="")
        result = run_trial(
            data,
            parameters=FITTED if arguments.shipped_parameters else None,
            bootstrap=arguments.bootstrap,
            seed=arguments.seed,
            tick=lambda: bar.advance(task),
        )
    if arguments.json:
        write_json(result.to_json())
    else:
        _print(result)
    return 0


def _print(result: Result) -> None:
    print_table(_HEAD, [_cells(row) for row in result.rows])
    heading("differences on the same rooms; below 0 the first is better")
    print_table(_HEAD, [_cells(row) for row in result.gains])
    places = result.places
    note(
        f"kinds of {places['rooms']:.0f} rooms told from their objects: "
        f"{places['from_objects']:.2f} right; "
        f"the most common kind: {places['most_common_kind']:.2f}"
    )
    note(f"{result.pairs} pairs of room and object, {result.searches} searches")


_HEAD = (
    *("buildings", "method", "log loss", "Brier", "ECE", "ECE equal mass"),
    *("rooms visited", "ECE on the floor", "rooms visited, 95 %"),
)


def _cells(row: Row) -> tuple[str, ...]:
    low, high = row.intervals.get("rooms_visited", (float("nan"), float("nan")))
    scores = [f"{score:.4f}" for score in row.scores.values()]
    return (row.buildings, row.method, *scores, f"{low:.2f} to {high:.2f}" if low == low else "")


if __name__ == "__main__":
    sys.exit(main())
