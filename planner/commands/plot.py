"""`hereabouts plot`: the map as a picture."""

from __future__ import annotations

import argparse
from pathlib import Path

from planner.commands.arguments import add_map, point
from planner.commands.console import note


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
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Draw the picture."""
    from kg.semantic_map import SemanticMap
    from planner.picture.map_picture import plot_map
    from planner.search import plan_search

    output = Path(arguments.output)
    with SemanticMap.open(arguments.map, read_only=True) as semantic_map:
        if arguments.find is None:
            plot_map(semantic_map, output)
        else:
            plan = plan_search(semantic_map, arguments.find, arguments.start)
            goals = [step.goal for step in plan.steps]
            plot_map(
                semantic_map,
                output,
                goals=goals,
                route=[plan.start, *(goal.p_map for goal in goals)],
                title=f"{semantic_map.title}: where to look for {arguments.find}",
            )
    note(f"wrote {output}")
    return 0
