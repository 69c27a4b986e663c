"""`hereabouts find`: where to look first, why, and how long it will take."""

from __future__ import annotations

import argparse

from planner.commands.arguments import add_json, add_map, point
from planner.commands.console import note, print_plan, write_json


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "find",
        help="where to look for an object, in which order, and why",
        description="Derive search goals from the map by its query files and order them nearest "
        "first, as the thesis does. OBJECT is a category, a synonym, or a supercategory.",
        epilog="example: hereabouts find kitchen.map banana --from 0,0",
    )
    add_map(parser)
    parser.add_argument("object", metavar="OBJECT", help="what to find, e.g. banana, sofa, food")
    parser.add_argument(
        "--from",
        dest="start",
        type=point,
        metavar="X,Y",
        help="where the search starts [m] (default: where the robot is)",
    )
    add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Plan the search and print it."""
    from kg.semantic_map import SemanticMap
    from planner.search import plan_search

    with SemanticMap.open(arguments.map, read_only=True) as semantic_map:
        plan = plan_search(semantic_map, arguments.object, arguments.start)
    if arguments.json:
        write_json(plan.to_json())
        return 0
    if not plan.steps:
        note(plan.explanation)
        return 0
    print_plan(plan)
    return 0
