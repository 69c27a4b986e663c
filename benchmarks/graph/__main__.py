"""`python -m benchmarks.graph`: the graph at several sizes, beside other stores of RDF."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from benchmarks.graph.suite import GraphBench, bench_graph
from hereabouts.cli.arguments import declare
from hereabouts.cli.console import note, print_table, write_json
from lab import command_line


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark; returns its exit code."""
    graph = argparse.ArgumentParser(
        prog="python -m benchmarks.graph",
        description="Processor time of frame updates, every shipped question and export on made-up "
        "buildings; a writer at 30 Hz beside readers; a long run, its last tenth over its first.",
        epilog="example: python -m benchmarks.graph --sizes 1000,100000",
    )
    graph.add_argument(
        "--sizes",
        type=_sizes,
        default=(1000, 10_000),
        metavar="N,N,...",
        help="how many objects (default: 1000,10000)",
    )
    graph.add_argument("--seconds", type=float, default=5.0, help="of each live run (default: 5)")
    graph.add_argument(
        "--frames",
        type=int,
        default=1000,
        metavar="N",
        help="of the long run (default: 1000; 0: none)",
    )
    graph.add_argument(
        "--rivals-up-to",
        type=int,
        default=10_000,
        metavar="N",
        help="objects up to which other stores are measured (default: 10000)",
    )
    declare(graph, "--json")
    return command_line.run(graph, run, argv)


def run(arguments: argparse.Namespace) -> int:
    """Measure the graph, print."""
    result = bench_graph(
        arguments.sizes,
        seconds=arguments.seconds,
        frames=arguments.frames,
        rivals_most=arguments.rivals_up_to,
        say=note,
    )
    if arguments.json:
        write_json(result.to_json())
        return 0
    live = [run for run in (result.driving, result.leaping) if run is not None]
    timings = [*result.timings, *(t for run in live for t in (run.update, run.read))]
    print_table(
        ("operation", "store", "objects", "median [ms]", "p95 [ms]", "p99 [ms]", "runs", "rows"),
        [
            (t.operation, t.store, t.objects, t.median, t.p95, t.p99, t.runs, t.rows)
            for t in timings
        ],
    )
    _note_graph(result)
    if max(arguments.sizes) > arguments.rivals_up_to:
        note(f"other stores were measured up to {arguments.rivals_up_to:,} objects only")
    return 0


def _note_graph(result: GraphBench) -> None:
    if (ratio := result.update_ratio()) is not None:
        note(f"an update of the largest map costs {ratio:.2f} times one of the smallest")
    if over := result.over_raw_store():
        note(f"an update of the smallest map costs {over:.2f} times its quads in a bare store")
    slowest = result.slowest_lookup()
    note(
        f"slowest of the lookups at {slowest.objects:,} objects: {slowest.operation}, "
        f"p99 {slowest.p99:.1f} ms"
    )
    for what, run in (("drives", result.driving), ("leaps about", result.leaping)):
        if run is not None:
            note(
                f"a robot that {what}: {run.late} of {run.frames} frames late at 30 a second; "
                f"{run.reads} reads beside"
            )
    if (flat := result.flatness) is not None:
        note(
            f"last tenth of {flat.frames} frames over the first: update {flat.update:.2f}, "
            f"lookup {flat.lookup:.2f}, memory {flat.memory:.2f}, disk {flat.disk:.2f}"
        )


def _sizes(text: str) -> tuple[int, ...]:
    try:
        sizes = tuple(int(part) for part in text.split(","))
    except ValueError:
        sizes = ()
    if not sizes or min(sizes) < 20:
        raise argparse.ArgumentTypeError(f"needs numbers of objects, 20 or more, got {text!r}")
    return sizes


if __name__ == "__main__":
    sys.exit(main())
