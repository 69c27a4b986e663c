"""`hereabouts plot`: the map as a picture."""

from __future__ import annotations

import argparse
from pathlib import Path

from planner.cli.arguments import add_map, point
from planner.cli.console import note


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "plot",
        help="draw the map: places by category, objects by name, and a planned search",
        description="Draw the map as PNG, SVG or PDF.",
        epilog="example: hereabouts plot kitchen.map -o map.png --find banana",
    )
    add_map(parser)
    parser.add_argument(
        "-o", "--output", default="map.png", metavar="FILE", help="picture to write"
    )
    parser.add_argument("--find", metavar="OBJECT", help="draw the search for this object as well")
    parser.add_argument(
        "--from", dest="start", type=point, metavar="X,Y", help="where that search starts [m]"
    )
    parser.add_argument(
        "--all",
        action="store_true",
        help="draw objects of any existence, not only those of 0.5 and above",
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Draw the picture."""
    from kg.opening import open_map
    from planner.plans.thesis_rules import plan_search
    from planner.visualization.map_plot import SHOWN_EXISTENCE, plot_map

    output = Path(arguments.output)
    least = 0.0 if arguments.all else SHOWN_EXISTENCE
    with open_map(arguments.map, read_only=True) as semantic_map:
        if arguments.find is None:
            plot_map(semantic_map, output, least=least)
        else:
            plan = plan_search(semantic_map, arguments.find, arguments.start)
            goals = [step.goal for step in plan.steps]
            plot_map(
                semantic_map,
                output,
                least=least,
                goals=goals,
                route=[plan.start, *(goal.p_map for goal in goals)],
                title=f"{semantic_map.title}: where to look for {arguments.find}",
            )
    note(f"wrote {output}")
    return 0
