"""`hereabouts assert`: have something be as said, whatever perception believes."""

from __future__ import annotations

import argparse

from planner.commands.arguments import add_json, add_map
from planner.commands.console import note, write_json


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "assert",
        help="say how something is; it outranks perception until retracted",
        description="Say what the category, position, existence or label of an object is, or the "
        "category or label of a place. It outranks what is perceived until `hereabouts retract`; "
        "`hereabouts ask MAP conflicts` shows where perception contradicts.",
        epilog="example: hereabouts assert kitchen.map object/17 category bowl --by ann",
    )
    add_map(parser)
    add_what(parser)
    parser.add_argument(
        "value",
        nargs="+",
        metavar="VALUE",
        help="a category's name or IRI; X Y Z in metres; present or absent; a label",
    )
    parser.add_argument(
        "--by", metavar="NAME", help="who says so (a server that runs goes by its token)"
    )
    add_json(parser)
    parser.set_defaults(run=run, usage_error=parser.error)


def add_what(parser: argparse.ArgumentParser) -> None:
    """The thing and the property that `assert` and `retract` are about."""
    parser.add_argument("thing", metavar="THING", help="object/17, place/1 or a full IRI")
    parser.add_argument(
        "property",
        choices=("category", "position", "existence", "label"),
        help="which of its properties",
    )


def run(arguments: argparse.Namespace) -> int:
    """Assert, in one transaction."""
    from kg.endpoint import is_url
    from kg.semantic_map import SemanticMap

    if arguments.by is None and not is_url(arguments.map):
        arguments.usage_error("who says so? --by NAME")
    value, by = " ".join(arguments.value), arguments.by or ""
    with SemanticMap.open(arguments.map) as semantic_map:
        change = semantic_map.assert_(arguments.thing, arguments.property, value, by=by)
        (said,) = (
            a for a in semantic_map.assertions(arguments.thing) if a.property == arguments.property
        )
        sequence = semantic_map.sequence
    if arguments.json:
        write_json(
            {
                "thing": said.subject,
                "property": said.property,
                "value": said.value,
                "by": said.by,
                "perceived": said.perceived,
                "contradicted": said.since is not None,
                "changed": change is not None,
                "sequence": sequence,
            }
        )
        return 0
    done = f"transaction {change.sequence}" if change else "nothing changed"
    against = " (perception contradicts)" if said.since is not None else ""
    note(f"{arguments.thing}: {arguments.property} is {value}, says {said.by}{against}; {done}")
    return 0
