"""Retract an assertion; the value of perception is restored.

Perception has kept its value up to date. `hereabouts ask MAP assertions` lists all assertions. One
that somebody else has made in place of one's own stays.

example: hereabouts retract kitchen.map object/17 category --by ann
"""

from __future__ import annotations

import argparse

from hereabouts.cli.arguments import declare
from hereabouts.cli.assert_ import PROPERTIES, THING
from hereabouts.cli.console import note, notes_of, write_json


def add(parser: argparse.ArgumentParser) -> None:
    choices = {"choices": PROPERTIES, "metavar": None}
    declare(parser, f"{THING}\n--by\n--json", property=choices)


def run(arguments: argparse.Namespace) -> int:
    from kg.serving.opening import open_map
    from planner.search.goals.place_names import thing_named

    with open_map(arguments.map) as semantic_map:
        thing = thing_named(semantic_map, arguments.thing)
        change = semantic_map.assertions.retract(thing, arguments.property, by=arguments.by)
        sequence = semantic_map.sequence
    if arguments.json:
        write_json(
            {
                "thing": arguments.thing,
                "property": arguments.property,
                "by": change.cause.by if change else arguments.by,
                "changed": change is not None,
                "sequence": sequence,
                **notes_of(change, shown=False),
            }
        )
        return 0
    done = f"transaction {change.sequence}" if change else "nothing changed"
    now = "is removed" if arguments.property == "note" else "has the value of perception"
    note(f"{arguments.thing}: {arguments.property} {now}; {done}")
    notes_of(change, shown=True)
    return 0
