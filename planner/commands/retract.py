"""`hereabouts retract`: take back what was said."""

from __future__ import annotations

import argparse

from planner.commands.arguments import add_json, add_map
from planner.commands.assert_ import add_what
from planner.commands.console import note, write_json


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "retract",
        help="take back what was said; what perception believes counts again",
        description="Take back an assertion. Perception's own belief, kept up to date meanwhile, "
        "is the map's again. `hereabouts ask MAP assertions` lists what was said.",
        epilog="example: hereabouts retract kitchen.map object/17 category --by ann",
    )
    add_map(parser)
    add_what(parser)
    parser.add_argument(
        "--by", metavar="NAME", help="who takes it back (a server that runs goes by its token)"
    )
    add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Retract, in one transaction."""
    from kg.semantic_map import SemanticMap

    with SemanticMap.open(arguments.map) as semantic_map:
        change = semantic_map.retract(arguments.thing, arguments.property, by=arguments.by)
        sequence = semantic_map.sequence
    if arguments.json:
        write_json(
            {
                "thing": arguments.thing,
                "property": arguments.property,
                "by": change.cause.by if change else arguments.by,
                "changed": change is not None,
                "sequence": sequence,
            }
        )
        return 0
    done = f"transaction {change.sequence}" if change else "nothing changed"
    note(f"{arguments.thing}: {arguments.property} is as perceived again; {done}")
    return 0
