"""`hereabouts bench`: numbers, measured here and now."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from planner.commands import bench_placement, bench_plan, bench_search
from planner.commands.arguments import add_json
from planner.commands.console import note, print_table, write, write_json
from planner.commands.map_recording import map_with_progress
from planner.commands.recording_arguments import add_recording_options, open_inputs

if TYPE_CHECKING:
    from kg.bench.graph import GraphBench


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the benchmarks."""
    parser = subparsers.add_parser(
        "bench", help="measure the mapper and the search", description=__doc__
    )
    benches = parser.add_subparsers(dest="bench", metavar="BENCH", required=True)
    mapping = benches.add_parser(
        "map",
        help="map a recording and score it against hand-made truth",
        description="Map a recording into a temporary map and score its objects: same class within "
        "0.5 m (large things 1.0 m), one to one.",
        epilog="example: hereabouts bench map --recording redkitchen --truth objects_gt.json",
    )
    mapping.add_argument("--recording", required=True, metavar="DIR")
    mapping.add_argument("--truth", required=True, metavar="FILE", help="objects_gt.json")
    add_json(mapping)
    add_recording_options(mapping)
    mapping.set_defaults(run=run_map)
    graph = benches.add_parser(
        "graph",
        help="the graph on disk, at several sizes, beside rdflib and owlready2",
        description="Time frame updates, every shipped question and export on made-up buildings; "
        "a writer at 30 Hz beside readers; a long run, its last tenth over its first.",
        epilog="example: hereabouts bench graph --sizes 1000,100000",
    )
    graph.add_argument(
        "--sizes",
        type=_sizes,
        default=(1000, 10_000),
        metavar="N,N,...",
        help="how many objects (default: 1000,10000)",
    )
    graph.add_argument("--seconds", type=float, default=10.0, help="of the live run (default: 10)")
    graph.add_argument(
        "--frames",
        type=int,
        default=3000,
        metavar="N",
        help="of the long run (default: 3000; 0: none)",
    )
    graph.add_argument(
        "--rivals-up-to",
        type=int,
        default=10_000,
        metavar="N",
        help="objects up to which rdflib and owlready2 are measured (default: 10000)",
    )
    add_json(graph)
    graph.set_defaults(run=run_graph)
    thesis = benches.add_parser(
        "thesis",
        help="the thesis' search table (4.5), run again beside the published numbers",
        description="Run the 18 searches of the thesis' Table 4.5 through the query files.",
    )
    add_json(thesis)
    thesis.set_defaults(run=run_thesis)
    bench_plan.add(benches)
    bench_placement.add(benches)
    bench_search.add(benches)


def run_map(arguments: argparse.Namespace) -> int:
    """Map, score, print."""
    import tempfile

    from kg.semantic_map import SemanticMap
    from mapping.truth import load_truth, score_map

    truth = load_truth(Path(arguments.truth))
    inputs = open_inputs(arguments)
    with (
        tempfile.TemporaryDirectory(prefix="hereabouts-bench-") as folder,
        SemanticMap.create(Path(folder) / "bench.map", title="bench") as semantic_map,
    ):
        report = map_with_progress(inputs, semantic_map)
        score = score_map(
            [
                (semantic_map.catalogue.label(record.category), record.p_map)
                for record in semantic_map.objects()
            ],
            truth,
            inputs.recording.T_map_world,
            inputs.settings,
        )
    result = {
        "detector": inputs.detector.name,
        "frames": report.frames,
        "frames_per_second": round(report.frames_per_second, 2),
        "milliseconds_per_frame": {k: round(v, 2) for k, v in report.milliseconds.items()},
        **score.to_json(),
    }
    if arguments.json:
        write_json(result)
        return 0
    print_table(
        ("class", "truth", "mapped", "matched", "duplicates", "median error [m]"),
        [
            (label, c.truth, c.mapped, c.matched, c.duplicates, c.position_error_median)
            for label, c in score.per_class.items()
        ],
        title=f"{inputs.recording.name}, {inputs.detector.name}",
    )
    print_table(
        ("precision", "recall", "median error [m]", "duplicates", "frames/s"),
        [
            (
                score.precision,
                score.recall,
                score.position_error_median,
                score.duplicates,
                report.frames_per_second,
            )
        ],
    )
    note(f"precision counts only classes whose truth is complete: {', '.join(truth.complete_for)}")
    return 0


def run_graph(arguments: argparse.Namespace) -> int:
    """Measure the graph, print."""
    from kg.bench.graph import bench_graph

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
        note(f"rdflib and owlready2 were measured up to {arguments.rivals_up_to:,} objects only")
    return 0


def _note_graph(result: GraphBench) -> None:
    if (ratio := result.update_ratio()) is not None:
        note(f"an update of the largest map costs {ratio:.2f} times one of the smallest")
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


def run_thesis(arguments: argparse.Namespace) -> int:
    """Run Table 4.5 again."""
    from planner.reference_world import run_table_4_5

    table = run_table_4_5()
    if arguments.json:
        write_json(table.to_json())
    else:
        write(table.to_markdown())
    return 0
