"""Draw the map: places by category, objects by name, and a planned search.

The picture is a PNG, SVG or PDF file.

example: hereabouts plot kitchen.map -o map.png --find banana
"""

from __future__ import annotations

import argparse
from pathlib import Path

from hereabouts.cli.arguments import add_map, add_now, add_start, now_of
from hereabouts.cli.console import note


def add(parser: argparse.ArgumentParser) -> None:
    add_map(parser)
    parser.add_argument(
        "-o",
        "--output",
        default="map.png",
        metavar="FILE",
        help="picture file (default: map.png)",
    )
    parser.add_argument(
        "--find",
        metavar="OBJECT",
        help="also draw the plan of `hereabouts find`: path, looks, reasons and times",
    )
    add_start(parser)
    add_now(parser)
    parser.add_argument(
        "--legend",
        choices=("class", "place"),
        default="class",
        help="give objects the colour and mark of their class, or of the category of their place "
        "(default: class)",
    )
    parser.add_argument(
        "--all",
        action="store_true",
        help="name objects of any existence (default: those below 0.5 are faint marks)",
    )


def run(arguments: argparse.Namespace) -> int:
    from hereabouts.display.plots.drawing import SHOWN_EXISTENCE
    from hereabouts.display.plots.map_plot import plot_map
    from hereabouts.display.plots.search_plot import plot_plan
    from kg.serving.opening import open_map
    from planner.search.plans.search_state import build_search
    from planner.search.plans.view_plan import plan_from

    output = Path(arguments.output)
    least = 0.0 if arguments.all else SHOWN_EXISTENCE
    with open_map(arguments.map, read_only=True) as opened:
        semantic_map = opened.in_one_frame()
        state = None
        if arguments.find is not None:
            now = now_of(semantic_map, arguments)
            state = build_search(semantic_map, [arguments.find], at=now)
        if state is not None:
            plan = plan_from(semantic_map, state, arguments.start)
            plot_plan(semantic_map, state, plan, output, least=least, legend=arguments.legend)
            if not plan.steps:
                note(f"no look for {arguments.find} is drawn: no look shows a spot where it may be")
        else:
            plot_map(semantic_map, output, least=least, legend=arguments.legend)
            if arguments.find is not None:
                note(f"no search for {arguments.find} is drawn: the map has no floor to search")
    note(f"wrote {output}")
    return 0
